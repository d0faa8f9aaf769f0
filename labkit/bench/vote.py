"""A tally beside a question: raised hands per answer, as bars, and the model's answer among them once it is known."""

from __future__ import annotations

import html
from collections.abc import Sequence

import ipywidgets as w

from labkit.bench.guess import judge, read_number
from labkit.experiment import Metric


class Vote:
    """Hands per choice, or per number that the hall calls out. Kept in the kernel only, and stored nowhere.

    Attributes:
        box: the widget.
        hands: answer -> raised hands.
    """

    def __init__(self, choices: Sequence[str], unit: str) -> None:
        self._unit, self._numbers = unit, not choices
        self._model: Metric | None = None
        self.hands: dict[str, int] = dict.fromkeys(choices, 0)
        self._rows = w.VBox()
        self._said = w.HTML()
        self._entry = w.Text(placeholder="a guess from the hall, Enter", layout=w.Layout(width="240px"))
        self._entry.on_msg(lambda _, content, __: self.call(self._entry.value) if content.get("event") == "submit" else None)
        self.box = w.VBox([*([] if choices else [self._entry]), self._said, self._rows])
        self.box.add_class("lab-vote")
        self._draw()

    def call(self, text: str) -> None:
        """One more hand for a number that was called out."""
        try:
            value = read_number(text, self._unit)
        except ValueError as error:
            self._said.value = f'<div class="lab-error">{html.escape(str(error))}</div>'
            return
        self._said.value = ""
        self._entry.value = ""
        if value != "":
            self.count(f"{value:g}", 1)

    def count(self, answer: str, hands: int) -> None:
        """That many hands more (or fewer) for an answer."""
        self.hands[answer] = max(0, self.hands.get(answer, 0) + hands)
        self._draw()

    def reveal(self, m: Metric) -> None:
        """Mark the answer of the model."""
        self._model = m
        self._draw()

    def _draw(self) -> None:
        most = max([*self.hands.values(), 1])
        answers = sorted(self.hands, key=float) if self._numbers else list(self.hands)
        self._rows.children = [self._row(answer, self.hands[answer] / most) for answer in answers]

    def _row(self, answer: str, share: float) -> w.Widget:
        right = self._model is not None and judge(float(answer) if self._numbers else answer, self._model) == "right"
        text = f"{answer} {self._unit}".strip() if self._numbers else answer
        bar = w.HTML(
            f'<div class="lab-hands"><i style="width:{30 * share:.1f}em;background:{"#009E73" if right else "#8c959f"}"></i>'
            f"<b>{self.hands[answer]}</b><span>{html.escape(text)}{' ← the model' if right else ''}</span></div>"
        )
        fewer, more = (w.Button(description=sign, layout=w.Layout(width="36px")) for sign in ("−", "+"))
        fewer.on_click(lambda _: self.count(answer, -1))
        more.on_click(lambda _: self.count(answer, 1))
        return w.HBox([fewer, more, bar], layout=w.Layout(align_items="center"))
