"""What the cells of a notebook show when they run: text, tables and benches."""

from __future__ import annotations

import ast
import contextlib
import html
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from labkit.bench import Bench


@dataclass
class Shown:
    """What a cell shows, in order: pieces of HTML, and benches."""

    pieces: list[str | Bench] = field(default_factory=list)


def run_cells(sources: list[str], name: str) -> Iterator[Shown]:
    """Run the code cells of a notebook one after the other, in one namespace, and say what each shows.

    Raises:
        ValueError: a cell fails; names the notebook, the cell and the error.
    """
    space: dict[str, Any] = {"__name__": "__notebook__"}
    for number, source in enumerate(sources, 1):
        said = io.StringIO()
        try:
            tree = ast.parse(source)
            last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
            with contextlib.redirect_stdout(said):
                exec(compile(tree, f"{name}, code cell {number}", "exec"), space)
                value = None
                if isinstance(last, ast.Expr):
                    value = eval(compile(ast.Expression(last.value), f"{name}, code cell {number}", "eval"), space)
        except Exception as error:
            raise ValueError(f"{name}, code cell {number}: {type(error).__name__}: {error}") from None
        shown = Shown([_text(said.getvalue())] if said.getvalue() else [])
        if value is not None and not source.rstrip().endswith(";"):
            shown.pieces.append(_piece(value))
        yield shown


@contextlib.contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Work in the folder of the notebook, as its kernel would."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def _text(text: str) -> str:
    return f"<pre class='said'>{html.escape(text)}</pre>"


def _piece(value: Any) -> str | Bench:
    from labkit.bench import Bench

    if isinstance(value, Bench):
        return value
    if hasattr(value, "_repr_mimebundle_") and hasattr(value, "trait_names"):  # any other widget
        return f"<div class='asked'>{''.join(_words(value))}<p class='live'>Answered by a running kernel.</p></div>"
    if (table := getattr(value, "_repr_html_", None)) is not None:
        return f"<div class='table'>{table()}</div>"
    return _text(repr(value))


def _words(widget: Any) -> Iterator[str]:
    """The text and the choices of a widget and those inside it."""
    if isinstance(options := getattr(widget, "options", None), list | tuple):
        yield "<ul>" + "".join(f"<li>{html.escape(str(option))}</li>" for option in options) + "</ul>"
    elif type(widget).__name__ == "HTML" and "<" in widget.value:  # else it is the unit beside a field
        yield str(widget.value)
    for child in getattr(widget, "children", ()):
        yield from _words(child)
