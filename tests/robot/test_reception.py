"""The velocity line: when a frame is complete, what a task that reads late gets, and what it does with it."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.robot import CPU_HZ, OnBlocks, VelocityLine, build, published
from labkit.sink import FRAME_BYTES, encode_frame

BYTE = CPU_HZ * 10 // 115_200
FRAME = FRAME_BYTES * BYTE
MS = CPU_HZ // 1000
FIRST, SECOND = (300.0, -100.0, 0.5), (250.0, 75.0, -0.25)


def line_with(gap, buffers=1):
    """Two frames on the line, the second so many cycles after the end of the first."""
    line = VelocityLine(CPU_HZ, buffers=buffers)
    line.send(0, FIRST)
    line.send(FRAME + gap, SECOND)
    return line


def test_a_frame_of_28_bytes_takes_280_bits():
    line = VelocityLine(CPU_HZ)
    assert line.byte == BYTE == 18_750 and line.send(1000, FIRST) == 1000 + FRAME
    assert line.send(1000, SECOND) == 1000 + 2 * FRAME  # it waits for the line


def test_read_in_time_it_is_what_was_sent():
    line = line_with(gap=500)
    assert line.read(FRAME) == FIRST and line.read(FRAME + 499 + BYTE) == FIRST
    assert line.read(2 * FRAME + 500) == SECOND and line.torn == 0
    assert [(read.frame, read.wait, read.newer) for read in line.reads] == [(0, 0, 0), (0, 499 + BYTE, 0), (1, 0, 0)]


@given(st.integers(0, FRAME_BYTES - 1), st.integers(0, BYTE - 1), st.integers(0, 3 * BYTE))
def test_read_late_it_has_the_head_of_the_next(newer, within, gap):
    line = line_with(gap)
    heard = line.read(FRAME + gap + newer * BYTE + within)
    first, second = (encode_frame(x / 1000, y / 1000, z) for x, y, z in (FIRST, SECOND))
    assert line.reads[0].data == second[:newer] + first[newer:] and line.reads[0].newer == newer
    assert heard == (FIRST if line.reads[0].data == first else None)
    assert line.torn == (line.reads[0].data != first)


@given(st.integers(FRAME, 3 * FRAME), st.integers(0, FRAME))
def test_two_buffers_are_never_torn(now, gap):
    line = line_with(gap, buffers=2)
    assert line.read(now) == (SECOND if now >= 2 * FRAME + gap else FIRST) and line.torn == 0


def test_the_same_velocity_again_cannot_be_torn():
    line = VelocityLine(CPU_HZ)
    line.send(0, FIRST)
    line.send(0, FIRST)
    assert line.read(FRAME + 5 * BYTE) == FIRST and line.reads[0].newer == 5


@pytest.mark.parametrize("buffers, newer, verdict", [(1, 8, "crc"), (2, 0, "ok")])
def test_a_late_task_reads_once_what_is_there_then(buffers, newer, verdict):
    """A job of hal_fetch takes 6 ms from 20 ms on. Of four frames in a row three are complete meanwhile: two are never read."""
    firmware = published("50|30", tracing=False, buffers=buffers, time_slicing=False)
    board = build(replace(firmware, work=firmware.work | {"hal_fetch": 6 * MS}), OnBlocks())
    board.advance(18 * MS)
    for velocity in (FIRST, SECOND, FIRST, SECOND):
        board.command(velocity)
    board.advance(27 * MS)
    [read] = board.line.reads
    assert read.frame == 2 and read.newer == newer and read.reception.verdict == verdict
    assert 26 * MS < read.at < 26.2 * MS and read.wait == read.at - 18 * MS - 3 * FRAME
    board.advance(30 * MS)
    assert [read.frame for read in board.line.reads] == [2, 3] and board.line.reads[1].newer == 0


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [({"baud": 0}, "the baud rate of the velocity line is 0"), ({"buffers": 3}, "the number of receive buffers is 3")],
)
def test_lines_that_are_none(wrong, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}; a whole number from 1 to"):
        VelocityLine(CPU_HZ, **wrong)
