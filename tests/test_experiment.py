"""The contract: what follows from one declaration."""

from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Interval, MaxLen, MultipleOf, Unit
from hypothesis import given
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric, ParameterError, View


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


def test_replace_is_the_way_to_a_neighbour_and_validates():
    assert Braking(speed=300).replace(loaded=True) == Braking(speed=300, loaded=True)
    with pytest.raises(ParameterError, match="speed = 5 is not allowed"):
        Braking().replace(speed=5)


def test_pydantic_s_own_ways_are_guarded():
    with pytest.raises(ParameterError, match="speed = 5 is not allowed"):
        Braking().model_copy(update={"speed": 5})
    with pytest.raises(ParameterError, match="braking has no parameter 'sped'"):
        Braking.model_validate({"sped": 100})
    assert Braking().model_copy(update={"speed": 300}) == Braking.model_validate({"speed": 300}) == Braking(speed=300)


def test_values_are_all_metrics_by_name():
    assert Braking().values() == {"distance": 125.0}


def test_a_view_changes_only_how_a_result_is_shown():
    class Shown(Braking):
        """Seen at a time."""

        at: Annotated[int, Interval(ge=0, le=9), Doc("cursor"), View()] = 0

    assert [p.name for p in Shown.parameters() if p.view] == ["at"]
    assert Shown(at=3).same_run(Shown(at=5)) and not Shown(at=3).same_run(Shown(at=3, speed=300))
    assert not Shown().same_run(Braking())


def test_feedback_is_text_wherever_it_goes():
    page = Feedback(False, "<b>7</b> & less")._repr_html_()
    assert "&lt;b&gt;7&lt;/b&gt; &amp; less" in page
