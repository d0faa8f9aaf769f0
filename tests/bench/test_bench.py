"""The bench without a browser: real widgets, and what the page would get. What it shows always belongs together."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labkit.bench import Bench, explore
from labkit.bench import bench as module
from labkit.bench.controls import on_grid
from labkit.bench.plot import cards, pack
from labkit.experiment import Experiment, Metric, ParameterError
from labkit.experiments import OwnRecording, experiments
from tests.bench.toys import Rolling, SlowRolling


@pytest.fixture
def works(monkeypatch):
    """Slow runs wait here until the test lets them go on, in any order."""
    waiting = []
    monkeypatch.setattr(module, "beside", waiting.append)
    return waiting


def page_of(bench: Bench) -> list:
    """Open a page on the bench: everything it is sent from now on."""
    sent = []
    bench.plot.send = lambda content, buffers=(): sent.append((content, buffers))
    bench.plot._received(None, {"want": "state"}, ())
    return sent


def unpacked(value, buffers):
    if isinstance(value, dict) and "$array" in value:
        array = np.frombuffer(buffers[value["$array"]], value["dtype"]).reshape(value["shape"])
        return np.where(np.isnan(array), None, array).tolist()  # a gap, which equals itself
    if isinstance(value, dict):
        return {key: unpacked(each, buffers) for key, each in value.items()}
    return [unpacked(each, buffers) for each in value] if isinstance(value, list) else value


def as_sent(figure) -> tuple[str, list[bytes]]:
    """The figure as text and buffers, ready for the page, to be compared; in it not-a-number equals itself."""
    buffers = []
    text = json.dumps(pack(figure, buffers), allow_nan=False)
    return text, [bytes(buffer) for buffer in buffers]


def some_values(experiment: Experiment, name: str) -> tuple:
    """Two allowed values of a parameter at least."""
    p = next(p for p in experiment.parameters() if p.name == name)
    return p.choices or ((False, True) if p.type is bool else (p.type(p.low), p.type(p.high)))


class Fresh:
    """Results computed apart from any bench, each of them once."""

    def __init__(self, run: Callable[[Experiment], Any] = lambda experiment: experiment.run()):
        self._run, self._results = run, []

    def result(self, experiment: Experiment):
        for other, result in self._results:
            if experiment == other:
                return result
        self._results.append((experiment, self._run(experiment)))
        return self._results[-1][1]


def assert_belongs_together(bench: Bench, sent: list, apart: Fresh | None = None) -> None:
    """Parameters, figure, cards and code line shown equal a fresh computation, and so does what the page has."""
    experiment, apart = bench.experiment, apart or Fresh()
    result = apart.result(experiment)
    fresh = as_sent(experiment.figure(result))
    assert as_sent(bench.spec) == fresh
    assert bench.metrics == tuple(experiment.metrics(result))
    shown, buffers = next((each for each in reversed(sent) if each[0]["kind"] == "show"), (None, ()))
    assert (json.dumps(shown["figure"]), [bytes(buffer) for buffer in buffers]) == fresh
    assert shown["cards"] == cards(bench.metrics, experiment.headline) and shown["code"] == experiment.code()
    assert sent[-1][0]["status"]["error"] == bench.error
    idle = experiment.without_effect()
    assert [name for name, each in bench.controls.items() if each.disabled] == [n for n in bench.controls if n in idle]
    for name in idle:  # greyed is what changes nothing
        other = experiment.replace(**{name: next(v for v in some_values(experiment, name) if v != getattr(experiment, name))})
        assert as_sent(other.figure(apart.result(other))) == fresh and tuple(other.metrics(apart.result(other))) == bench.metrics
    if not bench.error and not bench.busy:  # then it is also what the controls ask for
        values = {p.name: on_grid(p, bench.controls[p.name].value) for p in experiment.parameters()}
        assert experiment == type(experiment)(**values)


def test_moving_a_control_shows_it():
    bench = explore(Rolling)
    sent = page_of(bench)
    bench.controls["speed"].value = 700
    assert bench.spec["data"][0]["y"][1] == 245.0
    assert bench.result == 245.0 and bench.experiment == Rolling(speed=700) and len(sent) == 2
    assert_belongs_together(bench, sent)


def test_a_move_is_one_message():
    bench = explore(Rolling)
    sent = page_of(bench)
    bench.set(speed=300, floor="wet", first=20)
    assert [content["kind"] for content, _ in sent] == ["show", "show"]


def test_a_view_never_simulates():
    bench = explore(Rolling)
    Rolling.runs.clear()
    bench.controls["first"].value = 40
    assert Rolling.runs == [] and bench.spec["layout"]["xaxis"]["range"] == [40, 100]
    assert bench.metrics[0].note == "seen from 40 on"
    bench.controls["grip"].value = 0.5
    assert Rolling.runs == [Rolling(grip=0.5, first=40)]


def test_a_float_slider_stays_on_its_grid():
    bench = explore(Rolling)
    bench.controls["grip"].value = 0.1 + 0.2 + 0.3 + 0.2
    assert bench.experiment == Rolling(grip=0.8)


def test_an_error_is_shown_and_the_bench_lives_on():
    bench = explore(Rolling, floor="wet")
    sent = page_of(bench)
    bench.controls["speed"].value = 900
    assert bench.error == "RuntimeError: the robot left the table" and bench.result == 250.0
    assert "in run" in sent[-1][0]["status"]["where"]
    bench.controls["first"].value = 20  # does not mend it
    assert bench.error and bench.experiment == Rolling(floor="wet")
    bench.controls["speed"].value = 100
    assert bench.error == "" and bench.experiment == Rolling(speed=100, floor="wet", first=20)
    assert_belongs_together(bench, sent)


def test_a_picture_that_fails_replaces_nothing():
    bench = explore(Rolling)
    sent = page_of(bench)
    bench.set(speed=300, first=13)
    assert bench.error == "LookupError: no picture for 13" and bench.experiment == Rolling() and bench.result == 125.0
    assert_belongs_together(bench, sent)


def test_a_first_run_that_fails_is_an_error_of_the_cell():
    with pytest.raises(RuntimeError, match="left the table"):
        explore(Rolling, floor="wet", speed=900)


def test_a_refused_text_is_said_and_kept_in_its_field():
    bench = explore(Rolling)
    sent = page_of(bench)
    bench.controls["note"].value = "queue"
    assert bench.error == "rolling: note = 'queue' is not allowed; allowed is text of at most 20 characters"
    assert bench.controls["note"].value == "queue" and bench.experiment == Rolling()
    bench.controls["speed"].value = 300  # the field is still wrong
    assert bench.error and bench.experiment == Rolling()
    bench.reset()
    assert bench.error == "" and bench.controls["note"].value == "" and bench.experiment == Rolling()
    assert_belongs_together(bench, sent)


def test_reset_goes_back_to_the_start_in_one_run():
    bench = explore(Rolling, speed=300)
    bench.set(speed=700, floor="wet")
    Rolling.runs.clear()
    bench.plot._received(None, {"reset": True}, ())
    assert Rolling.runs == [Rolling(speed=300)] and bench.experiment == Rolling(speed=300)


def test_set_refuses_and_moves_nothing():
    bench = explore(Rolling)
    with pytest.raises(ParameterError):
        bench.set(floor="wet", speed=5)
    assert bench.controls["floor"].value == "dry"


def test_a_click_sets_what_its_point_says():
    bench = explore(Rolling)
    bench.plot._received(None, {"click": [0, 1]}, ())
    assert bench.experiment == Rolling(speed=200, floor="wet") and bench.controls["speed"].value == 200
    bench.plot._received(None, {"click": [0, 2]}, ())
    assert "speed = 5 is not allowed" in bench.error
    bench.plot._received(None, {"click": [7, 0]}, ())
    assert bench.experiment == Rolling(speed=200, floor="wet")


def test_a_zoom_sets_the_parameters_of_the_axis_within_their_bounds():
    bench = explore(Rolling)
    bench.plot._received(None, {"range": [20.4, 61.7]}, ())
    assert bench.experiment == Rolling(first=20, last=62)
    bench.plot._received(None, {"range": [-50.0, 1000.0]}, ())
    assert bench.experiment == Rolling(first=0, last=100)
    bench.plot._received(None, {"range": [30, 40]}, ())
    bench.plot._received(None, {"range": None}, ())
    assert bench.experiment == Rolling()


def test_what_the_page_says_again_is_not_shown_again():
    """A slider in the page answers a new position by the same number, added up from its steps."""
    bench = explore(OwnRecording)
    sent = page_of(bench)
    bench.plot._received(None, {"range": [3331.204, 6662.401]}, ())
    assert len(sent) == 2 and (bench.experiment.start, bench.experiment.end) == (3331.2, 6662.4)
    bench.controls["start"].value = 3331.2000000000003
    bench.controls["end"].value = 6662.400000000001
    assert len(sent) == 2
    bench.controls["start"].value = 3331.21
    assert len(sent) == 3 and bench.experiment.start == 3331.21
    bench.plot._received(None, {"range": [3331.21, 6662.4]}, ())  # a zoom is answered, even by the same picture
    assert len(sent) == 4


def test_steps_go_through_what_plays_and_stop_at_its_ends():
    bench = explore(Rolling, last=98)
    sent = page_of(bench)
    for steps, last, ended in ((1, 99, False), (1, 100, True), (1, 100, True), (-1, 99, False), (0, 10, False)):
        bench.plot._received(None, {"step": steps}, ())
        assert bench.experiment == Rolling(last=last) and sent[-1][0]["ended"] is ended
    assert sent[-1][0]["plays"] == "last"


def test_a_control_without_effect_is_greyed_and_says_when_it_has_one():
    bench = explore(Rolling)
    sent = page_of(bench)
    assert sent[-1][0]["idle"] == {} and not bench.controls["grip"].disabled
    bench.controls["floor"].value = "wet"
    assert sent[-1][0]["idle"] == {"grip": "on a dry floor only"} and bench.controls["grip"].disabled
    assert_belongs_together(bench, sent)


def test_explore_takes_a_class_or_an_experiment_and_validates():
    assert explore(Rolling(speed=300), floor="wet").experiment == Rolling(speed=300, floor="wet")
    with pytest.raises(ParameterError, match="rolling has no parameter 'sped'"):
        explore(Rolling, sped=1)


def test_to_figure_is_plotly_s_own():
    figure = explore(Rolling).to_figure()
    assert list(figure.data[0].y) == [0.0, 125.0, 1.0]


# slow runs


def test_a_slow_run_does_not_block_and_is_superseded_by_a_newer_position(works):
    bench = explore(SlowRolling)
    assert bench.result is None and bench.busy and bench.metrics == () and bench.spec == {"data": [], "layout": {}}
    for speed in (100, 200, 300):
        bench.controls["speed"].value = speed
    assert len(works) == 4
    for work in reversed(works):
        work()
    assert bench.result == 45.0 and bench.experiment == SlowRolling(speed=300) and not bench.busy
    assert_belongs_together(bench, page_of(bench))


def test_a_refused_text_ends_the_run_under_way(works):
    bench = explore(SlowRolling)
    works.pop()()
    sent = page_of(bench)
    bench.controls["speed"].value = 300
    bench.controls["note"].value = "queue"
    works.pop()()
    assert "'queue' is not allowed" in bench.error and bench.experiment == SlowRolling()
    assert_belongs_together(bench, sent)


def test_another_view_while_a_run_is_under_way_awaits_the_same_run(works):
    bench = explore(SlowRolling)
    works.pop()()
    bench.controls["speed"].value = 300
    bench.controls["first"].value = 50
    assert len(works) == 1
    works.pop()()
    assert bench.experiment == SlowRolling(speed=300, first=50) and bench.spec["layout"]["xaxis"]["range"] == [50, 100]


def test_the_way_back_to_what_is_shown_needs_no_run(works):
    bench = explore(SlowRolling)
    works.pop()()
    bench.controls["speed"].value = 300
    bench.reset()
    assert not bench.busy
    works.pop()()
    assert bench.experiment == SlowRolling() and bench.result == 125.0 and works == []


def test_the_error_of_a_superseded_run_is_not_shown_and_a_failed_run_leaves_the_picture(works):
    bench = explore(SlowRolling)
    works.pop()()
    sent = page_of(bench)
    bench.set(speed=900, floor="wet")
    failing = works.pop()
    bench.controls["speed"].value = 300
    works.pop()()
    failing()
    assert bench.error == "" and bench.experiment == SlowRolling(speed=300, floor="wet")
    bench.controls["speed"].value = 900
    works.pop()()
    assert bench.error == "RuntimeError: the robot left the table" and bench.result == 90.0
    assert_belongs_together(bench, sent)


def test_threads_hand_in_what_they_made():
    bench = explore(SlowRolling)
    assert bench.wait(20) and bench.result == 125.0


# whatever happens, what is shown belongs together


def walk(cls, data, works, moves, apart):
    """A random walk: controls, clicks, zooms, refusals, resets, late results in any order."""
    bench = explore(cls(**{p.name: p.default for p in cls.parameters()}))
    while works:
        works.pop()()
    sent = page_of(bench)
    parameters, anywhere = {p.name: p for p in cls.parameters()}, cls.strategy()
    texts = [name for name, p in parameters.items() if p.type is str and not p.choices]
    for _ in range(moves):
        kind = data.draw(st.sampled_from(["move", "move", "move", "reset", "click", "zoom", "finish", "refuse"]))
        if kind == "move":
            name = data.draw(st.sampled_from(list(parameters)))
            bench.controls[name].value = getattr(data.draw(anywhere), name)
        elif kind == "reset":
            bench.plot._received(None, {"reset": True}, ())
        elif kind == "click":
            clickable = [(i, len(t["meta"]["set"])) for i, t in enumerate(bench.spec["data"]) if "set" in (t.get("meta") or {})]
            if clickable and clickable[0][1]:
                trace, points = clickable[0]
                bench.plot._received(None, {"click": [trace, data.draw(st.integers(0, points - 1))]}, ())
        elif kind == "zoom" and (bench.spec["layout"].get("meta") or {}).get("range"):
            edges = sorted(data.draw(st.tuples(st.floats(-1e3, 1e6), st.floats(-1e3, 1e6))))
            bench.plot._received(None, {"range": edges}, ())
        elif kind == "refuse" and texts:
            bench.controls[data.draw(st.sampled_from(texts))].value = "q" * 10_000
        elif kind == "finish" and works:
            works.pop(data.draw(st.integers(0, len(works) - 1)))()
        if bench.result is not None:
            assert_belongs_together(bench, sent, apart)
    while works:
        works.pop(0)()
    assert not bench.busy
    assert_belongs_together(bench, sent, apart)


QUIET = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]


@pytest.mark.parametrize("cls", [Rolling, SlowRolling])
@settings(max_examples=150, suppress_health_check=QUIET)
@given(data=st.data())
def test_random_walks_on_toys(cls, works, data):
    works.clear()
    walk(cls, data, works, 10, Fresh())


@pytest.mark.parametrize("cls", experiments().values(), ids=experiments().keys())
def test_random_walks_on_every_experiment(cls, works, monkeypatch):
    """Most walks come back to where they began: a bench runs each position once in all of them, and so does who checks it."""
    apart, on_benches = Fresh(cls.run), Fresh(cls.run)
    monkeypatch.setattr(cls, "run", lambda self: on_benches.result(self))

    @settings(max_examples=2 if cls.slow else 6, suppress_health_check=QUIET)
    @given(data=st.data())
    def anywhere(data):
        works.clear()
        walk(cls, data, works, 4, apart)

    anywhere()


# what travels to the page


def test_arrays_travel_as_buffers_and_what_json_cannot_say_as_none():
    figure = {
        "a": np.arange(3),
        "b": np.array([1 << 40, 0]),
        "c": np.array([True, False]),
        "d": np.ones((2, 3)),
        "e": np.array(["x", None], dtype=object),
        "f": float("nan"),
        "g": np.float64(2.5),
        "h": (np.int64(3), "text", None, float("inf")),
        "i": np.array([]),
    }
    buffers = []
    packed = pack(figure, buffers)
    json.dumps(packed, allow_nan=False)
    assert [packed[key]["dtype"] for key in "abcd"] == ["int32", "float64", "uint8", "float64"]
    assert packed["d"]["shape"] == [2, 3] and len(buffers) == 4
    back = unpacked(packed, buffers)
    assert back["a"] == [0, 1, 2] and back["b"] == [1 << 40, 0] and back["d"] == [[1.0] * 3] * 2
    assert back["e"] == ["x", None] and back["f"] is None and back["g"] == 2.5 and back["h"] == [3, "text", None, None]
    assert back["i"] == []


def test_cards_say_value_bound_and_published():
    (card,) = cards([Metric("a<b", 1234567, "ns", bound=2, published=3, good=np.bool_(False), note="why")])
    assert card == {
        "name": "a<b",
        "text": "1\u202f234\u202f567 ns",
        "beside": ["bound 2 ns", "published 3 ns"],
        "good": False,
        "note": "why",
        "headline": True,
    }


def test_three_cards_stand_above_unless_others_are_named():
    metrics = [Metric(name, 1) for name in "abcde"]
    assert [c["name"] for c in cards(metrics) if c["headline"]] == ["a", "b", "c"]
    assert [c["name"] for c in cards(metrics, ("e", "b")) if c["headline"]] == ["b", "e"]


def test_a_page_that_comes_later_gets_everything():
    bench = explore(Rolling)
    bench.controls["speed"].value = 700
    (shown,) = page_of(bench)
    assert shown[0]["code"] == "Rolling(speed=700)" and shown[0]["kind"] == "show"
    again = page_of(bench)
    assert len(again) == 1 and again[0][0] == shown[0]
