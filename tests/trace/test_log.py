"""The reader of `<name> <microseconds> <0|1>` logs: published excerpts, every kind of damage, and fuzzing."""

import io
import tracemalloc
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from labkit.trace import LogError, describe, read_log, spans, statistics
from labkit.trace.readers import log, stamps
from labkit.trace.readers import report as report_
from labkit.trace.readers import source as source_
from labkit.trace.readers.report import Problems
from labkit.trace.readers.stamps import Reading

LOGS = Path(__file__).parents[1] / "oracle" / "logs"


def events(trace):
    """(name, time, begin) per event, in the trace's order."""
    frame = trace.frame()
    return list(zip(frame["task"], frame["time"].tolist(), frame["kind"] == "begin"))


def problems(report):
    return [(p.line, p.action) for p in report.problems]


def accounts_for_every_line(report):
    return report.lines == report.stamps + report.rejected + report.comments + report.empty


# Published excerpts


def test_listing_33_is_sorted_by_time_and_says_which_lines_moved():
    trace, report = read_log(LOGS / "xu2025_listing33_unordered.log")
    assert trace.time.tolist() == [1, 2, 28, 29, 332, 333, 336, 7413, 7504, 7951, 7969]
    assert report.moved == (7, 8, 9, 10, 11)
    assert problems(report) == [(1, "repaired")]  # the recording starts inside a run of IDLE
    assert trace.hz == 1_000_000 and (trace.start, trace.end) == (1, 7969)
    durations = spans(trace).set_index("name")["duration"]
    assert durations["w_ctrl"] == 91 and durations["odom"] == 18


def test_listing_34_is_in_order_and_needs_no_sorting():
    trace, report = read_log(LOGS / "xu2025_listing34_ordered.log")
    assert report.moved == () and report.stamps == 13
    assert spans(trace).groupby("name")["duration"].sum().to_dict() == {
        "IDLE": 527 + 42,
        "odom": 81,
        "profile": 26,
        "tsink": 3,
        "uros": 62,
    }


def test_listing_37_is_cut_at_both_ends():
    trace, report = read_log(LOGS / "xu2025_listing37_5000_2000hz.log")
    assert problems(report) == [(1, "repaired"), (18, "repaired"), (19, "repaired")]
    frame = spans(trace)
    assert frame[~frame["complete"]]["name"].tolist() == ["IDLE", "wheel_ctrl", "odometry"]
    assert frame[frame["complete"] & (frame["name"] == "wheel_ctrl")]["duration"].tolist() == [10]


def test_listing_38_needs_no_repair_and_never_nests():
    trace, report = read_log(LOGS / "xu2025_listing38_10000_5000hz.log")
    assert report.problems == () and report.stamps == report.lines == 26
    frame = spans(trace)
    assert frame[frame["name"] == "wheel_ctrl"]["duration"].tolist() == [11, 10]
    assert frame["depth"].max() == 0 and (frame["self"] == frame["duration"]).all()


def test_run_time_statistics_printed_on_the_same_link_are_no_stamps():
    log = (LOGS / "xu2025_listing38_10000_5000hz.log").read_text()
    summary = (LOGS / "xu2025_listing36_summary.txt").read_text()
    alone, _ = read_log(log)
    both, report = read_log(log + summary)
    assert events(both) == events(alone)
    assert report.rejected == summary.count("\n")
    assert any("task list" in p.what for p in report.problems)  # `tsink B 32 483 1` has the form of a stamp


# Ways to hand in a log


def test_path_file_text_and_bytes_give_the_same_trace():
    path = LOGS / "xu2025_listing33_unordered.log"
    want = events(read_log(path)[0])
    with path.open("rb") as binary, path.open() as text:
        for source in (str(path), path.read_text(), path.read_bytes(), binary, text, io.StringIO(path.read_text())):
            assert events(read_log(source)[0]) == want


def test_one_line_of_text_is_a_log_and_not_a_path():
    assert len(read_log("a 1 1\na 2 0")[0]) == 2
    assert len(read_log("Tmr Svc 1 1")[0]) == 1


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_windows_line_ends_and_encodings(encoding):
    trace, report = read_log("a 1 1\r\nTmr Svc 2 1\r\nTmr Svc 3 0\r\na 4 0\r\n".encode(encoding))
    assert trace.names == ("a", "Tmr Svc") and report.problems == () and len(trace) == 4


