"""What holds for every experiment at every position of its sliders."""

import itertools
import json
from functools import cache, lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import HealthCheck, given, settings

import labkit.phases.designs
import labkit.scheduler.periodic
from labkit.__main__ import main
from labkit.cache import Cache
from labkit.experiment import Experiment, Parameter
from labkit.experiments import experiments
from labkit.kernel import Kernel

EXPERIMENTS = experiments()


@pytest.fixture(scope="module", params=EXPERIMENTS.values(), ids=EXPERIMENTS.keys())
def cls(request):
    return request.param


def plain(figure: Any) -> Any:
    """A figure with lists in place of arrays, to be compared."""
    if isinstance(figure, np.ndarray):
        return figure.tolist()
    if isinstance(figure, dict):
        return {key: plain(value) for key, value in figure.items()}
    return [plain(value) for value in figure] if isinstance(figure, list | tuple) else figure


def text(figure: Any) -> str:
    """The same as text, in which not-a-number equals itself."""
    return json.dumps(plain(figure), default=lambda value: value.item() if isinstance(value, np.generic) else list(value))


@lru_cache(maxsize=2)
def start(cls: type[Experiment]) -> tuple[Experiment, Any]:
    """The experiment at its defaults and what it gives, run once for all tests that only look at it."""
    experiment = cls()
    return experiment, experiment.run()


@cache
def usual(cls: type[Experiment]) -> tuple[list[str], list[str]]:
    """Types of the traces and names of the metrics at the default."""
    experiment, result = start(cls)
    return [trace["type"] for trace in experiment.figure(result)["data"]], [m.name for m in experiment.metrics(result)]


def keeps_its_traces(experiment: Experiment, result: Any) -> dict[str, Any]:
    """What holds anywhere; returns the layout of the figure."""
    types, names = usual(type(experiment))
    figure = experiment.figure(result)
    assert [trace["type"] for trace in figure["data"]] == types
    metrics = experiment.metrics(result)
    assert metrics and [m.name for m in metrics] == names
    assert len({m.name for m in metrics}) == len(metrics)
    for m in metrics:
        if m.bound is not None and m.value is not None:
            assert m.value <= m.bound, f"{m.name}: {m.value} above its bound {m.bound}"
        assert m.value is not None or m.note or m.bound is None, f"{m.name}: no value and no note that says why"
    return figure["layout"]


def shows_the_same(experiment: Experiment, result: Any, other: Experiment) -> None:
    """What differs in views only has one result: shown in another way it gives what a fresh run gives."""
    seen = experiment.replace(**{p.name: getattr(other, p.name) for p in experiment.parameters() if p.view})
    fresh = seen.run()
    assert seen.same_run(experiment)
    assert seen.metrics(result) == seen.metrics(fresh)
    assert text(seen.figure(result)) == text(seen.figure(fresh))


def test_no_slider_position_crashes_and_another_view_shows_the_same_result(cls):
    """All sliders moved at once; one after the other moves in `test_along_every_slider_axes_hold_still`. Every other position is
    looked at in another view, too, and then run afresh.
    """
    turns, views = itertools.count(), any(p.view for p in cls.parameters())

    @settings(max_examples=6 if cls.slow else 12, suppress_health_check=[HealthCheck.too_slow])
    @given(cls.strategy(), cls.strategy())
    def anywhere(experiment, other):
        result = experiment.run()
        keeps_its_traces(experiment, result)
        if views and next(turns) % 2 == 0:
            shows_the_same(experiment, result, other)

    anywhere()


MOST = 5  # ranges of one axis along the whole of one slider


def ranges(layout: dict[str, Any]) -> dict[str, tuple | None]:
    """Axis -> its range; None where there is none, so that plotly would take it from the data."""
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


def test_along_every_slider_axes_hold_still(cls):
    """One slider after the other, from end to end: nothing crashes, the figure keeps its traces, and every axis has a range of
    its own that changes rarely or never. Of what is slow only the views move, which need no run.
    """
    experiment, first = start(cls)
    layout = experiment.figure(first)["layout"]
    zoomed = (layout.get("meta") or {}).get("range", ())
    assert None not in ranges(layout).values(), "an axis takes its range from the data"
    for p in experiment.parameters():
        seen: dict[str, set] = {}
        for value in positions(p) if not cls.slow or p.view else ():
            there = experiment.replace(**{p.name: value})
            layout = keeps_its_traces(there, first if there.same_run(experiment) else there.run())
            for name, range_ in ranges(layout).items():
                seen.setdefault(name, set()).add(range_)
        for name, found in seen.items() if p.name not in zoomed else ():
            assert None not in found, f"{name} takes its range from the data when {p.name} moves"
            if not p.choices and not (p.view and p.play):
                assert len(found) <= MOST, f"{name} has {len(found)} ranges while {p.name} moves: {sorted(found)}"


def test_figure_and_metrics_simulate_nothing(cls, monkeypatch):
    def refused(*_: Any, **__: Any) -> None:
        raise AssertionError("a figure or a metric simulates")

    experiment, result = start(cls)
    monkeypatch.setattr(cls, "run", refused)
    for owner, name in ((Kernel, "run"), (Cache, "read"), (Cache, "write"), (labkit.phases.designs, "run_design")):
        monkeypatch.setattr(owner, name, refused)
    module = __import__(cls.__module__, fromlist=["*"])
    for name in ("simulate", "count", "replay", "run_design", "experiment_1", "run_cost"):
        if hasattr(module, name) and getattr(module, name).__module__ != cls.__module__:
            monkeypatch.setattr(module, name, refused)
    experiment.figure(result)
    experiment.metrics(result)


def test_plotly_accepts_the_whole_figure(cls):
    experiment, result = start(cls)
    go.Figure(experiment.figure(result))


def test_the_page_decides_the_size_and_every_text_has_one(cls):
    """The page sets width and scales text; what it cannot see, it cannot scale."""
    experiment, result = start(cls)
    figure = experiment.figure(result)
    layout = figure["layout"]
    assert layout["height"] and not {"width", "autosize", "template"} & layout.keys()
    assert all("size" in note["font"] for note in layout.get("annotations", ()))
    for trace in figure["data"]:
        fonts = [trace.get(key) for key in ("textfont", "insidetextfont")]
        if "text" in trace and trace.get("mode", "text") != "markers":
            assert any(font and "size" in font for font in fonts), f"text of trace {trace.get('name')} has no size"


def test_a_run_is_pure(cls):
    experiment, result = start(cls)
    again = cls()
    assert again.metrics(again.run()) == experiment.metrics(result)


def test_the_command_line_runs_it_and_says_the_same_numbers(cls, capsys, monkeypatch):
    """It runs what it should, once; that a second run gives the same is tested above."""
    experiment, result = start(cls)
    ran = []
    monkeypatch.setattr(cls, "run", lambda self: ran.append(self) or result)
    assert main(["run", cls.name(), "--json"]) == 0
    assert ran == [experiment]
    printed = json.loads(capsys.readouterr().out)
    assert printed["parameters"] == experiment.model_dump()
    assert [m["name"] for m in printed["metrics"]] == [m.name for m in experiment.metrics(result)]
