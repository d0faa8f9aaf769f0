"""The start and stop button: what it records, bouncing contacts, the zero point."""

from dataclasses import replace

import numpy as np
import pytest

from labkit.robot import CPU_HZ, DEBOUNCE, OnBlocks, build, published
from labkit.robot.button import Button
from labkit.robot.trace_path import lines

MS = CPU_HZ // 1000
BOUNCES = (0, MS // 3, 2 * MS, 5 * MS)


def board_with(debounce=DEBOUNCE, **path):
    firmware = published("100|50")
    path = {"baud": 12_500_000, **path}
    return build(replace(firmware, debounce=debounce, trace_path=replace(firmware.trace_path, **path)), OnBlocks())


def pressed(board, *at):
    """The board after presses, whose contacts bounce, at these times in ms, and 20 ms more."""
    for when in at:
        board.advance(when * MS)
        board.press(BOUNCES)
    board.advance((at[-1] + 20) * MS if at else 50 * MS)
    return board


def test_nothing_is_recorded_before_the_first_press():
    board = pressed(board_with(scopes=True))
    assert board.sink.written == board.sink.arrived() == 0 and board.button.zero is None


def test_a_press_starts_and_the_next_one_stops_however_the_contact_bounces():
    board = pressed(board_with(), 20, 150, 300)
    assert board.button.edges == 3 * len(BOUNCES) and np.allclose(np.array(board.button.taken) / MS, [20, 150, 300], atol=0.01)
    rounds = board.sink.table()

    def within(low, high):
        return rounds[(rounds[:, 0] > low * MS) & (rounds[:, 0] <= high * MS), 1].sum()

    assert within(0, 20) == 0 and within(160, 300) == 0
    switches = board.kernel.trace.time[board.kernel.trace.of("switch")]
    taken = board.button.taken
    assert within(20, 165) == 2 * np.count_nonzero((switches >= taken[0]) & (switches < taken[1])) > 100
    assert within(300, 320) > 0


def test_without_debouncing_an_even_number_of_bounces_is_no_press_at_all():
    deaf, quick = pressed(board_with(50), 20), pressed(board_with(0), 20)
    assert deaf.button.on(deaf.kernel.now) and not quick.button.on(quick.kernel.now)
    assert len(quick.button.taken) == len(BOUNCES) and quick.sink.written < deaf.sink.written


def test_the_deaf_time_is_100_ms_in_the_text_and_50_in_the_branch():
    for debounce, count in ((100, 1), (50, 2)):
        assert len(pressed(board_with(debounce), 10, 70).button.taken) == count
    button = Button(1000, 50)
    for now in (0, 49, 50, 60, 99, 100):
        button.edge(now)
    assert button.taken == [0, 50, 100] and button.edges == 6


@pytest.mark.parametrize("scopes", [False, True])
def test_times_count_from_the_first_stamp(scopes):
    board = pressed(board_with(scopes=scopes), 20)
    trace, zero = board.kernel.trace, board.button.zero
    first = trace.of("switch") & (trace.time >= board.button.taken[0])
    assert zero == trace.time[first][0] > 20 * MS
    size = lines(trace, 0, "text", board.button)
    names = [trace.names[trace.other[first][0]], trace.names[trace.task[first][0]]]
    assert size[:2].tolist() == [len(f"{name} 0 1\n") for name in names]
    assert len(size) == 2 * first.sum() and size.sum() < lines(trace, 0, "text")[-len(size) :].sum()


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="there is no button"):
        build(published(), OnBlocks()).press()
    with pytest.raises(ValueError, match="debounce time of the button is -1"):
        board_with(-1)
