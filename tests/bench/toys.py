"""Experiments made for testing the bench: quick, slow, failing, with text, views and clicks."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MaxLen, MultipleOf, Unit
from pydantic import field_validator
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View, progress


class Rolling(Experiment[float]):
    """How far does the robot roll on?"""

    speed: Annotated[int, Interval(ge=100, le=900), MultipleOf(50), Unit("mm/s"), Doc("speed when the brake comes")] = 500
    grip: Annotated[float, Interval(ge=0.5, le=1.5), MultipleOf(0.1), Doc("1 is dry floor")] = 1.0
    floor: Annotated[Literal["dry", "wet"], Doc("surface")] = "dry"
    note: Annotated[str, MaxLen(20), Doc("remark, without a q")] = ""
    first: Annotated[int, Interval(ge=0, le=90), Unit("ms"), Doc("left edge"), View()] = 0
    last: Annotated[int, Interval(ge=10, le=100), Unit("ms"), Doc("right edge"), View(play=True)] = 100
    runs: ClassVar[list] = []

    @field_validator("note")
    @classmethod
    def _no_q(cls, note: str) -> str:
        if "q" in note:
            raise ValueError(f"note {note!r} has a q; letters other than q are allowed")
        return note

    def without_effect(self) -> dict[str, str]:
        return {"grip": "on a dry floor only"} if self.floor == "wet" else {}

    def run(self) -> float:
        self.runs.append(self)
        for _ in progress(range(3)):
            pass
        if self.speed == 900 and self.floor == "wet":
            raise RuntimeError("the robot left the table")
        return self.speed**2 / 2000 * (2 if self.floor == "wet" else 1 / self.grip)

    def figure(self, result: float) -> dict:
        if self.first == 13:
            raise LookupError("no picture for 13")
        bars = {
            "type": "bar",
            "x": np.arange(3),
            "y": np.array([0.0, result, 1.0]),
            "meta": {"set": [{"speed": 100}, {"speed": 200, "floor": "wet"}, {"speed": 5}]},
        }
        line = {"type": "line", "x0": 0, "x1": 1, "y0": 0, "y1": 1}
        layout = {"xaxis": {"range": [self.first, self.last]}, "shapes": [line] * (self.speed // 300)}
        return {"data": [bars], "layout": layout | {"meta": {"range": ("first", "last")}, "title": {"text": self.note}}}

    def metrics(self, result: float) -> list[Metric]:
        note = f"seen from {self.first} on"
        return [Metric("distance", result, "mm", published=125, good=result < 200, note=note)]


class SlowRolling(Rolling):
    """The same, beside the controls."""

    slow: ClassVar[bool] = True
