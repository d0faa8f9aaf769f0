"""The contract: what follows from one declaration."""

import threading
from typing import Annotated, ClassVar, Literal

import numpy as np
import pytest
from annotated_types import Interval, MaxLen, MultipleOf, Unit
from hypothesis import given
from typing_extensions import Doc

from labkit.bench.bench import changes, explore, metrics_html, predict
from labkit.experiment import Experiment, Metric, ParameterError, progress


class Braking(Experiment):
    """How far does the robot roll on?

    More text.
    """

    speed: Annotated[int, Interval(ge=100, le=900), MultipleOf(50), Unit("mm/s"), Doc("speed when the brake comes")] = 500
    grip: Annotated[float, Interval(ge=0.5, le=1.5), Doc("1 is dry floor")] = 1.0
    floor: Annotated[Literal["dry", "wet"], Doc("surface")] = "dry"
    loaded: Annotated[bool, Doc("carries a box")] = False
    note: Annotated[str, MaxLen(20), Doc("remark")] = ""

    def run(self):
        if self.speed == 900 and self.floor == "wet":
            raise RuntimeError("the robot left the table")
        return self.speed**2 / 2000 / self.grip * (2 if self.floor == "wet" else 1)

    def figure(self, result):
        return {
            "data": [{"type": "bar", "x": np.arange(3), "y": np.array([0.0, result, 1.0]), "marker": {"color": ["#000000"] * 3}}],
            "layout": {
                "xaxis": {"range": [0, result]},
                "shapes": [{"type": "line", "x0": 0, "x1": 1, "y0": 0, "y1": 1}] * (self.speed // 300),
            },
        }

    def metrics(self, result):
        return [Metric("distance", result, "mm", published=125, good=result < 200, note="until it stands")]


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"speed": 99}, "braking: speed = 99 is not allowed; allowed is a whole number, 100 to 900 mm/s in steps of 50"),
        ({"speed": 101}, "braking: speed = 101 is not allowed; allowed is a whole number, 100 to 900 mm/s in steps of 50"),
        ({"floor": "ice"}, "braking: floor = 'ice' is not allowed; allowed is one of dry, wet"),
        ({"grip": float("nan")}, "braking: grip = nan is not allowed; allowed is 0.5 to 1.5"),
        ({"loaded": "maybe"}, "braking: loaded = 'maybe' is not allowed; allowed is true or false"),
        ({"note": "x" * 21}, "braking: note = 'xxxxxxxxxxxxxxxxxxxxx' is not allowed; allowed is text of at most 20 characters"),
        ({"sped": 100}, "braking has no parameter 'sped'; it has speed, grip, floor, loaded, note"),
    ],
)
def test_a_wrong_value_is_one_sentence_that_names_field_bound_and_unit(values, sentence):
    with pytest.raises(ParameterError) as error:
        Braking(**values)
    assert str(error.value) == sentence


def test_name_title_and_code():
    assert (Braking.name(), Braking.title()) == ("braking", "How far does the robot roll on?")
    assert Braking(speed=600, loaded=True).code() == "Braking(speed=600, loaded=True)"
    assert eval(Braking(speed=600, grip=0.7).code(), {"Braking": Braking}) == Braking(speed=600, grip=0.7)


def test_an_experiment_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        Braking().speed = 200


@given(Braking.strategy())
def test_the_strategy_draws_allowed_experiments_only(experiment):
    assert Braking(**experiment.model_dump()) == experiment


def test_measure_names_the_metrics_there_are():
    assert Braking().measure("distance") == 125.0
    with pytest.raises(ParameterError, match="braking has no metric 'height'; it has distance"):
        Braking().measure("height")


def test_a_parameter_without_bounds_or_words_is_a_fault_of_the_author():
    class Unbounded(Experiment):
        x: Annotated[int, Doc("x")] = 1

    class Silent(Experiment):
        x: Annotated[int, Interval(ge=0, le=1)] = 1

    with pytest.raises(TypeError, match="parameter x has no bounds"):
        Unbounded.parameters()
    with pytest.raises(TypeError, match="parameter x has no Doc"):
        Silent.parameters()


# the bench: real widgets, no browser


def button(bench, css):
    return next(b for box in bench.children for b in getattr(box, "children", ()) if css in b._dom_classes)


def test_moving_a_slider_updates_the_same_figure():
    bench = explore(Braking)
    figure, trace = bench.figure, bench.figure.data[0]
    bench.controls["speed"].value = 700
    assert bench.figure is figure and figure.data[0] is trace
    assert trace.y[1] == 245.0 and figure.layout.xaxis.range == (0, 245.0) and len(figure.layout.shapes) == 2
    assert "245" in bench._metrics.value and "Braking(speed=700)" in bench._code.value


