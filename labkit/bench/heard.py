"""A widget with code of ours in the page that gets every message, however busy the page is.

anywidget waits for a widget's code for 2 s and, if it comes later, never again gives the widget a message of the kernel. A page
full of benches on a slow machine takes longer: the last ones stayed empty. Here messages go to the widget directly, and it asks
for what it missed.
"""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Any

import anywidget
import traitlets

HERE = Path(__file__).parent


def page_code(*names: str) -> str:
    """The code of a widget: files of this folder, the last of which exports it, and which call `hear`."""
    return "\n".join((HERE / name).read_text(encoding="utf-8") for name in ("heard.js", *names))


class Heard(anywidget.AnyWidget):
    """Its code in the page begins with heard.js and asks with {want: "state"} when it is ready.

    Attributes:
        address: by which the page finds this widget's model.
    """

    address = traitlets.Unicode().tag(sync=True)

    def __init__(self, **traits: Any) -> None:
        address = uuid.uuid4().hex
        super().__init__(model_id=address, address=address, **traits)