# Lines


def test_names_are_parsed_from_the_right():
    trace, _ = read_log("Tmr Svc 1 1\nTmr Svc 2 0\n  a 1 b\t3   1 \na 1 b 4 0\n")
    assert trace.names == ("Tmr Svc", "a 1 b")


def test_empty_lines_and_comments_are_counted():
    trace, report = read_log("# board 7\n\na 1 1\n   \n// note 5 1\na 2 0\n")
    assert (report.comments, report.empty, report.stamps, report.rejected) == (2, 2, 2, 0)
    assert report.problems == () and len(trace) == 2


@pytest.mark.parametrize(
    "line",
    ["a 1 2", "a -1 1", "a 1e3 1", "a 1", "1 1", "a x 1", "a 1. 1", "a 1,5 1", "a ٣ 1", f"a {'9' * 5000} 1", "\x00b 5 1", "a b"],
)
def test_a_line_that_is_no_stamp_is_rejected_by_number(line):
    trace, report = read_log(f"ok 1 1\n{line}\nok 2 0\n")
    assert problems(report) == [(2, "rejected")] and len(trace) == 2
    assert accounts_for_every_line(report)
    assert "line 2:" in str(report)


def test_last_line_cut_in_the_middle_is_rejected():
    _, report = read_log("a 1 1\na 2 0\na 12")
    assert problems(report) == [(3, "rejected")]


def test_bytes_that_are_not_utf8_are_shown_and_reported():
    trace, report = read_log(b"w\xff 1 1\nw\xff 2 0\n")
    assert trace.names == ("w\ufffd",) and problems(report) == [(1, "repaired"), (2, "repaired")]


def test_fractions_of_a_microsecond_make_a_trace_in_nanoseconds():
    trace, _ = read_log("a 1.5 1\na 2 0\nb 2.0019 1\nb 3 0\n")
    assert trace.hz == 1_000_000_000 and trace.time.tolist() == [1500, 2000, 2001, 3000]
    assert read_log("a 1.000 1\na 2 0\n")[0].hz == 1_000_000


# Pairs


def test_a_lost_end_and_a_lost_begin_in_the_middle_are_rejected():
    trace, report = read_log("a 1 1\na 2 1\na 3 0\nb 4 1\nb 5 0\nb 6 0\n")
    assert problems(report) == [(1, "rejected"), (6, "rejected")]
    assert events(trace) == [("a", 2, True), ("a", 3, False), ("b", 4, True), ("b", 5, False)]
    assert (trace.start, trace.end) == (1, 6)  # observed, though rejected


def test_what_is_cut_by_the_edges_is_kept_and_marked():
    trace, report = read_log("a 5 0\nb 6 1\nc 7 1\nc 8 0\nb2 8 1\n")
    assert problems(report) == [(1, "repaired"), (2, "repaired"), (5, "repaired")]
    rows = spans(trace)[["name", "start", "end", "complete", "depth"]].values.tolist()
    assert rows == [["a", 5, 5, False, 0], ["b", 6, 8, False, 0], ["c", 7, 8, True, 1], ["b2", 8, 8, False, 1]]


def test_at_one_instant_ends_come_first_then_empty_spans_then_the_longest_begin():
    text = "new 5 1\nouter 5 1\nblink 5 1\nblink 5 0\ninner 5 0\nold 5 0\ninner 2 1\nold 1 1\nnew 7 0\nouter 9 0\n"
    trace, _ = read_log(text)
    assert events(trace) == [
        ("old", 1, True),
        ("inner", 2, True),
        ("inner", 5, False),
        ("old", 5, False),
        ("blink", 5, True),
        ("blink", 5, False),
        ("outer", 5, True),
        ("new", 5, True),
        ("new", 7, False),
        ("outer", 9, False),
    ]
    frame = trace.frame("begin").set_index("task")
    assert frame["other"].to_dict() == {"old": None, "inner": "old", "blink": None, "outer": None, "new": "outer"}


