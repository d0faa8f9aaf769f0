"""`predict` asks for a guess before the model answers."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import ipywidgets as w

from labkit.experiment import Experiment, ParameterError


def predict(question: str, experiment: Experiment[Any], metric: str, choices: Sequence[str] = ()) -> w.Widget:
    """Ask for a guess before the model answers; the answer is that metric of that experiment, computed when asked for.

    With `choices` the guess is one of these texts, without it a number in the metric's unit.
    """
    found = {m.name: m for m in experiment.metrics(experiment.run())}
    if metric not in found:
        raise ParameterError(f"{experiment.name()} has no metric {metric!r}; it has {', '.join(found)}")
    m = found[metric]
    guess: w.Widget = (
        w.RadioButtons(options=list(choices), value=None, layout=w.Layout(width="auto"))
        if choices
        else w.Text(placeholder="your guess", layout=w.Layout(width="120px"))
    )
    reveal = w.Button(
        description="I have decided", button_style="primary", layout=w.Layout(width="auto", margin="2px 2px 2px 18px")
    )
    reveal.add_class("lab-predict-reveal")
    answer = w.HTML()

    def show(_: Any) -> None:
        try:
            mine = (guess.value if choices else float(guess.value)) if guess.value else None
        except ValueError:
            answer.value = '<div class="lab-error">Write a number, with a point for the decimals.</div>'
            return
        said = "" if mine is None else f"You said <b>{html.escape(str(mine) if choices else f'{mine:g} {m.unit}')}</b>. "
        right = mine == m.value or (isinstance(mine, float) and _near(mine, m.value))
        answer.value = (
            f'<div style="border-left:6px solid {"#009E73" if right else "#0072B2"};padding:4px 12px;font-size:16px">'
            f"{said}The model says <b>{html.escape(m.text())}</b>. {html.escape(m.note)}</div>"
        )

    reveal.on_click(show)
    unit = [w.HTML(html.escape(m.unit))] if m.unit and not choices else []
    box = w.VBox(
        [
            w.HTML(f'<div style="font-size:17px"><b>Predict.</b> {html.escape(question)}</div>'),
            w.HBox([guess, *unit, reveal], layout=w.Layout(align_items="center")),
            answer,
        ]
    )
    box.add_class("lab-predict")
    return box


def _near(guess: float, value: Any) -> bool:
    """Within 5 % of a number."""
    return isinstance(value, int | float) and abs(guess - value) <= 0.05 * abs(value)
