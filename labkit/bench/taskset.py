"""A bench with a table in place of a line of text: a set of tasks, edited, pasted, loaded and saved.

Knows the `Experiment` contract and, of an experiment about a table, what `OfATable` says. The page's side is taskset.js.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, Self

from labkit.bench.bench import Bench, Shown
from labkit.bench.heard import HERE, Heard, page_code
from labkit.experiment import Experiment, ParameterError


class OfATable(Protocol):
    """An experiment whose parameter `tasks` is a table as text.

    Its figure's layout has `meta={"table": {...}}` with `columns` (names), `rows` (cells as text), `wrong` (beside each row a
    sentence or ""), `heads` (columns of results: `text`, `good`, `foot`, `why`, and the parameters that a click on it will `set`)
    and `beside` (for each row and head `text` and `good`).
    """

    tasks: str

    @classmethod
    def from_json(cls, text: str, name: str = ...) -> Self:
        """The table in a file; ValueError with a sentence."""
        ...

    @classmethod
    def read(cls, path: str) -> Self:
        """The same from a disk."""
        ...

    def to_json(self) -> str:
        """The text of such a file; ValueError with a sentence."""
        ...


class Table(Heard):
    """The table in the page. `answer` gets what the page sends: text, load, save or set."""

    _esm = page_code("taskset.js")
    _css = HERE / "taskset.css"

    def __init__(self, answer: Callable[[dict[str, Any]], None]) -> None:
        super().__init__()
        self._answer = answer
        self._shown: dict[str, Any] | None = None
        self.on_msg(self._received)

    def show(self, text: str, table: dict[str, Any]) -> None:
        """Draw the rows of `text` with all that stands beside them."""
        self._shown = {"kind": "table", "text": text, **table}
        self.send(self._shown)

    def say(self, sentence: str) -> None:
        """A sentence below the table."""
        self.send({"kind": "note", "text": sentence})

    def save(self, text: str) -> None:
        """Let the reader keep a file."""
        self.send({"kind": "save", "text": text})

    def _received(self, _: Any, content: dict[str, Any], __: Any) -> None:
        if content.get("want") == "state":
            if self._shown:
                self.send(self._shown)
        else:
            self._answer(content)


class TaskSetEditor(Bench):
    """A bench whose parameter `tasks` is edited as a table.

    Attributes:
        table: the widget of the table.
    """

    def __init__(self, experiment: Experiment[Any]) -> None:
        self.table = Table(self._edited)
        super().__init__(experiment)
        self.controls["tasks"].layout.display = "none"
        controls, plot = self.children  # type: ignore[has-type]  # of a traitlet
        self.children = (self.table, controls, plot)

    def _replace(self, shown: Shown) -> None:
        super()._replace(shown)
        self.table.show(_about(shown.experiment).tasks, shown.figure["layout"]["meta"]["table"])

    def _edited(self, content: dict[str, Any]) -> None:
        """What the page wants of the table."""
        try:
            match content:
                case {"text": str(text)}:
                    with self._door:
                        if (
                            text == self.controls["tasks"].value and self._shown
                        ):  # nothing changes, and the page waits for an answer
                            self._replace(self._shown)
                        self.controls["tasks"].value = text
                case {"load": str(text), "name": str(name)}:
                    made: Any = _about(self._start).from_json(text, name)
                    self.set(**{each: getattr(made, each) for each in made.model_fields_set})
                    self.table.say(f"loaded {name}")
                case {"save": True}:
                    self.table.save(_about(self.experiment).to_json())
                case {"set": int(head)}:
                    self.set(**self.spec["layout"]["meta"]["table"]["heads"][head]["set"])
        except (ParameterError, ValueError, LookupError) as error:
            self.table.say(str(error))


def _about(experiment: Any) -> OfATable:
    return experiment


def task_set_editor(experiment: Any, path: str = "") -> TaskSetEditor:
    """A bench for an experiment about a table of tasks, `task_set_editor(OwnTaskSet)`; with a path the table begins with that
    file. Raises ValueError or OSError where it cannot be read.
    """
    if path:
        return TaskSetEditor(experiment.read(path))
    return TaskSetEditor(experiment() if isinstance(experiment, type) else experiment)