# The 32-bit counter


def wrapped(us, clock=216_000_000):
    """What a 32-bit counter makes of a true time in us."""
    return us * clock // 1_000_000 % 2**32 * 1_000_000 // clock


def test_counter_at_216_MHz_wraps_after_19_884_s_even_out_of_order():
    true = [19_884_000, 19_884_050, 19_884_200, 19_884_300, 39_768_300, 39_768_310]  # switches of `t` are printed late
    order = [0, 2, 1, 3, 4, 5]
    lines = [f"{'s' if i in (2, 3) else 't'} {wrapped(true[i])} {1 - i % 2}" for i in order]
    lines.insert(4, "\n".join(f"idle {wrapped(t)} {b}" for t in range(19_884_400, 39_768_000, 5_000_000) for b in (1, 0)))
    trace, report = read_log("\n".join(lines), clock_hz=216e6)
    assert report.wraps == 2 and report.rejected == 0
    got = trace.time[[name != "idle" for name, *_ in events(trace)]]
    assert np.abs(got - true).max() <= 1
    assert [p.line for p in report.problems] == [2, 13] and "19.884 s" in str(report)


def test_without_the_clock_a_wrap_is_pointed_out():
    trace, report = read_log("a 19884000 1\na 19884100 0\nb 5 1\nb 9 0\n")
    assert trace.time[0] == 5 and "clock_hz" in str(report)


def test_a_single_damaged_stamp_shifts_nothing_after_it():
    trace, report = read_log("a 19000000 1\na 100 0\nb 200 1\nb 15000000 0\na 300 1\na 400 0\n", clock_hz=216e6)
    assert report.wraps == 1 and trace.time[-2:].tolist() == [19_884_408, 19_884_508]


def test_a_long_pause_before_the_first_wrap_is_no_line_from_before_it():
    trace, report = read_log("a 100 1\na 15000000 0\na 15000100 1\na 300 0\n", clock_hz=216e6)
    assert trace.time.tolist() == [100, 15_000_000, 15_000_100, 19_884_408] and report.wraps == 1


def test_a_stamp_beyond_the_counter_is_rejected():
    _, report = read_log("a 1 1\na 2 0\na 19884110 1\n", clock_hz=216e6)
    assert problems(report) == [(3, "rejected")]