def test_an_error_is_shown_and_the_bench_lives_on():
    bench = explore(Braking, floor="wet")
    bench.controls["speed"].value = 900
    assert "the robot left the table" in bench._error.value and bench.result == 250.0
    bench.controls["speed"].value = 100
    assert bench._error.value == "" and bench.result == 10.0


def test_a_first_run_that_fails_is_an_error_of_the_cell():
    with pytest.raises(RuntimeError, match="left the table"):
        explore(Braking, floor="wet", speed=900)


def test_reset_goes_back_to_the_start_in_one_run(monkeypatch):
    bench = explore(Braking, speed=300)
    bench.set(speed=700, floor="wet", loaded=True)
    runs = []
    monkeypatch.setattr(Braking, "run", lambda self: runs.append(self) or 1.0)
    button(bench, "lab-reset").click()
    assert runs == [Braking(speed=300)] and bench.experiment == Braking(speed=300)


def test_set_refuses_and_moves_nothing():
    bench = explore(Braking)
    with pytest.raises(ParameterError):
        bench.set(loaded=True, speed=5)
    assert bench.controls["loaded"].value is False


def test_lecture_mode_enlarges_figure_and_controls():
    bench = explore(Braking)
    size = bench.figure.layout.font.size
    switch = button(bench, "lab-lecture-switch")
    switch.value = True
    assert bench.figure.layout.font.size > size and "lab-lecture" in bench._dom_classes
    switch.value = False
    assert bench.figure.layout.font.size == size and "lab-lecture" not in bench._dom_classes


class Slow(Braking):
    """Slow."""

    slow: ClassVar[bool] = True
    gate: ClassVar[threading.Event] = threading.Event()
    finished: ClassVar[list] = []

    def run(self):
        for _ in progress(range(3)):
            assert self.gate.wait(10)
        self.finished.append(self.speed)
        return float(self.speed)


def test_a_slow_run_does_not_block_and_is_superseded_by_a_newer_slider_position():
    bench = explore(Slow)
    assert bench.result is None
    for speed in (100, 200, 300):
        bench.controls["speed"].value = speed
    Slow.gate.set()
    for thread in [t for t in threading.enumerate() if t is not threading.current_thread() and t.daemon]:
        thread.join(10)
    assert bench.result == 300.0 and Slow.finished == [300]


class Stumbling(Braking):
    """Fails slowly at its first speed only."""

    slow: ClassVar[bool] = True
    gate: ClassVar[threading.Event] = threading.Event()

    def run(self):
        if self.speed == 500:
            assert self.gate.wait(10)
            raise RuntimeError("nobody waits for this any more")
        return float(self.speed)


def test_the_error_of_a_superseded_run_is_not_shown():
    others = set(threading.enumerate())
    bench = explore(Stumbling)
    (first,) = set(threading.enumerate()) - others
    bench.controls["speed"].value = 300
    for newer in set(threading.enumerate()) - others - {first}:
        newer.join(20)
    assert bench.result == 300.0
    Stumbling.gate.set()
    first.join(20)
    assert bench.result == 300.0 and bench._error.value == ""


def test_changes_are_only_what_differs():
    old = {"x": np.array([1, 2]), "marker": {"color": ["a"], "size": 3}, "name": "n"}
    new = {"x": np.array([1, 2]), "marker": {"color": ["b"]}, "name": "n"}
    assert list(changes(old, new)) == [("marker_color", ["b"]), ("marker_size", None)]


def test_metrics_are_escaped_and_show_the_published_value():
    page = metrics_html([Metric("a<b", 1234567, "ns", published=3, good=False)])
    assert "a&lt;b" in page and "1\u202f234\u202f567 ns" in page and "published 3 ns" in page and "lab-bad" in page


def ask(box, guess):
    entry, answer = box.children[1].children[0], box.children[2]
    entry.value = guess
    next(c for c in box.children[1].children if "lab-predict-reveal" in c._dom_classes).click()
    return answer.value


def test_predict_answers_only_when_asked_and_compares():
    box = predict("How far?", Braking(), "distance")
    assert box.children[2].value == ""
    assert "You said <b>100 mm</b>" in ask(box, "100") and "The model says <b>125 mm</b>" in ask(box, "100")
    assert "#009E73" in ask(box, "124") and "#009E73" not in ask(box, "100")
    assert "Write a number" in ask(box, "far") and "You said" not in ask(box, "")


def test_predict_names_the_metrics_there_are():
    with pytest.raises(ParameterError, match="braking has no metric 'height'; it has distance"):
        predict("How high?", Braking(), "height")
