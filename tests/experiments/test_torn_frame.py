"""Notebook 04: torn frames, and what keeps them whole."""

import pytest

from labkit.experiments.torn_frame import TornFrame, check_untorn
from labkit.sink import FRAME_BYTES


def torn(**changes):
    return TornFrame(**changes).values()["torn frames"]


def test_frames_are_torn_while_profile_prints():
    result = TornFrame().run()
    assert result.line.torn > 0
    trace = result.history.trace
    for read in result.line.reads:
        if read.newer:
            ready = (trace.task == trace.code("profile")) & trace.of("switch") & (trace.time <= read.at)
            assert read.wait > result.line.byte and trace.time[ready].max() > read.at - 10 * 216_000


@pytest.mark.parametrize("cure", [{"buffers": 2}, {"above": True}, {"delay": 0}])
def test_cures(cure):
    assert torn(**cure) == 0 < torn()


def test_more_frames_more_of_them_torn():
    few, many = TornFrame(frames=40).run().line, TornFrame(frames=400).run().line
    assert many.torn / len(many.reads) > few.torn / len(few.reads)


def test_the_worst_read_is_shown():
    experiment = TornFrame(frames=400)
    result = experiment.run()
    worst = result.worst
    assert worst.newer == max(read.newer for read in result.line.reads if read.reception.verdict == "crc")
    figure = experiment.figure(result)
    cells = [shape for shape in figure["layout"]["shapes"] if shape.get("fillcolor") == "#f6cdb4"]
    came = result.line.frames[worst.frame]
    assert len(cells) == sum(a != b for a, b in zip(came, worst.data, strict=True)) <= worst.newer < FRAME_BYTES
    assert len(figure["data"]) == len(TornFrame(above=True).figure(TornFrame(above=True).run())["data"])


def test_the_exercise_asks_the_model():
    assert check_untorn(TornFrame(above=True)).solved
    assert not check_untorn(TornFrame()).solved
    for easy in ({"buffers": 2}, {"delay": 0, "above": True}, {"caches": True}, {"frames": 20}):
        assert not check_untorn(TornFrame(**easy)).solved
