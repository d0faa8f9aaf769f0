"""Chrome/Perfetto JSON, CSV and npz."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.trace import LogError, Trace, export_chrome, export_csv, export_npz, read_csv, read_log, read_npz
from labkit.trace.kinds import CODE, KINDS
from labkit.trace.trace import COLUMNS

LOGS = Path(__file__).parents[1] / "oracle" / "logs"
INT64 = st.integers(-(2**63), 2**63 - 1)


@st.composite
def traces(draw):
    names = draw(st.lists(st.text(min_size=1, max_size=8), unique=True, max_size=6))
    code = st.integers(-1, len(names) - 1)
    times = sorted(draw(st.lists(st.integers(-(2**60), 2**60), max_size=12)))
    rows = [(t, draw(st.integers(0, len(KINDS) - 1)), draw(code), draw(code), draw(INT64), draw(INT64)) for t in times]
    start, end = (times[0], times[-1]) if times else (0, 0)
    of = draw(st.one_of(st.just([]), st.lists(code, min_size=len(names), max_size=len(names))))
    trace = Trace.from_rows(
        rows, names, draw(st.integers(1, 10**12)), start=start, end=end, exception_of=of, closed=draw(st.booleans())
    )
    core = st.lists(st.integers(0, 3), min_size=len(rows), max_size=len(rows)).map(lambda made: np.array(made, dtype=np.int64))
    return replace(trace, core=draw(st.one_of(st.none(), core)))


def same(a, b):
    cores = a.core is b.core is None or np.array_equal(a.core, b.core)
    heads = [(t.names, t.hz, t.start, t.end, t.exception_of, t.closed) for t in (a, b)]
    return np.array_equal(a.rows(), b.rows()) and cores and heads[0] == heads[1]


@given(traces())
def test_csv_gives_the_identical_trace_back(trace):
    file = io.StringIO(newline="")
    export_csv(trace, file)
    assert same(read_csv(io.StringIO(file.getvalue(), newline="")), trace)


@given(traces())
def test_npz_gives_the_identical_trace_back(trace):
    file = io.BytesIO()
    export_npz(trace, file)
    with np.load(io.BytesIO(file.getvalue()), allow_pickle=False) as columns:
        assert np.array_equal(columns["time"], trace.time)
    assert same(read_npz(io.BytesIO(file.getvalue())), trace)


@given(st.binary(max_size=40), st.data())
def test_a_damaged_npz_is_refused_or_read_but_nothing_else_happens(noise, data):
    file = io.BytesIO()
    export_npz(Trace.from_rows([(i, 0, 0, -1, 0, 0) for i in range(30)], ["A"], 1, end=30), file)
    at = data.draw(st.integers(0, len(file.getvalue())))
    damaged = file.getvalue()[:at] + noise + file.getvalue()[at + len(noise) :]
    try:
        read_npz(io.BytesIO(damaged))
    except LogError as error:
        assert "\n" not in str(error)


def npz_of(**members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            with archive.open(f"{name}.npy", "w") as member:
                if isinstance(content, bytes):
                    member.write(content)
                else:
                    np.lib.format.write_array(member, content)
    return io.BytesIO(file.getvalue())


GOOD = {name: np.zeros(2, np.int64) for name in COLUMNS}
NPZ_HEAD = np.frombuffer(b'{"hz": 1, "start": 0, "end": 9, "names": ["A"]}', np.uint8)
ENDLESS = (
    b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<i8', 'fortran_order': False, 'shape': (1099511627776,), }".ljust(117) + b"\n"
)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({}, "not a trace as npz, which has a column head"),
        ({"head": NPZ_HEAD}, "which has a column time"),
        ({**GOOD, "head": NPZ_HEAD[1:]}, "its head must be JSON"),
        ({**GOOD, "head": NPZ_HEAD, "time": np.zeros(3, np.int64)}, "columns of different lengths, 2 to 3 events"),
        ({**GOOD, "head": NPZ_HEAD, "time": np.zeros(2)}, "time must be one row of int64"),
        ({**GOOD, "head": NPZ_HEAD, "time": np.array([object()])}, "time must be one row of int64"),
        ({**GOOD, "head": NPZ_HEAD, "time": ENDLESS}, "time must be one row of int64"),
        ({**GOOD, "head": NPZ_HEAD, "time": np.array([4, 3])}, "event 1 at time 3 comes after one at 4"),
        ({**GOOD, "head": NPZ_HEAD, "kind": np.array([0, 99])}, "event 1 has kind 99; 0 to"),
        ({**GOOD, "head": NPZ_HEAD, "task": np.array([1, 0])}, "event 0 has task 1; -1 to 0 are allowed"),
        ({**GOOD, "head": NPZ_HEAD, "core": np.array([0, -2])}, "event 1 is on core -2"),
    ],
)
def test_what_is_no_npz_of_a_trace_is_told_in_one_sentence(members, message):
    with pytest.raises(LogError, match=r"^[^\n]+$") as error:
        read_npz(npz_of(**members))
    assert message in str(error.value)


def test_a_name_that_csv_cannot_hold_is_refused_on_both_sides():
    with pytest.raises(ValueError, match="a name of 200000 characters"):
        export_csv(Trace.from_rows([], ["A" * 200_000], 1, end=0), io.StringIO())
    with pytest.raises(LogError, match="field larger than field limit"):
        read_csv(io.StringIO(HEAD + "1,switch," + "A" * 200_000 + ",,0,0\r\n", newline=""))
    file = io.BytesIO()
    long = Trace.from_rows([], ["A" * 200_000], 1, end=0)
    export_npz(long, file)
    assert same(read_npz(io.BytesIO(file.getvalue())), long)


def test_names_from_outside_reach_no_message_raw():
    with pytest.raises(LogError, match=r"^[^\n\r]+$"):
        read_csv(io.StringIO(HEAD + '1,"swi\r\ntch",A,,0,0\r\n', newline=""))


def test_csv_on_disk_is_readable_by_pandas_too(tmp_path):
    trace, _ = read_log("Tmr Svc 1 1\na,b 2 1\na,b 3 0\nTmr Svc 9 0\nü 9 1\nü 10 0\n")
    export_csv(trace, tmp_path / "t.csv")
    assert same(read_csv(tmp_path / "t.csv"), trace)
    frame = pd.read_csv(tmp_path / "t.csv", skiprows=1)
    assert list(frame.columns) == list(COLUMNS) and frame["task"].tolist()[:2] == ["Tmr Svc", "a,b"]


def test_names_that_cannot_stand_for_their_codes_are_refused():
    with pytest.raises(ValueError, match="names"):
        export_csv(Trace.from_rows([], ["A", "A"], 1, end=0), io.StringIO())


HEAD = '# {"hz": 1000, "start": 0, "end": 9, "names": ["A"]}\r\ntime,kind,task,other,value,extra\r\n'


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "line 1"),
        ("a 1 1\n", "line 1"),
        ('# {"hz": 0, "start": 0, "end": 0, "names": []}\n', "line 1"),
        (HEAD[:56], "line 2"),
        (HEAD + "1,begin,A,,0\n", "line 3"),
        (HEAD + "1,begin,B,,0,0\n", "line 3: 'B'"),
        (HEAD + "1,began,A,,0,0\n", "line 3: 'began'"),
        (HEAD + "1,begin,A,,0,x\n", "line 3"),
        (HEAD + "2,begin,A,,0,0\n1,end,A,,0,0\n", "order of time"),
        (HEAD + f"{10**30},begin,A,,0,0\n", "not a trace"),
    ],
)
def test_what_is_no_such_csv_is_one_clear_error(text, message):
    with pytest.raises(LogError, match=message):
        read_csv(io.StringIO(text, newline=""))
    with pytest.raises(LogError, match=r"no/such\.csv"):
        read_csv("no/such.csv")


@given(st.binary(max_size=120))
def test_any_bytes_after_the_head_are_read_or_refused(data):
    try:
        read_csv(io.TextIOWrapper(io.BytesIO(HEAD.encode() + data), encoding="utf-8", newline=""))
    except LogError as error:
        assert str(error)


def chrome(trace):
    file = io.StringIO()
    export_chrome(trace, file)
    return json.loads(file.getvalue())["traceEvents"]


def test_chrome_has_one_named_thread_per_name_and_one_event_per_span():
    trace, _ = read_log(LOGS / "xu2025_listing38_10000_5000hz.log")
    events = chrome(trace)
    thread = {e["tid"]: e["args"]["name"] for e in events if e["name"] == "thread_name"}
    assert sorted(thread.values()) == sorted(trace.names)
    wheel = [(e["ts"], e["dur"]) for e in events if e["ph"] == "X" and thread[e["tid"]] == "wheel_ctrl"]
    assert wheel == [(65, 11), (154, 10)]
    assert sum(e["ph"] == "X" for e in events) == 13


def test_chrome_times_are_microseconds_and_other_kinds_are_instants(tmp_path):
    rows = [(0, CODE["switch"], 0, -1, 3, -1), (216, CODE["take"], 0, 1, 1, 0), (432, CODE["switch"], 2, 0, 0, 1)]
    trace = Trace.from_rows(rows, ["A", "mutex", "IDLE"], 216_000_000, end=864)
    export_chrome(trace, tmp_path / "t.json")
    events = json.loads((tmp_path / "t.json").read_text())["traceEvents"]
    assert [(e["name"], e["ts"], e["dur"]) for e in events if e["ph"] == "X"] == [("A", 0, 2), ("IDLE", 2, 2)]
    [instant] = [e for e in events if e["ph"] == "i"]
    assert (instant["name"], instant["ts"], instant["tid"]) == ("take", 1, 1)
    assert instant["args"] == {"other": "mutex", "value": 1, "extra": 0, "order": [3]}


@given(traces())
def test_any_trace_makes_valid_json(trace):
    assert np.isfinite([e["ts"] for e in chrome(trace) if "ts" in e]).all()


def test_each_core_is_a_process_of_its_own():
    rows = [(0, "begin", 0), (1, "begin", 0), (2, "end", 0), (3, "end", 0)]
    trace = Trace.from_rows([(time, CODE[kind], name, -1, 0, 0) for time, kind, name in rows], ["f"], 1_000_000, end=3)
    file = io.StringIO()
    export_chrome(replace(trace, core=np.array([0, 1, 1, 0])), file)
    spans = [(e["pid"], e["ts"], e["dur"]) for e in json.loads(file.getvalue())["traceEvents"] if e["ph"] == "X"]
    assert spans == [(1, 0, 3), (2, 1, 1)]