@given(
    steps=st.lists(st.integers(1, 1_500_000), min_size=2, max_size=60),
    late=st.lists(st.integers(0, 3), min_size=60, max_size=60),
    clock=st.sampled_from([216_000_000, 480_000_000, 168_000_000]),
)
def test_unwrapping_gives_the_true_times_back(steps, late, clock):
    true = np.cumsum(steps)
    order = sorted(range(len(true)), key=lambda i: (i + late[i], i))
    first = min(range(len(order)), key=lambda k: order[k])
    order.insert(0, order.pop(first))  # the first stamp is the zero point of the counter
    true = true - true[0]
    assume(np.abs(np.diff(true[order])).max() < 2**31 * 1_000_000 // clock - 1)  # half a turn: what the reader promises
    text = "\n".join(f"t{i} {wrapped(int(true[i]), clock)} 1\nt{i} {wrapped(int(true[i]), clock)} 0" for i in order)
    trace, report = read_log(text, clock_hz=clock)
    assert np.abs(trace.time - np.repeat(true, 2)).max() <= 1
    assert report.wraps == int(true[-1]) * clock // 1_000_000 // 2**32


# Errors


@pytest.mark.parametrize(
    "source, message",
    [
        ("no/such.log", "no/such.log"),
        ("", "no line"),
        ("\n\n", "no line"),
        (b"\x00\x01\x02" * 50, "no line"),
        (3, "not int"),
        ("a b c\nd\n", "line 1"),
        (Path(__file__).parent, "cannot be read"),
    ],
)
def test_what_is_no_log_is_one_clear_error(source, message):
    with pytest.raises(LogError, match=message):
        read_log(source)


@pytest.mark.parametrize("clock", [0, -1, float("nan"), float("inf"), "fast", 5])
def test_an_impossible_clock_is_an_error(clock):
    with pytest.raises(LogError, match="clock_hz"):
        read_log("a 1 1\na 2 0\n", clock_hz=clock)


def check(source, clock=None):
    """Whatever comes in: a LogError, or a trace in order whose report accounts for every line."""
    try:
        trace, report = read_log(source, clock_hz=clock)
    except LogError as error:
        assert str(error)
        return
    assert accounts_for_every_line(report)
    assert len(trace) == report.stamps
    assert (np.diff(trace.time) >= 0).all() and trace.start <= trace.time[0] and trace.time[-1] <= trace.end
    frame = spans(trace)
    assert (frame["complete"] * 2 + ~frame["complete"]).sum() == len(trace)  # every row is in exactly one span
    assert (frame["self"] >= 0).all() and frame["self"].sum() <= trace.end - trace.start
    assert (frame["self"] <= frame["duration"]).all()
    assert str(report) and report.as_dict()["lines"] == report.lines


@given(st.binary(max_size=300), st.sampled_from([None, 216e6]))
@example(b"\xff\xfe", None)
@example(b"\xef\xbb\xbf", None)
def test_any_bytes(data, clock):
    check(data, clock)


@given(st.text(max_size=200))
def test_any_text(text):
    check(text)


NAMES = st.sampled_from(["IDLE", "Tmr Svc", "a", "b", "tsink"])
LINES = st.builds("{} {} {}".format, NAMES, st.integers(0, 40), st.integers(0, 1))


@given(st.lists(LINES, min_size=1, max_size=60), st.sampled_from([None, 216e6]))
def test_any_stamps(lines, clock):
    check("\n".join(lines) + "\n", clock)


@settings(max_examples=150)
@given(st.data())
def test_a_published_log_with_any_edits(data):
    lines = (LOGS / "xu2025_listing38_10000_5000hz.log").read_bytes().split(b"\n")
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(lines) - 1))
        edit = data.draw(st.sampled_from(["drop", "double", "swap", "cut", "junk", "join"]))
        if edit == "drop" and len(lines) > 1:
            del lines[at]
        elif edit == "double":
            lines.insert(at, lines[at])
        elif edit == "swap":
            lines[at], lines[at - 1] = lines[at - 1], lines[at]
        elif edit == "cut":
            lines[at] = lines[at][: data.draw(st.integers(0, 10))]
        elif edit == "junk":
            lines.insert(at, data.draw(st.binary(max_size=20)))
        elif at + 1 < len(lines):
            lines[at] += lines.pop(at + 1)
    check(b"\n".join(lines), data.draw(st.sampled_from([None, 216e6])))


# Several cores


CORES = "f 0 1 0\ng 2 1 1\ng 6 0 1\nf 7 1 1\nf 9 0 1\nf 10 0 0\n"


def test_a_fourth_field_is_the_core_and_spans_of_two_cores_do_not_nest():
    trace, report = read_log(CORES)
    assert trace.core.tolist() == [0, 1, 1, 1, 1, 0] and report.cores == 2 and "2 cores" in str(report)
    assert trace.frame("begin")["other"].tolist() == [None, None, None] and not report.problems
    assert spans(trace)["self"].tolist() == [10, 4, 2]


def test_spans_of_one_core_nest_and_a_begin_and_an_end_on_different_cores_are_no_span():
    trace, report = read_log("f 0 1 3\ng 2 1 3\ng 6 0 3\nf 7 0 3\nh 8 1 3\nh 9 0 2\n")
    assert trace.frame("begin")["other"].tolist() == [None, "f", None]
    assert problems(report) == [(5, "repaired"), (6, "repaired")]


def test_in_a_log_of_several_cores_a_stamp_without_one_is_rejected():
    _, report = read_log(CORES + "f 11 1\nf 12 1 x\nf 13 1 1000\nf 14 1 12\nf 15 0 12\n")
    assert problems(report) == [(7, "rejected"), (8, "rejected"), (9, "rejected")] and report.cores == 3
    assert "<core>" in report.problems[0].what


