"""What holds for every experiment at every position of its sliders."""

import json

import plotly.graph_objects as go
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labkit.__main__ import main
from labkit.experiments import experiments

EXPERIMENTS = experiments()


@pytest.fixture(scope="module", params=EXPERIMENTS.values(), ids=EXPERIMENTS.keys())
def cls(request):
    return request.param


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_no_slider_position_crashes_and_the_figure_keeps_its_traces(cls, data):
    experiment = data.draw(cls.strategy())
    result = experiment.run()
    figure = experiment.figure(result)
    start = cls()
    expected = [trace["type"] for trace in start.figure(start.run())["data"]]
    assert [trace["type"] for trace in figure["data"]] == expected
    metrics = experiment.metrics(result)
    assert metrics and len({m.name for m in metrics}) == len(metrics)
    for m in metrics:
        if m.bound is not None and m.value is not None:
            assert m.value <= m.bound, f"{m.name}: {m.value} above its bound {m.bound}"


def test_plotly_accepts_the_whole_figure(cls):
    experiment = cls()
    go.Figure(experiment.figure(experiment.run()))


def test_a_run_is_pure(cls):
    def numbers():
        experiment = cls()
        return experiment.metrics(experiment.run())

    assert numbers() == numbers()


def test_the_command_line_runs_it_and_says_the_same_numbers(cls, capsys):
    assert main(["run", cls.name(), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    experiment = cls()
    assert printed["parameters"] == experiment.model_dump()
    assert [m["name"] for m in printed["metrics"]] == [m.name for m in experiment.metrics(experiment.run())]
