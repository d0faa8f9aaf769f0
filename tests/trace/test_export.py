"""Chrome/Perfetto JSON and CSV."""

import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.trace import LogError, Trace, export_chrome, export_csv, read_csv, read_log
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
    return Trace.from_rows(rows, names, draw(st.integers(1, 10**12)), start=start, end=end)


def same(a, b):
    return (a.rows() == b.rows()).all() and (a.names, a.hz, a.start, a.end) == (b.names, b.hz, b.start, b.end)


@given(traces())
def test_csv_gives_the_identical_trace_back(trace):
    file = io.StringIO(newline="")
    export_csv(trace, file)
    assert same(read_csv(io.StringIO(file.getvalue(), newline="")), trace)


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
    assert instant["args"] == {"other": "mutex", "value": 1, "extra": 0}


@given(traces())
def test_any_trace_makes_valid_json(trace):
    assert np.isfinite([e["ts"] for e in chrome(trace) if "ts" in e]).all()
