"""Every reader and every command, given damaged input: a clear error or a result, in bounded time and never a traceback.

`FUZZ_INPUTS` says how many pieces each of them gets, 2,000 if it is not set; they are the same in every run.
"""

import contextlib
import importlib.util
import io
import json
import os
import pickle
import random
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from labkit.__main__ import main, parser
from labkit.cache import read_references, read_trace
from labkit.data import example
from labkit.fusion import (
    GlobalNearest,
    JointCompatible,
    NearestFirst,
    points,
    read_measurements,
    read_scans,
    run_chain,
    track,
    write_estimates,
)
from labkit.kernel import Kernel, firmware, read_scenario, run_scenario, task_list, write_events, write_timeline
from labkit.outside import read_json
from labkit.phases import read_chain, windows
from labkit.scheduler import fitted, schedule, write_schedule
from labkit.sink import encode_frame, read_frames
from labkit.trace import Trace, export_chrome, export_csv, export_npz, read_csv, read_log, read_npz, read_recording, statistics

HERE = Path(__file__).parent
_spec = importlib.util.spec_from_file_location("damage", HERE / "damage.py")
damage = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(damage)

INPUTS = int(os.environ.get("FUZZ_INPUTS", 2000))
BATCH = 1000  # inputs of one test, so that a long run still stays below the time limit of a single test
BATCHES = range(-(-INPUTS // BATCH))

#: Seconds that one damaged input may take; all of them are small.
SECONDS = 20

ORACLE = HERE.parent / "oracle"
TASKS = {
    "tasks": [
        {"name": "a", "period": 5, "deadline": 5, "offset": 0, "times": [2, 3], "wcet": 3, "ecet": 1, "ep_wcet": 1},
        {"name": "b", "period": 7, "wcet": 3, "ecet": 2, "ep_wcet": 1},
    ]
}
CHAIN = (
    "phase,part,ecet_ns,wcet_ep_ns,wcet_ns\nIn,,4000000,100000,5000000\nFilter,arcs,30_000_000,200000,\nFilter,edges,4000000,0,\n"
)


class TooLong(BaseException):
    """Not an Exception, so that nothing that is tested can catch it."""


@contextlib.contextmanager
def limited(what: object) -> Iterator[None]:
    """Ends what takes longer than `SECONDS` with an error that shows where it was."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def over(*_):
        raise TooLong(f"more than {SECONDS} s for {what!r:.300}")

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def traces() -> list[Trace]:
    k = Kernel(cpu_hz=1000, tick_hz=1000)
    lock = k.mutex("lock")

    def body(os):
        for _ in range(3):
            yield os.take(lock)
            yield os.compute(2)
            yield os.give(lock)
            yield os.delay(3)

    k.task("A", body, 2, deadline=5)
    k.task("B", body, 1)
    return [k.run(30).trace, schedule(TASKS, "taft", 20)[1]]


def csv_traces() -> list[bytes]:
    made = []
    for trace in traces():
        file = io.StringIO(newline="")
        export_csv(trace, file)
        made.append(file.getvalue().encode())
    return made


def npz_traces() -> list[bytes]:
    made = []
    for trace in traces():
        file = io.BytesIO()
        export_npz(trace, file)
        made.append(file.getvalue())
    return made


def references() -> list[bytes]:
    made = []
    for save in (np.savez, np.savez_compressed):
        file = io.BytesIO()
        op, size = np.array([1, 2, 3, 2] * 5, np.uint8), np.array([4, 8, 1, 32] * 5, np.uint8)
        save(file, op=op, addr=np.arange(20, dtype=np.uint64) * 24, size=size)
        made.append(file.getvalue())
    return made


def read(folder: Path, *names: str, lines: int | None = None) -> list[bytes]:
    """The files, or so many lines of each: what is short is hit more often where it matters."""
    return [b"".join((folder / name).read_bytes().splitlines(keepends=True)[:lines]) for name in names]


def logs() -> list[bytes]:
    recorded = sorted((ORACLE / "logs").glob("*.log"))
    return [*(path.read_bytes() for path in recorded), b"a 1 1 0\nb 2 1 1\na 3.5 0 0\nb 9 0 1\n"]


def take_log(path):
    trace, report = read_log(path)
    return str(report), statistics(trace)


EXAMPLES = HERE.parents[1] / "data" / "examples"


def take_recording(path):
    """Whatever is read, every line or event of it is accounted for."""
    trace, report = read_recording(path)
    assert report.lines == report.stamps + report.skipped + report.rejected + report.comments + report.empty
    json.dumps(report.as_dict(), allow_nan=False)
    with contextlib.suppress(ValueError):
        json.dumps(fitted(trace), allow_nan=False)
    return str(report), statistics(trace)


def json_traces() -> list[bytes]:
    made = []
    for trace in traces():
        file = io.StringIO()
        export_chrome(trace, file)
        made.append(file.getvalue().encode())
    spans = [
        {"ph": ph, "pid": 1, "tid": i % 2, "name": "fg"[i % 3 == 0], "ts": 1.5 * i, "dur": 4} for i, ph in enumerate("XXBEXXBBEE")
    ]
    return [*made, json.dumps({"traceEvents": spans}).encode(), json.dumps(spans).encode()]


def take_scenario(path):
    run = run_scenario(read_scenario(path))
    write_events(run, io.StringIO())
    write_timeline(run, io.StringIO())


def take_services(path):
    """It runs, and becomes an application, or says why not."""
    scenario = read_scenario(path)
    firmware(scenario)
    run = run_scenario(scenario)
    write_events(run, io.StringIO())
    write_timeline(run, io.StringIO())
    task_list(run)


def take_tasks(path):
    for policy in ("rm", "taft"):
        verdict, trace = schedule(read_json(path), policy, 40)
        write_schedule(trace, io.StringIO())
        json.dumps(verdict)


def take_frames(path):
    """Every line has its verdict, and what is told of it is JSON."""
    found = read_frames(path)
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    assert len(found) == data.count(b"\n") + (not data.endswith(b"\n")) * bool(data)
    json.dumps([reception.as_dict() for reception in found], allow_nan=False)


chained: set[bytes] = set()


def take_scans(path):
    """Every scan can be worked on, and the report accounts for every line."""
    found, report = read_scans(path)
    assert report.lines == report.scans + report.other + report.empty + report.rejected and len(found) == report.scans
    for one in found[:2]:
        if (same := pickle.dumps(one)) not in chained:  # damage elsewhere leaves a scan as it was
            run_chain(points(one))
            chained.add(same)
    str(report)


FRAMES = "\n".join([encode_frame(1, -2, 0.5).hex(), encode_frame(0, 1e-300, 9).hex(" "), "00ff", ""]).encode()
SCENARIOS = ("02_inversion_mutex.json", "07e_send_front_order.json", "08c_notify_timeout_and_task_give.json")
SERVICES = (
    *("m09_mixed.json", "m05_mixed.json", "m06_mixed.json", "m15_mixed.json", "19b_critical_loses_ticks.json"),
    *("20j_pended_function_call.json", "22d_sync_rendezvous.json", "23d_delete_self_and_recreate.json", "25a_queue_set.json"),
    *("26b_send_blocks_for_all.json", "26c_message_buffer.json", "24f_last_wake_in_the_future.json"),
)
POSITIONS = b"t_s,x_m,y_m,station,size\n0,0.1,0.2,A,1\n0.16,0.15,0.2,B,1\n0.33,0.2,0.2,A,1\n0.33,4,-2,A,1\n-0.17,0.1,0.2,B,1\n"


def take_positions(path):
    """Whatever has been read can be followed, or is refused for its size or its numbers."""
    read = read_measurements(path, 0.05)
    for model, rule in (("cv", GlobalNearest()), ("ca", JointCompatible()), ("cp", NearestFirst())):
        write_estimates(track(read.measurements, model, 0.1, rule).rows(), io.StringIO())


READERS = {
    "log": (damage.damaged, logs, take_log),
    "ftrace": (damage.damaged, lambda: read(EXAMPLES, "linux_ftrace.txt", lines=60), take_recording),
    "btf": (damage.damaged, lambda: read(EXAMPLES, "board.btf", lines=80), take_recording),
    "json trace": (damage.damaged_json, json_traces, take_recording),
    "any trace": (
        damage.damaged,
        lambda: [
            *csv_traces(),
            *npz_traces(),
            *json_traces(),
            *read(EXAMPLES, "board.btf", "linux_ftrace.txt", "board.log", lines=80),
        ],
        take_recording,
    ),
    "csv trace": (damage.damaged, csv_traces, lambda path: statistics(read_csv(path))),
    "scenario": (damage.damaged_json, lambda: read(ORACLE / "freertos", *SCENARIOS), take_scenario),
    "services": (damage.damaged_json, lambda: read(ORACLE / "freertos2", *SERVICES), take_services),
    "tasks": (damage.damaged_json, lambda: [json.dumps(TASKS).encode()], take_tasks),
    "chain": (damage.damaged, lambda: [CHAIN.encode()], lambda path: windows(read_chain(path), 50_000_000)),
    "npz trace": (damage.damaged_npz, npz_traces, lambda path: statistics(read_npz(path))),
    "frames": (damage.damaged, lambda: [FRAMES], take_frames),
    "scans": (
        damage.damaged,
        lambda: [example(name).read_bytes()[:3000] for name in ("scans.csv", "scans_carmen.log")],
        take_scans,
    ),
    "positions": (damage.damaged, lambda: [POSITIONS], take_positions),
    "reference text": (damage.damaged, lambda: read(EXAMPLES, "sum_lackey.txt", "sum_dinero.din", lines=400), read_references),
    "references": (damage.damaged_npz, references, read_trace),
}


def renew(path: Path, data: bytes) -> None:
    """Writes a new file: some file systems wait for the disk when an old one is written over."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def intact(path: Path, data: bytes) -> bool:
    """Whether the file is as it was made: to read is a third of the work of making it anew."""
    try:
        return path.read_bytes() == data
    except OSError:
        return False


def sizes(batch: int) -> int:
    return min(BATCH, INPUTS - BATCH * batch)


@pytest.fixture(autouse=True)
def small_limits(monkeypatch):
    """What a valid input may cost is a matter of the limits, tested where they are; here they are small."""
    monkeypatch.setattr("labkit.kernel.scenario.play.MOST_EVENTS", 5000)
    monkeypatch.setattr("labkit.scheduler.taskfile.MOST_JOBS", 2000)


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("reader", READERS)
def test_a_reader_takes_damaged_input_or_says_what_is_wrong(reader, batch, tmp_path):
    make, samples, take = READERS[reader]
    rng, valid, path = random.Random(f"{reader} {batch}"), samples(), tmp_path / "input"
    taken = 0
    for data in (valid[0], *(make(rng, valid) for _ in range(sizes(batch)))):
        renew(path, data)
        with limited(data):
            try:
                take(path)
                taken += 1
            except (ValueError, OSError) as error:
                assert str(error).strip(), repr(error)
    assert taken, "not even the undamaged sample was taken"


COMMANDS = {
    "list": [["list"], ["list", "--json"], ["list", "alignment"]],
    "run": [
        ["run", "priority-inversion", "--set", "hold=8", "--set", "protocol=ceiling", "--json"],
        ["run", "alignment", "--set", "offset=3"],
    ],
    "trace": [
        ["trace", "board.log", "--json", "--export", "out.json"],
        ["trace", "board.log", "--clock-hz", "216000000"],
        ["trace", "linux.txt", "--fit", "fit.json", "--core", "0"],
    ],
    "replay": [["replay", "scenario.json", "--timeline", "t.csv", "--events", "e.csv"], ["replay", "scenario.json"]],
    "firmware": [["firmware", "scenario.json", "--out", "board", "--cpu-hz", "72000000", "--tick-hz", "500"]],
    "schedule": [["schedule", "tasks.json", "--policy", p, "--until", "35", "--trace", "out.csv"] for p in ("rm", "edf", "taft")],
    "cache": [
        ["cache", "data.npz", "--size", "4096", "--ways", "2", "--line", "16", "--policy", "plru", "--seed", "3", "--json"]
    ],
    "check-sink": [
        ["check-sink", "--variant", "published-first", "--producers", "1", "--capacity", "4", "--modulus", "8", "--json"],
        ["check-sink", "--variant", "sequence", "--messages", "1", "--bytes", "2", "--schedule", "lowest", "--budget", "300"],
    ],
    "frames": [["frames", "bursts.txt", "--json"], ["frames", "bursts.txt"]],
    "track": [
        ["track", "positions.csv", "--model", "cv", "--q", "0.1", "--sigma", "0.05", "--out", "estimates.csv", "--json"],
        ["track", "positions.csv", "--q", "1", "--sigma", "0.1", "--out", "e.csv", "--association", "source", "--a-max", "2"],
        ["track", "positions.csv", "--q", "1", "--sigma", "0.1", "--out", "e.csv", "--association", "joint", "--gate", "0.9"],
    ],
    "windows": [["windows", "chain.csv", "--period-ns", "50000000", "--reserve-ns", "2000000", "--json"]],
}


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_line_runs_or_says_what_is_wrong(command, batch, tmp_path, monkeypatch):
    rng = random.Random(f"{command} {batch}")
    files = {
        "board.log": (ORACLE / "logs" / "xu2025_listing37_5000_2000hz.log").read_bytes(),
        "linux.txt": read(EXAMPLES, "linux_ftrace.txt", lines=40)[0],
        "scenario.json": (ORACLE / "freertos" / SCENARIOS[0]).read_bytes(),
        "tasks.json": json.dumps(TASKS).encode(),
        "data.npz": references()[0],
        "chain.csv": CHAIN.encode(),
        "bursts.txt": FRAMES,
        "positions.csv": POSITIONS,
    }
    ended = {0: 0, 1: 0, 2: 0}
    monkeypatch.chdir(tmp_path)
    commands = parser()
    monkeypatch.setattr("labkit.__main__.parser", lambda: commands)  # making it is most of the time
    for arguments in (COMMANDS[command][0], *(damage.damaged_arguments(rng, COMMANDS[command]) for _ in range(sizes(batch)))):
        for name, data in files.items():
            if not intact(Path(name), data):  # a damaged command may have written over it
                renew(Path(name), data)
        with limited(arguments), monkeypatch.context() as streams:
            streams.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding=rng.choice(("utf-8", "cp1252", "ascii"))))
            streams.setattr(sys, "stderr", io.StringIO())
            try:
                code = main(arguments)
            except SystemExit as end:
                code = end.code
            said = sys.stderr.getvalue()
        ended[code] += 1
        assert code != 1 or (said.count("\n") == 1 and said.startswith(f"labkit {arguments[0]}: ")), said
    assert ended[0] and ended[2] and (ended[1] or command == "list"), f"codes and how often they came: {ended}"