def test_one_damaged_line_does_not_make_cores():
    trace, report = read_log("a 1 1\na 2 0\nb 3 1 0\nb 4 0\na 5 1\na 6 0\n")
    assert trace.core is None and report.cores == 1 and len(trace) == 6


# Size


def test_a_block_read_at_once_and_line_by_line_is_the_same():
    for text in ("a 1 1\nb 2 1\nb 3 0", CORES.rstrip("\n"), "ä 999 1\nb 2 0"):
        lines = text.split("\n")
        readings = [Reading(stamps.LONGEST, "", Problems(), several=text.startswith("f")) for _ in range(2)]
        quick, careful = stamps._quickly(lines, readings[0]), stamps._carefully(lines, readings[1])
        assert [column.tolist() for column in quick.columns()] == [column.tolist() for column in careful.columns()]
        assert readings[0] == readings[1]


BLOCKS = st.lists(
    st.sampled_from(["a 1 1", "b 2 0", "a  3 1", "# a 1", "", "a 1 2", " a 1 1", "x\t1 1", "\u0663 1 1", "a \u0663 1"])
)


@given(BLOCKS.filter(len))
def test_whatever_is_read_at_once_is_read_as_line_by_line(lines):
    readings = [Reading(stamps.LONGEST, "", Problems()) for _ in range(2)]
    quick, careful = stamps._quickly(lines, readings[0]), stamps._carefully(lines, readings[1])
    if quick is not None:
        assert [column.tolist() for column in quick.columns()] == [column.tolist() for column in careful.columns()]
        assert readings[0].names == readings[1].names and not readings[1].problems.kept
    else:
        assert lines != ["a 1 1"]


def test_a_log_in_many_blocks_is_the_log_in_one(monkeypatch):
    text = "".join(f"n{i % 7} {i} {i // 7 % 2}\r\n" for i in range(700)) + "end 999 1"
    whole = read_log(text)
    monkeypatch.setattr(source_, "BLOCK", 50)
    for source in (text, text.encode(), text.encode("utf-16")):
        trace, report = read_log(source)
        assert (trace.rows() == whole[0].rows()).all() and report == whole[1]


def test_a_log_beyond_the_limits_is_told(monkeypatch):
    monkeypatch.setattr(source_, "MOST_BYTES", 3 << 20)
    with pytest.raises(LogError, match=r"^text: longer than 3 MiB, the most that is read; cut the recording into pieces$"):
        read_log(b"a 1 1\na 2 0\n" * 300_000)
    monkeypatch.setattr(stamps, "MOST_NAMES", 3)
    with pytest.raises(LogError, match="'n3' is name number 4; a log has at most 3"):
        read_log("".join(f"n{i} 1 1\n" for i in range(9)))


def test_endless_problems_are_counted_and_the_first_are_told(monkeypatch):
    monkeypatch.setattr(log, "MOST_TOLD", 5)
    monkeypatch.setattr(report_, "MOST_TOLD", 5)
    _, report = read_log("a 1 1\n" + "junk\n" * 30 + "b 2 1\n" * 30 + "a 1 1\n" * 20)
    assert (report.rejected, report.moved_lines) == (30 + 30 - 1 + 20, 20) and accounts_for_every_line(report)
    assert report.moved == (62, 63, 64, 65, 66) and len(report.problems) <= 15


def test_a_large_log_takes_a_few_times_its_size(monkeypatch):
    monkeypatch.setattr(source_, "BLOCK", 1 << 16)
    text = "".join(f"task{i % 6} {i * 7} 1\ntask{i % 6} {i * 7 + 5} 0\n" for i in range(60_000)).encode()
    tracemalloc.start()
    try:
        trace, _ = read_log(BytesIO(text))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(trace) == 120_000 and peak < 9 * len(text)  # with lists of Python numbers it were 26 times


def test_names_of_files_reach_no_line_raw(tmp_path):
    path = tmp_path / "a\r\nb.log"
    path.write_text("a 1 1\na 2 0\n")
    assert "\r" not in str(read_log(path)[1]) and "\n" not in read_log(path)[1].source
    with pytest.raises(LogError, match=r"^[^\n\r]+$"):
        read_log(str(tmp_path / "no\rsuch.log"))


