"""What every command needs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

#: Adds a command: its name, the function that runs it, and what it does; the parser it returns takes its options.
Add = Callable[[str, Callable[[argparse.Namespace], None], str], argparse.ArgumentParser]


def print_json(value: Any) -> None:
    """Print a value as JSON in the encoding of the terminal; numbers of numpy as Python's."""
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    json.dump(value, sys.stdout, indent=1, ensure_ascii=not unicode, default=lambda o: o.item() if hasattr(o, "item") else str(o))
    print()
