"""Notebook 13: levels of fusion, one fast object, and the exercises."""

import pytest

from labkit.experiments import FusionLevels, OneFastObject, check_ghost, check_split, check_threshold
from labkit.fusion import LEVELS


def trace(figure, name):
    return next(trace for trace in figure["data"] if trace.get("name") == name)


def test_the_bench_begins_with_a_ghost_that_only_elements_show():
    team = FusionLevels().run()
    ghosts = {level: len(verdict.ghosts) for level, verdict in team.verdicts.items()}
    assert ghosts == {"points": 0, "contours": 0, "objects": 0, "elements": 2}
    for level in LEVELS:
        figure = FusionLevels(level=level).figure(team)
        assert len(trace(figure, "ghost")["x"]) == ghosts[level]
        bars = [trace for trace in figure["data"] if trace["type"] == "bar"]
        assert [bar["x"][0] for bar in bars] == [
            722,
            pytest.approx(team.fusions["points"].station_ns / 1e6),
            pytest.approx(100 * team.verdicts["points"].ospa),
        ]
        assert all(bar["meta"]["set"] == [{"level": name} for name in LEVELS] for bar in bars)


def test_a_look_takes_place_when_it_is_said():
    team = FusionLevels(stations=3, offset=40).run()
    times = [points.time_ns for points in team.points]
    assert times[1] - times[0] == times[2] - times[1] == 40_000_000


def test_a_station_that_is_wrong_about_its_place_moves_all_it_sees():
    right, wrong = (FusionLevels(pose_error=error).run().points[0] for error in (0, 50))
    moved = (wrong.xy - right.xy).std(axis=0)
    assert moved.max() < 1e-9 and abs(wrong.xy - right.xy).max() > 0.005


@pytest.mark.parametrize(("speed", "offset", "balls"), [(2.0, 160, 2), (2.0, 0, 1), (0.0, 320, 1)])
def test_one_ball_is_two_only_if_it_moves_between_the_looks(speed, offset, balls):
    said = OneFastObject(speed=speed, offset=offset).values()
    for level in ("points", "contours"):
        assert (said[f"{level}, B later"], said[f"{level}, at once"]) == (balls, 1)


@pytest.mark.parametrize(
    ("check", "answer", "words"),
    [
        (check_split, "140", "is no number of milliseconds"),
        (check_split, True, "is no number of milliseconds"),
        (check_split, 160, "not the least one"),
        (check_ghost, 3, "a bench's position"),
        (check_ghost, FusionLevels(stations=4, seed=8), "two stations"),
        (check_ghost, FusionLevels(), "find another one"),
        (check_threshold, None, "is no number of milliseconds"),
        (check_threshold, 100, "look for the least one"),
    ],
)
def test_wrong_answers_get_a_sentence(check, answer, words):
    said = check(answer)
    assert not said.solved and words in said.text
