"""The command line: same models, same numbers, one sentence for every mistake."""

import csv
import importlib.metadata
import io
import json
import os
import pathlib
import re
import subprocess
import sys

import pytest

from labkit.__main__ import main, parser
from labkit.trace import read_npz

ORACLE = pathlib.Path(__file__).parent / "oracle" / "freertos"
LOG = str(pathlib.Path(__file__).parents[1] / "data" / "examples" / "board.log")


def test_list_names_every_experiment_with_its_parameters(capsys):
    assert main(["list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["priority-inversion"]["parameters"]["hold"]["allowed"] == "a whole number, 1 to 15 ms"
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(listed) and "hold" not in lines[1]
    assert main(["list", "priority-inversion"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("priority-inversion ") and "hold = 6" in told and "1 to 15 ms" in told
    assert main(["list", "priority-inversion", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == ["priority-inversion"]
    assert main(["list", "priority-conversion"]) == 1
    assert "there is no experiment 'priority-conversion'" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough_is_no_error():
    command = subprocess.Popen([sys.executable, "-m", "labkit", "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    command.stdout.close()
    assert command.stderr.read() == b"" and command.wait(60) == 0


def test_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"labkit {importlib.metadata.version('labkit')}\n"


def test_help_states_the_limits_that_hold():
    from labkit.cache import references
    from labkit.cache.references import text
    from labkit.fusion import tracks
    from labkit.kernel.scenario import play, read
    from labkit.outside import MOST_BYTES
    from labkit.phases import chainfile
    from labkit.scheduler import taskfile
    from labkit.trace.readers import chrome, source

    mib = MOST_BYTES >> 20
    told = " ".join(parser().format_help().split())
    assert f"trace {source.MOST_BYTES >> 20} MiB, JSON {chrome.MOST_BYTES >> 20} MiB;" in told
    assert f"replay {mib} MiB, 1000 tasks, {read.LAST_TICK} ticks, {play.MOST_EVENTS} events;" in told
    assert f"schedule {mib} MiB, {taskfile.MOST_TASKS} tasks, {taskfile.MOST_JOBS} jobs;" in told
    assert f"windows {mib} MiB, {chainfile.MOST_PARTS} parts;" in told
    assert f"cache {references.MOST_IN_FILE} references, text {text.MOST_BYTES >> 30} GiB;" in told
    assert f"track {mib} MiB, {tracks.MOST_TRACKS} tracks, {tracks.MOST_PREDICTIONS} predictions." in told


@pytest.mark.parametrize("arguments", ["list", "list --json"])
def test_closed_output_is_told_in_one_sentence(arguments):
    told = subprocess.run(["sh", "-c", f'"$0" -m labkit {arguments} >&-', sys.executable], stderr=subprocess.PIPE)
    assert (told.returncode, told.stderr) == (1, b"labkit list: standard output is closed\n")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_full_disk_is_told_in_one_sentence():
    with open("/dev/full", "w") as full:
        told = subprocess.run([sys.executable, "-m", "labkit", "list"], stdout=full, stderr=subprocess.PIPE)
    assert told.returncode == 1 and told.stderr.startswith(b"labkit list: ") and told.stderr.count(b"\n") == 1


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
@pytest.mark.parametrize("json_too", [[], ["--json"]])
def test_a_terminal_without_unicode_is_no_error(encoding, json_too, monkeypatch):
    for arguments in (["list"], ["run", "matrix-orders"]):
        raw = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
        assert main([*arguments, *json_too]) == 0
        printed = raw.getvalue().decode(encoding)
        assert json.loads(printed) if json_too else printed
        if arguments[0] == "run" and not json_too:  # the default metrics have thousands, set apart by a thin space
            assert "\\u202f" not in printed and re.search(r"\d \d\d\d", printed)


def test_a_name_with_a_line_break_stays_in_its_line(capsys):
    assert main(["trace", "no\r\nfile\u202e"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["run", "priority\ninversion"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "\r" not in error
    with pytest.raises(SystemExit) as ended:
        main(["list", "one", "one\ntwo"])
    assert ended.value.code == 2 and r"unrecognized arguments: one\ntwo" in capsys.readouterr().err


@pytest.mark.parametrize(("event", "code", "said"), [(KeyboardInterrupt, 130, "interrupted"), (MemoryError, 1, "more memory")])
def test_an_interrupt_and_a_lack_of_memory_are_no_tracebacks(event, code, said, monkeypatch, capsys):
    def run(self):
        raise event

    monkeypatch.setattr("labkit.experiments.priority_inversion.PriorityInversion.run", run)
    assert main(["run", "priority-inversion"]) == code
    error = capsys.readouterr().err
    assert error.startswith("labkit run: ") and said in error and error.count("\n") == 1


def test_a_slow_run_shows_progress_to_who_is_watching(monkeypatch, capsys):
    class Watched(io.StringIO):
        def isatty(self):
            return True

    watched = Watched()
    assert main(["run", "acceptance-curves", "--set", "sets=20"]) == 0
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys, "stderr", watched)
    assert main(["run", "acceptance-curves", "--set", "sets=20"]) == 0
    assert re.fullmatch(r"(\r *\d+%)+\r +\r", watched.getvalue())


def test_run_takes_parameters_and_prints_metrics(capsys):
    assert main(["run", "priority-inversion", "--set", "hold=8", "--set", "protocol=ceiling", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["parameters"]["hold"] == 8 and printed["parameters"]["protocol"] == "ceiling"
    assert printed["metrics"][1]["bound"] == 8
    assert main(["run", "priority-inversion"]) == 0
    assert "H blocked, semaphore: 13 ms   (bound: 16 ms)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "priority-reversion"], "there is no experiment 'priority-reversion'; there are three-tasks, "),
        (["run", "priority-inversion", "--set", "hold=99"], "hold = 99 is not allowed; allowed is a whole number, 1 to 15 ms"),
        (["run", "priority-inversion", "--set", "hold=x"], "hold = 'x' is not allowed; allowed is a whole number, 1 to 15 ms"),
        (
            ["run", "priority-inversion", "--set", "holds=1"],
            "priority-inversion has no parameter 'holds'; it has hold, interference",
        ),
        (["run", "priority-inversion", "--set", "hold"], "--set 'hold' has no '='; write --set name=value"),
        (["trace", "nowhere.log"], "nowhere.log: cannot be read (No such file or directory)\n"),
        (["replay", "nowhere.json"], "labkit replay: nowhere.json: No such file or directory\n"),
        (["schedule", "nowhere.json", "--policy", "rm", "--until", "9"], "schedule: nowhere.json: No such file or directory\n"),
        (["windows", "nowhere.csv", "--period-ns", "9"], "nowhere.csv: No such file or directory\n"),
        (["cache", "nowhere.npz"], "there is no file nowhere.npz\n"),
        (["frames", "nowhere.txt"], "nowhere.txt: No such file or directory\n"),
        (["trace", LOG, "--export", "nowhere/run.json"], "labkit trace: nowhere/run.json: No such file or directory\n"),
        (["trace", LOG, "--fit", "nowhere/t.json"], "labkit trace: nowhere/t.json: No such file or directory\n"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_1(arguments, sentence, capsys):
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1 and error.startswith(f"labkit {arguments[0]}: ")


def test_replay_writes_both_files(tmp_path, capsys):
    timeline, events = tmp_path / "t.csv", tmp_path / "e.csv"
    assert main(["replay", str(ORACLE / "02_inversion_mutex.json"), "--timeline", str(timeline), "--events", str(events)]) == 0
    assert timeline.read_text() == (ORACLE / "02_inversion_mutex.timeline.csv").read_text()
    with open(events, newline="") as ours, open(ORACLE / "02_inversion_mutex.csv", newline="") as theirs:
        kinds = ("switch", "done", "inherit", "disinherit")
        assert [r for r in csv.reader(ours) if r[1] in kinds] == [r for r in csv.reader(theirs) if r[1] in kinds]


def test_replay_without_outputs_tells_who_ran_how_long(capsys):
    assert main(["replay", str(ORACLE / "02_inversion_mutex.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    ran = dict.fromkeys("HLM", 0)
    with open(ORACLE / "02_inversion_mutex.timeline.csv", newline="") as file:
        for row in csv.DictReader(file):
            ran[row["task"]] = ran.get(row["task"], 0) + int(row["end"]) - int(row["start"])
    told = {line.split(":")[0].strip(): int(line.split()[1]) for line in lines[1:]}
    assert told["H"] == ran["H"] > 0 and told["L"] == ran["L"] and "context switches" in lines[0]


def test_replay_reports_a_deadlock(tmp_path, capsys):
    scenario = json.loads((ORACLE / "02_inversion_mutex.json").read_text())
    scenario["objects"] = [{"name": n, "kind": "mutex", "length": 1, "init": 1} for n in "AB"]
    orders = {"L": ("A", "B"), "H": ("B", "A")}
    scenario["tasks"] = [
        {
            "name": name,
            "priority": 1 + (name == "H"),
            "release": 0,
            "loop_from": None,
            "program": [["delay", 1 if name == "H" else 0], ["take", first, None, 0], ["burn", 2], ["take", second, None, 0]],
        }
        for name, (first, second) in orders.items()
    ]
    path = tmp_path / "deadlock.json"
    path.write_text(json.dumps(scenario))
    assert main(["replay", str(path)]) == 0
    assert "waits for" in capsys.readouterr().out


def test_trace_tells_the_statistics_of_each_core_and_exports_npz(tmp_path, capsys):
    log, out = tmp_path / "board.log", tmp_path / "board.npz"
    log.write_text("f 0 1 0\ng 2 1 1\ng 6 0 1\nf 10 0 0\n")
    assert main(["trace", str(log), "--json", "--export", str(out)]) == 0
    told = json.loads(capsys.readouterr().out)["statistics"]
    assert {core: {name: row["share"] for name, row in rows.items()} for core, rows in told.items()} == {
        "0": {"f": 1.0},
        "1": {"g": 0.4},
    }
    assert read_npz(out).core.tolist() == [0, 1, 1, 0]


def test_trace_prints_statistics_and_every_repair(tmp_path, capsys):
    log = tmp_path / "board.log"
    log.write_text("Tmr Svc 10 1\nTmr Svc 14 0\nnonsense\n")
    assert main(["trace", str(log)]) == 0
    printed = capsys.readouterr().out
    assert "Tmr Svc" in printed and "line 3" in printed
    out = tmp_path / "run.json"
    assert main(["trace", str(log), "--json", "--export", str(out)]) == 0
    assert json.loads(capsys.readouterr().out)["statistics"]["Tmr Svc"]["sum"] == 4.0
    assert any(event.get("name") == "Tmr Svc" for event in json.loads(out.read_text())["traceEvents"])
    assert main(["trace", str(log), "--export", str(tmp_path / "run.xlsx")]) == 1
    assert "it is one of .json, .csv" in capsys.readouterr().err


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no /dev/zero here")
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("trace", "longer than 256 MiB"),
        ("replay", "longer than 8 MiB"),
        ("schedule --policy rm --until 5", "longer than 8 MiB"),
        ("windows --period-ns 5", "longer than 8 MiB"),
        ("track --q 1 --sigma 1 --out e.csv", "longer than 8 MiB"),
        ("cache", "it is no trace of data references"),
    ],
)
def test_an_endless_file_is_refused(arguments, sentence, capsys):
    command, *options = arguments.split()
    assert main([command, "/dev/zero", *options]) == 1
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1


def test_an_endless_archive_is_refused():
    if os.path.exists("/dev/zero"):
        with pytest.raises(ValueError, match="it is a device or pipe"):
            read_npz("/dev/zero")


BUTTAZZO = {
    "tasks": [
        {"name": "a", "period": 5, "deadline": 5, "offset": 0, "times": [2], "wcet": 2, "ecet": 1, "ep_wcet": 1},
        {"name": "b", "period": 7, "deadline": 7, "offset": 0, "times": [4], "wcet": 4, "ecet": 2, "ep_wcet": 1},
    ]
}


@pytest.mark.parametrize(("policy", "accepted"), [("rm", False), ("dm", False), ("edf", True), ("taft", True)])
def test_schedule_judges_a_set_and_writes_who_ran_when(policy, accepted, tmp_path, capsys):
    tasks, out = tmp_path / "tasks.json", tmp_path / "out.csv"
    tasks.write_text(json.dumps(BUTTAZZO))
    assert main(["schedule", str(tasks), "--policy", policy, "--until", "35", "--trace", str(out)]) == 0
    verdict = json.loads(capsys.readouterr().out)
    assert verdict["accepted"] is accepted and verdict["test"] and verdict["why"]
    with open(out, newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["task", "job", "part", "event", "start", "end"]
    missed = [row for row in rows if row["event"] == "miss"]
    assert [(row["task"], row["start"]) for row in missed[:1]] == ([] if accepted else [("b", "7")])
    ran = sum(int(row["end"]) - int(row["start"]) for row in rows if row["event"] == "run")
    assert 0 < ran <= 35 and sum(row["event"] == "release" for row in rows) == 7 + 5


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "the task set is []; an object is allowed"),
        (json.dumps({"tasks": [{"name": "a", "period": 0, "wcet": 1}]}), "task 'a': period is 0"),
        (json.dumps({"tasks": [{"name": "a", "period": 5, "wcet": 7}]}), "wcet 7 exceeds its deadline 5 by 2"),
    ],
)
def test_schedule_says_what_is_wrong_with_a_task_set(text, sentence, tmp_path, capsys):
    tasks = tmp_path / "tasks.json"
    tasks.write_text(text)
    assert main(["schedule", str(tasks), "--policy", "edf", "--until", "35"]) == 1
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1


def test_schedule_without_the_file(capsys):
    assert main(["schedule", "nowhere.json", "--policy", "edf", "--until", "35"]) == 1
    assert "nowhere.json" in capsys.readouterr().err


CHAIN = "phase,part,ecet_ns,wcet_ep_ns\nIn,In,4000000,100000\nFilter,arcs,30000000,200000\nFilter,edges,4000000,200000\n"


def test_windows_prints_release_and_deadline_of_every_phase(tmp_path, capsys):
    chain = tmp_path / "chain.csv"
    chain.write_text(CHAIN)
    assert main(["windows", str(chain), "--period-ns", "50000000", "--reserve-ns", "2000000", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    # demands of 4.1 and 34.4 ms share 48 ms
    assert [(w["phase"], w["release_ns"], w["deadline_ns"]) for w in printed] == [
        ("In", 0, 5111688),
        ("Filter", 5111688, 42888312),
    ]
    assert main(["windows", str(chain), "--period-ns", "50000000"]) == 0
    assert "Filter" in capsys.readouterr().out


def test_a_period_too_short_says_by_how_much(tmp_path, capsys):
    chain = tmp_path / "chain.csv"
    chain.write_text(CHAIN)
    assert main(["windows", str(chain), "--period-ns", "38000000"]) == 1
    error = capsys.readouterr().err
    assert "500000 ns too short" in error and "'Filter'" in error
