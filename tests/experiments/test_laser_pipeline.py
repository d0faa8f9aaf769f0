"""Notebook 11: one scan, circle fits, aborted stages, two views, and the exercises."""

import numpy as np
import pytest
from hypothesis import given, settings

from labkit.experiments.circle_fits import DISTANCES, CircleFits, seen
from labkit.experiments.laser_anytime import AnytimeStages, check_shortest_time
from labkit.experiments.laser_pipeline import LaserPipeline, check_fast_ball, check_rolling, speed_of
from labkit.experiments.laser_views import FusedViews, check_two_balls
from labkit.fusion import Element


def drawn(figure, name):
    """The points of the first trace of that name, without the gaps."""
    trace = next(trace for trace in figure["data"] if trace.get("name") == name)
    xy = np.stack([trace["x"], trace["y"]], axis=1)
    return xy[~np.isnan(xy[:, 0])]


def test_every_stage_shows_its_own_format():
    start = LaserPipeline()
    result = start.run()
    shown = {stage: start.replace(stage=stage).figure(result) for stage in ("points", "contours", "objects", "elements")}
    assert {stage: len(drawn(figure, "straight")) > 0 for stage, figure in shown.items()} == {
        "points": False,
        "contours": True,
        "objects": True,
        "elements": True,
    }
    assert (
        len(drawn(shown["contours"], "round")) < len(drawn(shown["objects"], "round")) == len(drawn(shown["elements"], "round"))
    )
    assert len(drawn(shown["elements"], "robot")) == 5 * 3 and not len(drawn(shown["objects"], "robot"))
    robots = drawn(shown["elements"], "robot")
    centres = robots.reshape(3, 5, 2)[:, :4].mean(axis=1)
    assert sorted(centres[:, 0].round(1).tolist()) == [2.6, 4.4, 6.0]
    corners = result.world.bodies[result.world.index("R2")].outline(0)
    assert all(np.hypot(*(robots - corner).T).min() < 0.05 for corner in corners)  # a square, turned as the robot is


def test_the_start_finds_everything_to_a_few_millimetres():
    values = LaserPipeline().values()
    assert values["ball off"] < 5 and (values["balls found"], values["robots found"]) == (1, 3)
    assert values["points"] == 361 and values["edge extraction"] < 4


def test_the_ball_in_the_right_panel_combs_with_its_speed():
    """Odd and even rotations are speed x 13.32 ms apart along the way of the ball, in cm."""
    apart = []
    for speed in (0.0, 2.0, 4.0):
        experiment = LaserPipeline(speed=speed, noise=0)
        figure = experiment.figure(experiment.run())
        x0, x1 = figure["layout"]["xaxis2"]["range"]
        y0, y1 = figure["layout"]["yaxis2"]["range"]
        nearest = []
        for name in ("odd rotations", "even rotations"):
            x, y = drawn(figure, name).T
            nearest.append(x[(x > x0) & (x < x1) & (y > y0) & (y < y1)].min())
        apart.append(nearest[1] - nearest[0])
    assert abs(apart[0]) < 1.1 and apart[1:] == pytest.approx([2.66, 5.33], abs=1.2)


def test_more_noise_loses_the_ball_and_splits_walls():
    calm, noisy = LaserPipeline().run().chain, LaserPipeline(noise=40).run()
    assert len(noisy.chain.contours.edges) > 2 * len(calm.contours.edges) and noisy.ball_error() is None
    wide = LaserPipeline(gap=40, split=30).run().chain
    assert len(wide.contours.edges) < len(calm.contours.edges)


def test_known_radius_beats_taubin_beats_kasa_at_every_distance():
    for noise in (5, 15):
        errors = CircleFits(noise=noise).run().errors
        assert all(a < b for a, b in zip(errors["known radius"], errors["Taubin"], strict=True))
        assert np.mean(errors["Taubin"]) < np.mean(errors["Kasa"])


def test_balls_that_are_seen_lie_on_their_circle():
    rng = np.random.default_rng(1)
    for distance in DISTANCES:
        for xy in seen(distance, 0.5, 0.0, rng):
            assert np.abs(np.hypot(*(xy - (distance, 0)).T) - 0.11).max() < 0.006  # rounded to 10 mm
            assert xy.shape[1] >= 4


def test_with_one_rotation_a_far_ball_has_too_few_points():
    errors = CircleFits(rotations=1).run().errors["known radius"]
    assert errors[0] is not None and errors[-1] is None


def test_more_time_is_worth_more():
    start = AnytimeStages(edges_time=0.0, arcs_time=0.0)
    assert start.measure("elements, aborted") == 0 and start.measure("contour time saved") == 100
    graded = [AnytimeStages(edges_time=ms, arcs_time=ms).measure("elements, aborted") for ms in (1.0, 2.0, 6.0)]
    assert graded[0] < 0.5 < 0.9 < graded[1] <= graded[2] == AnytimeStages().measure("elements, in full")
    third = AnytimeStages()
    assert third.measure("contour time saved") > 60 and third.measure("elements, aborted") > 0.9


def test_a_ball_that_touches_a_robot_needs_the_long_search():
    short, long = (AnytimeStages(touching=True, arcs_time=ms).measure("arcs at the abort") for ms in (3.0, 4.0))
    assert short == 0 and long > 0.8


def test_the_marks_stand_on_the_curves():
    experiment = AnytimeStages()
    result = experiment.run()
    marks = experiment.figure(result)["data"][-1]
    assert marks["x"] == [1.75, 1.0]
    assert marks["y"] == [result.curves["edges"].at(1.75e6), result.curves["arcs"].at(1e6)]
    assert result.curves["edges"].at(0) == 0


def test_incoherent_views_show_two_balls_coherent_ones_one():
    """Source 2, figure 42, at both levels."""
    for level in ("points", "elements"):
        result = FusedViews(level=level).run()
        assert (result.offset.balls(), result.together.balls()) == (2, 1)
        still = FusedViews(level=level, speed=0.0, offset=320).run()
        assert still.offset.balls() == 1


@settings(max_examples=10)
@given(FusedViews.strategy())
def test_both_together_know_at_least_as_much_border(experiment):
    a, b, both = experiment.replace(level="elements").run().together.border()
    assert both > max(a, b) - 0.05


def test_what_is_hidden_from_one_is_seen_by_the_other():
    values = FusedViews().values()
    assert values["seen by A"] < values["seen by one or both"] == 5


def test_exercises_ask_the_model():
    assert not check_fast_ball(LaserPipeline()).solved and not check_fast_ball(LaserPipeline(speed=3.0)).solved
    assert not check_fast_ball(None).solved and check_fast_ball(LaserPipeline(speed=3.0, rotations=1)).solved
    assert check_shortest_time(1.75).solved and not check_shortest_time(3.0).solved and not check_shortest_time("x").solved
    assert check_two_balls(1.75).solved and not check_two_balls(1.5).solved and not check_two_balls(None).solved
    assert check_rolling(0.32).solved and not check_rolling(0.5).solved and not check_rolling("x").solved


def test_speed_of_a_straight_way():
    way = [(t * 1_000_000_000, Element("ball", 1 + 3 * t, 2 - 4 * t, 0.22, 1.0)) for t in range(5)]
    assert speed_of(way) == pytest.approx(5)
