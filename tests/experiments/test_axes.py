"""Axes hold still while a slider moves: every one has a range of its own, and along a slider it changes rarely or never."""

import pytest

from labkit.experiment import Experiment, Parameter
from labkit.experiments import experiments

MOST = 5  # ranges of one axis along the whole of one slider


def ranges(experiment: Experiment, result) -> dict[str, tuple]:
    """Axis -> its range; None where there is none, so that plotly would take it from the data."""
    layout = experiment.figure(result)["layout"]
    found = {}
    for name, axis in layout.items():
        if name.startswith(("xaxis", "yaxis")) and axis.get("visible", True) and axis.get("type") != "category":
            found[name] = tuple(axis["range"]) if axis.get("range") is not None else None
    return found


def positions(p: Parameter) -> list:
    """Both ends of a slider and five places between, or all choices."""
    if p.choices or p.type is bool:
        return list(p.choices or (False, True))
    if p.type is str:
        return []
    step = p.step or (1 if p.type is int else (p.high - p.low) / 100)
    steps = int((p.high - p.low) / step)
    return sorted({p.type(round(p.low + step * (steps * i // 6), 9)) for i in range(7)})


@pytest.mark.parametrize("cls", experiments().values(), ids=experiments().keys())
def test_axes_hold_still(cls):
    start = cls()
    first = start.run()
    zoomed = (start.figure(first)["layout"].get("meta") or {}).get("range", ())
    assert None not in ranges(start, first).values(), "an axis takes its range from the data"
    for p in start.parameters():
        if p.name in zoomed:
            continue
        seen: dict[str, set] = {}
        for value in positions(p) if not cls.slow or p.view else ():
            there = start.replace(**{p.name: value})
            for name, range_ in ranges(there, first if there.same_run(start) else there.run()).items():
                seen.setdefault(name, set()).add(range_)
        for name, found in seen.items():
            assert None not in found, f"{name} takes its range from the data when {p.name} moves"
            if not p.choices and not (p.view and p.play):
                assert len(found) <= MOST, f"{name} has {len(found)} ranges while {p.name} moves: {sorted(found)}"
