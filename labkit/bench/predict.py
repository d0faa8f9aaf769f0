"""`predict` asks for a guess before the model answers and veils the bench until then; `guesses` is the table of all guesses."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import ipywidgets as w

from labkit.bench.guess import judge, read_number
from labkit.bench.vote import Vote
from labkit.experiment import Experiment, Metric, ParameterError


@dataclass(eq=False)
class Question:
    """A question, and what has become of it in this kernel.

    Attributes:
        experiment, metric: whose answer is asked for, and which.
        guess: as it was typed, "" for none; verdict: how near it is, in words.
        decided: whether the answer may be seen.
        bench: the code line of the bench that is veiled until then; "" before there is one.
        answer, unveil: called when it is decided: by the question in the page, and by benches that wait for it.
    """

    text: str
    experiment: Experiment[Any]
    metric: Metric
    guess: str = ""
    verdict: str = ""
    decided: bool = False
    bench: str = ""
    answer: Callable[[], None] = lambda: None
    unveil: list[Callable[[], None]] = field(default_factory=list)

    def decide(self, guess: str, verdict: str) -> None:
        """The answer may be seen from now on."""
        self.guess, self.verdict, self.decided = guess, verdict, True
        for tell in (self.answer, *self.unveil):
            tell()


#: All questions of this kernel, by text and experiment, in the order in which they were asked first.
asked: dict[tuple[str, str], Question] = {}
_tables: list[w.HTML] = []


def questions_before(experiment: Experiment[Any], veil: Callable[[Callable[[], None] | None], None]) -> None:
    """Veil a bench whose questions are not decided yet: those asked of its experiment since its last bench, or before this very
    bench when its cell runs again.
    """
    open_ones = [
        q
        for q in asked.values()
        if q.experiment.name() == experiment.name() and not q.decided and q.bench in ("", experiment.code())
    ]
    if not open_ones:
        return

    def show_all() -> None:
        for q in open_ones:
            if not q.decided:
                q.decide("", "not guessed")

    def look() -> None:
        if all(q.decided for q in open_ones):
            veil(None)

    for q in open_ones:
        q.bench = experiment.code()
        q.unveil.append(look)
    veil(show_all)


def predict(question: str, experiment: Experiment[Any], metric: str, choices: Sequence[str] = ()) -> w.Widget:
    """Ask for a guess before the model answers; the answer is that metric of that experiment.

    With `choices` the guess is one of these texts, without it a number in the metric's unit. The bench of the same experiment
    that is made next stays veiled until the guess is there. "Hall" opens a tally for the raised hands of an audience.
    """
    found = {m.name: m for m in experiment.metrics(experiment.run())}
    if metric not in found:
        raise ParameterError(f"{experiment.name()} has no metric {metric!r}; it has {', '.join(found)}")
    m = found[metric]
    q = asked.setdefault((question, experiment.code()), Question(question, experiment, m))
    entry: w.Widget = (
        w.RadioButtons(options=list(choices), value=q.guess if q.guess in choices else None, layout=w.Layout(width="auto"))
        if choices
        else w.Text(value=q.guess, placeholder="your guess", layout=w.Layout(width="140px"))
    )
    ready = w.Button(
        description="I have decided", button_style="primary", layout=w.Layout(width="auto", margin="2px 2px 2px 18px")
    )
    ready.add_class("lab-predict-reveal")
    hall = w.ToggleButton(description="Hall", tooltip="count raised hands", layout=w.Layout(width="auto"))
    vote, answer = Vote(choices, m.unit), w.HTML()

    def decide(*_: Any) -> None:
        try:
            guess = entry.value or "" if choices else read_number(entry.value, m.unit)
        except ValueError as error:
            answer.value = f'<div class="lab-error">{html.escape(str(error))}</div>'
            return
        q.decide("" if guess == "" else str(entry.value).strip(), judge(guess, m))

    def show() -> None:
        said = f"You said <b>{html.escape(_with_unit(q.guess, m.unit, choices))}</b>: {q.verdict}. " if q.guess else ""
        colour = {"right": "#009E73", "near": "#56B4E9"}.get(q.verdict.split(",")[0], "#0072B2")
        answer.value = (
            f'<div style="border-left:6px solid {colour};padding:4px 12px;font-size:16px">'
            f"{said}The model says <b>{html.escape(m.text())}</b>. {html.escape(m.note)}</div>"
        )
        vote.reveal(m)
        _fill_tables()

    q.answer = show
    if q.decided:
        show()
    ready.on_click(decide)
    entry.on_msg(lambda _, content, __: decide() if content.get("event") == "submit" else None)  # Enter
    unit = [w.HTML(html.escape(m.unit))] if m.unit and not choices else []
    text = w.HTML(f'<div style="font-size:17px"><b>Predict.</b> {html.escape(question)}</div>')
    row = w.HBox([entry, *unit, ready, hall], layout=w.Layout(align_items="center"))
    box = w.VBox([text, row, answer])
    hall.observe(
        lambda change: setattr(box, "children", [text, row, *([vote.box] if change["new"] else []), answer]), names="value"
    )
    box.add_class("lab-predict")
    return box


def guesses() -> w.Widget:
    """The questions of this notebook as a table: question, guess, model. It fills as they are decided."""
    table = w.HTML()
    _tables.append(table)
    _fill_tables()
    return table


def _fill_tables() -> None:
    rows = "".join(
        f"<tr><td>{html.escape(q.text)}</td><td>{html.escape(q.guess) or '–'}</td><td>{html.escape(q.metric.text())}</td>"
        f"<td>{html.escape(q.verdict)}</td></tr>"
        if q.decided
        else f"<tr><td>{html.escape(q.text)}</td><td colspan=3>not decided yet</td></tr>"
        for q in asked.values()
    )
    head = "<tr><th>question</th><th>your guess</th><th>model</th><th></th></tr>"
    for table in _tables:
        table.value = f'<table class="lab-guesses">{head}{rows}</table>' if rows else "No question has been asked yet."


def _with_unit(guess: str, unit: str, choices: Sequence[str]) -> str:
    bare = guess.replace(",", ".").replace(".", "").isdigit()
    return f"{guess} {unit}".strip() if bare and not choices else guess