# Names that are none

RING = "".join(f"IDLE {t} 1\nIDLE {t + 5} 0\nodom {t + 5} 1\nodom {t + 9} 0\n" for t in range(0, 300, 10))


@pytest.mark.parametrize(
    "line",
    [
        "IDLE 101 1odom 105 1",  # a line end lost
        "IDLE 101 1 odom 105 1",  # a blank in its place
        "IDLE 10.5 0odom 105 1",
        "IDLE 101odom 105 1",  # more than the line end
        "IDLEodom 105 1",
        "IDodom 105 1",
        "IDLEom 105 1",
        "IDLE 101om 105 1",
        "IDLE 101 1IDLE 105 1",
        "IDLEIDLE 105 0",
        "\x01\x02\x7f 105 1",
        "IDLE\x00 105 1",
    ],
)
def test_a_glued_or_binary_line_is_no_task(line):
    trace, report = read_log(RING + line + "\nIDLE 310 1\nIDLE 312 0\n")
    assert trace.names == ("IDLE", "odom") and report.rejected == 1 and report.problems[0].line == 121
    assert accounts_for_every_line(report)


@pytest.mark.parametrize(
    "line", ["IDLE 30 1odom 35 1", "x 30 1y 35 1", "IDLE 30 1 odom 35 1", "IDLE 30odom 35 1", "IDLEodom 35 1"]
)
def test_a_glued_line_of_a_short_log_is_no_task(line):
    trace, report = read_log(f"IDLE 0 1\nIDLE 10 0\n{line}\nodom 20 1\nodom 25 0\n")
    assert trace.names == ("IDLE", "odom") and [problem.line for problem in report.problems] == [3]


@pytest.mark.parametrize("name", ["odom2", "odom 1", "motor 1 0", "IDLE 1 of 2", "w_odom", "odometry"])
def test_a_name_that_a_short_log_has_once_is_a_task(name):
    trace, report = read_log(f"IDLE 0 1\nIDLE 10 0\nodom 20 1\nodom 25 0\n{name} 35 1\n")
    assert name in trace.names and report.rejected == 0


def test_bytes_that_are_no_text_are_no_task_unless_they_are_one_all_along():
    trace, report = read_log(RING.encode() + b"\xff\xfe\x80 105 1\n")
    assert trace.names == ("IDLE", "odom") and (report.rejected, report.problems[-1].line) == (1, 121)
    trace, report = read_log(RING.encode() + b"Z\xe4hler 105 1\nZ\xe4hler 106 0\n")
    assert trace.names == ("IDLE", "odom", "Z\ufffdhler") and report.rejected == 0


@pytest.mark.parametrize("name", ["odom2", "Task 1", "odom 1", "IDLE 1 of 2", "w_odom", "ID", "motor 1 0", "a 1 b", "odometry"])
def test_a_rare_name_that_is_like_others_is_a_task(name):
    trace, report = read_log(RING + f"{name} 105 1\n{name} 106 0\n")
    assert name in trace.names and report.rejected == 0


def test_a_lost_stamp_is_flagged_where_it_would_make_a_jitter():
    text = "".join(f"a {100 * i} 1\na {100 * i + 50} 0\n" for i in range(20))
    assert statistics(read_log(text)[0]).loc["a", ["jitter", "gaps"]].tolist() == [0, 0]
    trace, report = read_log(text.replace("a 700 1\n", ""))
    table = statistics(trace)
    assert table.loc["a", ["jitter", "gaps"]].tolist() == [100, 1] and report.rejected == 1
    assert "one lost stamp makes it a whole period" in describe(table)
    two, _ = read_log(text.replace("a 700 1\n", "").replace("a 800 0\n", ""))
    assert statistics(two).loc["a", "gaps"] == 1  # 700 and 800 are gone: one gap of three periods


def test_irregular_intervals_are_no_gaps():
    times = np.cumsum(np.random.default_rng(1).exponential(100, 500)).astype(int) + np.arange(500)
    trace, _ = read_log("".join(f"a {t} 1\na {t} 0\n" for t in times.tolist()))
    assert statistics(trace).loc["a", "gaps"] == 0
