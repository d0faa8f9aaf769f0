"""What holds for every experiment at every position of its sliders."""

import json
from functools import cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import HealthCheck, given, settings

import labkit.phases.designs
import labkit.scheduler.periodic
from labkit.__main__ import main
from labkit.cache import Cache
from labkit.experiment import Experiment
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


@cache
def start(cls: type[Experiment]) -> tuple[Experiment, Any]:
    """The experiment at its defaults and what it gives, run once for all tests that only look at it."""
    experiment = cls()
    return experiment, experiment.run()


@cache
def usual(cls: type[Experiment]) -> tuple[list[str], list[str]]:
    """Types of the traces and names of the metrics at the default."""
    experiment, result = start(cls)
    return [trace["type"] for trace in experiment.figure(result)["data"]], [m.name for m in experiment.metrics(result)]


def test_no_slider_position_crashes_and_the_figure_keeps_its_traces(cls):
    @settings(max_examples=8 if cls.slow else 25, suppress_health_check=[HealthCheck.too_slow])
    @given(cls.strategy())
    def anywhere(experiment):
        keeps_its_traces(experiment)

    anywhere()


def keeps_its_traces(experiment: Experiment) -> None:
    result = experiment.run()
    types, names = usual(type(experiment))
    assert [trace["type"] for trace in experiment.figure(result)["data"]] == types
    metrics = experiment.metrics(result)
    assert metrics and [m.name for m in metrics] == names
    assert len({m.name for m in metrics}) == len(metrics)
    for m in metrics:
        if m.bound is not None and m.value is not None:
            assert m.value <= m.bound, f"{m.name}: {m.value} above its bound {m.bound}"
        assert m.value is not None or m.note or m.bound is None, f"{m.name}: no value and no note that says why"


def test_a_view_shows_the_same_result(cls):
    """What differs in views only has one result: shown in another way it gives what a fresh run gives."""
    views = [p.name for p in cls.parameters() if p.view]

    @settings(max_examples=3 if cls.slow else 8, suppress_health_check=[HealthCheck.too_slow])
    @given(cls.strategy(), cls.strategy())
    def another_view(experiment, other):
        seen = experiment.replace(**{name: getattr(other, name) for name in views})
        result = experiment.run()
        fresh = seen.run()
        assert seen.same_run(experiment)
        assert seen.metrics(result) == seen.metrics(fresh)
        assert text(seen.figure(result)) == text(seen.figure(fresh))

    if views:
        another_view()


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


def test_the_command_line_runs_it_and_says_the_same_numbers(cls, capsys):
    assert main(["run", cls.name(), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    experiment, result = start(cls)
    assert printed["parameters"] == experiment.model_dump()
    assert [m["name"] for m in printed["metrics"]] == [m.name for m in experiment.metrics(result)]
