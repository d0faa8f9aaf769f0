"""The trace path: what is written arrives, what is lost is counted, and the link takes the time it takes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.robot import CPU_HZ, PERIODIC, OnBlocks, TracePath, build, published, robot, simulate
from labkit.robot.trace_path import lines
from labkit.trace import Trace, runs

MS = CPU_HZ // 1000

PATHS = st.builds(
    TracePath,
    baud=st.sampled_from([1200, 115_200, 2_000_000, 12_500_000]),
    form=st.sampled_from(["text", "record", "word"]),
    when_full=st.sampled_from(["wait", "drop"]),
    buffer=st.sampled_from([1, 20, 512]),
    capacity=st.sampled_from([512, 2048, 3000]),
    batch=st.sampled_from([1, 3, 8]),
    every=st.sampled_from([1, 10]),
    scopes=st.booleans(),
    clean=st.sampled_from([0, 40]),
)


def sink_of(name, path, milliseconds=60):
    board = build(replace(published(name), trace_path=path), OnBlocks())
    board.advance(milliseconds * MS)
    return board.sink, board.kernel.trace


@settings(max_examples=60)
@given(st.sampled_from(["50|30", "1000", "10000|5000"]), PATHS)
def test_the_ring_never_holds_more_than_fits_and_every_stamp_is_somewhere(name, path):
    sink, trace = sink_of(name, path)
    times, fills = sink.curve()
    assert fills.min() >= 0 and fills.max() <= path.capacity and (np.diff(times) >= 0).all()
    assert sink.fill == sink.written - sink.read == fills[-1]
    rounds, made = sink.table(), lines(trace, 0, path.form)
    noticed = int(rounds[:, 1:3].sum())  # taken over or lost in the buffer, up to the last round
    before = 2 * int((trace.of("switch") & (trace.time < rounds[-1, 0])).sum())
    assert noticed == before <= len(made)
    assert rounds[:, 1].max() <= path.buffer
    assert rounds[:, 3].sum() == 0 or path.when_full == "drop"
    sent = sink.transfers()
    assert sink.read <= sent[:, 2].sum() <= sink.written


@settings(max_examples=30)
@given(PATHS)
def test_a_transfer_takes_ten_bits_a_byte_and_they_do_not_overlap(path):
    sink, _ = sink_of("100|50", path)
    begin, end, size = sink.transfers().T
    assert (end - begin == -(-size * 10 * CPU_HZ // path.baud)).all()
    assert (begin[1:] >= end[:-1]).all()
    assert size.max(initial=1) <= path.capacity and size.min(initial=1) > 0


def test_a_transfer_is_preceded_by_the_cleaning_of_its_cache_lines():
    """A ring of 544 bytes: 17 lines of 32. Only the cleaning differs, so `tsink` takes so much longer by each line it touches."""
    path = TracePath(capacity=544, form="word", every=1, baud=12_500_000)
    plain, cleaned = (build(replace(published(), trace_path=replace(path, clean=clean)), OnBlocks()) for clean in (0, 40))
    for board in (plain, cleaned):
        board.advance(60 * MS)
    begin, _, size = cleaned.sink.transfers().T
    at = (np.cumsum(size) - size) % 544
    touched = (at + size - 1) // 32 - at // 32 + 1
    assert (at + size <= 544).all() and touched.max() > 1 and (touched > -(-size // 32)).any(), "some reach over a line"
    ready = tsink_begins(cleaned, begin)
    assert (begin - ready == path.look + 40 * touched).all()
    first, _, before = plain.sink.transfers().T
    assert (first - tsink_begins(plain, first) == path.look).all() and len(before) > 10


def tsink_begins(board, begin):
    """When `tsink` got the processor for each of these transfers, or was through with the one before."""
    trace = board.kernel.trace
    mine = trace.task == trace.code("tsink")
    return np.array([trace.time[mine & trace.of("switch", "notify_take") & (trace.time < at)][-1] for at in begin])


def test_room_comes_back_when_the_whole_transfer_is_over():
    sink, _ = sink_of("100|50", TracePath(baud=115_200))
    times, fills = sink.curve()
    back = times[1:][np.diff(fills) < 0]
    ends = sink.transfers()[:, 1]
    for at in back.tolist():
        assert 0 <= at - ends[ends <= at].max() < 5 * MS // 1000 + 650  # the interrupt, a switch, and on


def test_lines_are_as_long_as_their_text():
    rows = [(0, 0, 0, -1, 0, 0), (216 * 332, 0, 1, 0, 0, 0), (216 * 1_234_567, 0, 0, 1, 0, 0)]
    trace = Trace.from_rows(rows, ("IDLE", "hal_fetch"), CPU_HZ, end=216 * 2_000_000)
    text = ["IDLE 332 0\n", "hal_fetch 332 1\n", "hal_fetch 1234567 0\n", "IDLE 1234567 1\n"]
    assert lines(trace, 1, "text").tolist() == [len(line) for line in text]
    assert lines(trace, 0, "record").tolist() == [8] * 6 and lines(trace, 0, "word").tolist() == [4] * 6


def test_writing_several_at_a_time_gives_the_same_bytes_and_nearly_the_same_time():
    one, _ = sink_of("100|50", TracePath(baud=12_500_000, batch=1), 200)
    many, _ = sink_of("100|50", TracePath(baud=12_500_000, batch=16), 200)
    assert many.written == pytest.approx(one.written, rel=0.06)


def test_a_slow_link_loses_and_says_so_a_fast_one_does_not():
    lost = {baud: int(sink_of("1000", TracePath(baud=baud), 300)[0].table()[:, 2].sum()) for baud in (115_200, 12_500_000)}
    assert lost[12_500_000] == 0 < lost[115_200]


def test_dropping_keeps_profile_from_waiting():
    wait, _ = sink_of("10000|5000", TracePath(baud=115_200, batch=8))
    drop, _ = sink_of("10000|5000", TracePath(baud=115_200, batch=8, when_full="drop"))
    assert len(drop.table()) > len(wait.table()) and drop.table()[:, 3].sum() > 0


def jobs(trace, task):
    """Jobs of a periodic task that have begun and that have ended."""
    of = trace.task == trace.code(task)
    ended = int((trace.of("complete") & of).sum())
    return 1 + int((trace.of("release") & of).sum()), ended


@settings(max_examples=40)
@given(st.sampled_from(["50|30", "1000", "10000|5000"]), PATHS)
def test_every_stamp_of_a_scope_is_written_or_counted(name, path):
    sink, trace = sink_of(name, replace(path, scopes=True))
    made = sink.direct + sink.refused
    ended = sum(jobs(trace, task)[1] for task in PERIODIC)
    assert 2 * ended <= made <= 2 * ended + len(PERIODIC)  # of those that run, the first stamp may be there
    assert sink.refused == 0 or path.when_full == "drop"
    switches = int(trace.of("switch").sum())
    rounds = sink.table()
    assert sink.lost(switches) >= rounds[:, 2:].sum() + sink.refused
    assert sink.arrived() == rounds[:, 1].sum() + sink.direct


@pytest.mark.parametrize(("form", "size"), [("record", 8), ("word", 4), ("text", None)])
def test_a_scope_writes_its_own_bytes(form, size):
    """Stamps of switches do not mix in: `profile` comes at the start, and then in a minute."""
    sink, trace = sink_of("100|50", TracePath(form=form, scopes=True, every=60_000, baud=12_500_000), 95)
    first = int(sink.table()[0, 1])
    written = sink.written - int(lines(trace, 0, form)[:first].sum())
    ended = {task: jobs(trace, task)[1] for task in PERIODIC}
    assert ended == {"hal_fetch": 10, "wheel_ctrl": 10, "odometry": 5, "pose_ctrl": 5} and sink.direct == 60
    if size:
        assert written == 60 * size
    else:  # name, blank, blank, digit, line feed, and the microseconds: one digit at the start, then up to five
        least = sum(2 * many * (len(task) + 4) for task, many in ended.items())
        assert least + 60 * 4 <= written <= least + 60 * 5 + 2


def test_a_scope_costs_its_task_two_lines():
    """And with `profile` below the tasks nothing else: what a job takes is its work, two lines, two calls of the mutex."""
    path = TracePath(scopes=True, stamp=3000, form="word")
    firmware = published("100|50")
    cycles = {}
    for scopes in (False, True):
        board = build(replace(firmware, trace_path=replace(path, scopes=scopes)), OnBlocks())
        board.advance(95 * MS)
        trace = board.kernel.trace
        cycles[scopes] = {task: sum(end - start for start, end in ran(trace, task)) / jobs(trace, task)[1] for task in PERIODIC}
    for task in PERIODIC:
        assert cycles[False][task] == firmware.work[task] and cycles[True][task] == firmware.work[task] + 2 * 3000


def ran(trace, task):
    """When the task had the processor."""
    return [(start, end) for name, start, end in runs(trace).tolist() if name == trace.code(task)]


def test_a_full_ring_puts_the_observed_to_sleep_or_loses_its_stamps():
    done, refused = {}, {}
    for when_full in ("wait", "drop"):
        sink, trace = sink_of("1000", TracePath(baud=115_200, scopes=True, when_full=when_full, stamp=108), 200)
        done[when_full], refused[when_full] = jobs(trace, "wheel_ctrl")[1], sink.refused
    assert refused["wait"] == 0 < refused["drop"] and done["wait"] < 50 < 190 < done["drop"]


def test_the_hook_makes_each_switch_longer():
    def least_gap(trace):
        """Between the begin of a switch and the next: the switch, and the shortest thing that ran."""
        return int(np.diff(trace.time[trace.of("switch")]).min())

    boards = [build(replace(published(), trace_path=TracePath(hook=hook)), OnBlocks()) for hook in (0, 70)]
    for board in boards:
        board.advance(5 * MS)
    assert least_gap(boards[1].kernel.trace) == least_gap(boards[0].kernel.trace) + 70
    gaps = [least_gap(simulate(robot(trace_path=TracePath(hook=hook)), 0.05).trace) for hook in (0, 70)]
    assert gaps[1] == gaps[0] + 70


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"baud": 0}, "trace path: baud = 0 is not allowed; allowed is 1 or more"),
        ({"capacity": 100, "batch": 4}, "trace path: capacity = 100 is not allowed; allowed is 256 or more"),
        ({"buffer": 0}, "trace path: buffer = 0"),
        ({"every": 0}, "trace path: every = 0"),
        ({"form": "morse"}, "trace path: form 'morse'; there are text, record, word"),
        ({"when_full": "pray"}, "trace path: when_full 'pray'; there are wait, drop"),
    ],
)
def test_bad_parameters_are_refused_in_one_sentence(wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        TracePath(**wrong)
