"""The kernel's side of what a bench shows: one widget for picture, cards, code line and error, one message per move.

The page's side is plot.js. Numeric arrays travel as binary buffers, nothing is compared or validated here (`Plotly.react` finds
what differs), and nothing comes back but clicks, ranges and the wish for a reset.
"""

from __future__ import annotations

import functools
import gzip
import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from labkit.bench.heard import HERE, Heard, page_code
from labkit.experiment import Metric

HEADLINES = 3  # cards above a picture

#: dtype -> name of JavaScript's typed array. Integers of 64 bits have none there.
TYPED = {np.dtype(name): name for name in ("float64", "float32", "int32", "uint32", "int16", "uint16", "int8", "uint8")}


@functools.cache
def plotly_js() -> bytes:
    """plotly's code for the page, compressed, from the plotly package; its Python classes are not imported for that."""
    spec = importlib.util.find_spec("plotly")
    assert spec is not None and spec.origin is not None, "plotly is a dependency"
    return gzip.compress((Path(spec.origin).parent / "package_data" / "plotly.min.js").read_bytes(), 2)


def pack(value: Any, buffers: list[memoryview]) -> Any:
    """A figure dict as JSON can carry it: arrays of numbers go to `buffers`, what is not finite becomes None."""
    if isinstance(value, dict):
        return {key: pack(each, buffers) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [pack(each, buffers) for each in value]
    if isinstance(value, np.ndarray):
        return _array(value, buffers)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _array(array: np.ndarray, buffers: list[memoryview]) -> Any:
    if array.dtype.kind == "b":
        array = array.astype(np.uint8)
    elif array.dtype in (np.int64, np.uint64):
        small = not array.size or (int(array.min()) >= -(2**31) and int(array.max()) < 2**31)
        array = array.astype(np.int32 if small else np.float64)
    if array.dtype not in TYPED or array.ndim not in (1, 2) or not array.size:
        return pack(array.tolist(), buffers)
    buffers.append(np.ascontiguousarray(array).data.cast("B"))
    return {"$array": len(buffers) - 1, "dtype": TYPED[array.dtype], "shape": list(array.shape)}


def cards(metrics: Sequence[Metric], headline: Sequence[str] = ()) -> list[dict[str, Any]]:
    """What the page writes on the card of each metric, and whether it stands above the picture (else it is folded away): those
    named in `headline`, the first three if that is empty.
    """
    return [
        {
            "name": m.name,
            "text": m.text(),
            "beside": [
                f"{word} {Metric('', value, m.unit).text()}"
                for word, value in (("bound", m.bound), ("published", m.published))
                if value is not None
            ],
            "good": None if m.good is None else bool(m.good),
            "note": m.note,
            "headline": m.name in headline if headline else i < HEADLINES,
        }
        for i, m in enumerate(metrics)
    ]


class Plot(Heard):
    """The picture with its cards, code line and error.

    Args:
        answer: gets what the page sends: reset, click, range or step.
        plays: what the buttons for back, play and forward go through; "": there are none.
    """

    _esm = page_code("figure.js", "legend.js", "zoom.js", "cards.js", "plot.js")
    _css = HERE / "plot.css"

    def __init__(self, answer: Callable[[dict[str, Any]], None], plays: str = "") -> None:
        super().__init__()
        self._answer = answer
        self._plays = plays
        self._shown: dict[str, Any] | None = None
        self._status: dict[str, Any] = {"error": "", "where": "", "progress": None}
        self._lift: Callable[[], None] | None = None
        self._awaited = False  # until a page has asked, whatever is sent is lost
        self.on_msg(self._received)

    def show(self, figure: dict[str, Any], cards: list[dict[str, Any]], code: str, idle: dict[str, str], ended: bool) -> None:
        """Draw all of it, and nothing is wrong or under way any more.

        Args:
            figure, cards, code: the picture as a dict, what `cards` made, the line of Python.
            idle: controls that change nothing now, and when they do, in words.
            ended: whether what plays is at its end.
        """
        self._shown = {"figure": figure, "cards": cards, "code": code, "idle": idle, "ended": ended}
        self._status = {"error": "", "where": "", "progress": None}
        self._send_all()

    def tell(self, error: str = "", where: str = "", progress: float | None = None) -> None:
        """Say what went wrong (with its place in the code) or how far a run is, beside a picture that is then not current."""
        self._status = {"error": error, "where": where, "progress": progress}
        if self._awaited:
            self.send({"kind": "status", "status": self._status})

    def veil(self, lift: Callable[[], None] | None) -> None:
        """Hide all of the bench until its question is decided; `lift` is called when the page asks to see it without a guess.
        None shows it.
        """
        self._lift = lift
        self._send_veil()

    def _send_veil(self) -> None:
        if self._awaited:
            self.send({"kind": "veil", "veiled": self._lift is not None})

    def _send_all(self) -> None:
        if not self._awaited:
            return
        if self._shown is None:
            self.send({"kind": "status", "status": self._status})
            return
        buffers: list[memoryview] = []
        figure = pack(self._shown["figure"], buffers)
        self.send({"kind": "show", **self._shown, "figure": figure, "plays": self._plays, "status": self._status}, buffers)

    def _received(self, _: Any, content: dict[str, Any], __: Any) -> None:
        match content:
            case {"want": "plotly"}:
                self.send({"kind": "plotly"}, [plotly_js()])
            case {"want": "state"}:
                self._awaited = True
                if self._lift:
                    self._send_veil()
                self._send_all()
            case {"lift": True}:
                if self._lift:
                    self._lift()
            case _:
                self._answer(content)
