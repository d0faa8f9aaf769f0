"""The commands of `labkit`, one module per group: each module has a function `add_to` that adds its own.

A new command goes into the module it belongs to, or into a new one that is listed in `GROUPS`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from labkit.commands import experiments, fusion, models, pages, recordings, sink
from labkit.outside import one_line

__all__ = ["parser"]

#: The groups in the order of `labkit --help`.
GROUPS = (experiments, pages, recordings, models, sink, fusion)

#: What each reader takes at most; more is refused with a sentence that says so.
LIMITS = """\
Limits: trace 256 MiB, JSON 64 MiB; replay 8 MiB, 1000 tasks, 10000000 ticks, 2000000 events; schedule 8 MiB, 50000 tasks,
1000000 jobs; windows 8 MiB, 1000 parts; cache 5000000 references, text 1 GiB; track 8 MiB, 1000 tracks,
20000000 predictions. What is more is refused and says so.
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))


class _Version(argparse.Action):
    def __call__(self, *_: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"labkit {version('labkit')}")
        sys.exit(0)


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = _Parser(prog="labkit", description="The Real-Time Lab on the command line.", epilog=LIMITS)
    top.add_argument("--version", action=_Version, nargs=0, help="print the version of the lab and exit")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, function: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.set_defaults(function=function)
        return command

    for group in GROUPS:
        group.add_to(add)
    return top
