"""Measuring a task set in a recording: what was simulated comes back, and what cannot be told is left out by name."""

import json
from pathlib import Path

import pytest

from labkit.__main__ import main
from labkit.scheduler import fitted, schedule
from labkit.trace import measured, read_recording

EXAMPLES = Path(__file__).parents[2] / "data" / "examples"

#: Of the schedule behind the examples, see tests/trace/make_examples.py: period, longest and 95th percentile of the execution
#: times (of ctl: 1100, 1200, 1150, and 1180 from then on).
TRUE = {"ctl": (5000, 1200, 1180), "odom": (10000, 2100, 2100), "logger": (40000, 9000, 9000)}


@pytest.mark.parametrize("name", ["board.btf", "linux_ftrace.txt", "run.csv", "run.json"])
def test_the_task_set_that_was_simulated_comes_back(name):
    trace, _ = read_recording(EXAMPLES / name)
    made = fitted(trace)
    tasks = {task["name"].split("-")[0]: task for task in made["tasks"]}
    assert made["unit"] == "us" and {n: (t["period"], t["wcet"], t["ecet"]) for n, t in tasks.items()} == TRUE
    assert all(entry["jitter"] == 0 and entry["gaps"] == 0 for entry in made["measured"].values())
    assert schedule(made, "dm", 200_000)[0]["accepted"] is True


def test_percentile_and_counts_by_hand():
    """Twenty jobs of 1 to 20 us every 100 us: the 95th percentile is the 19th."""
    log = "".join(f"a {100 * i} 1\na {100 * i + i + 1} 0\n" for i in range(20))
    [task], _ = measured(read_recording(log)[0])
    assert (task.jobs, task.activations, task.c_max, task.c_p95, task.period, task.jitter) == (20, 20, 20, 19, 100, 0)


def test_a_lost_stamp_makes_a_gap_and_no_jitter():
    log = "".join(f"a {100 * i + i % 3} 1\na {100 * i + 50} 0\n" for i in range(20) if i != 7)
    [task], _ = measured(read_recording(log)[0])
    assert (task.gaps, task.jitter, task.period) == (1, 3, 101)  # intervals of 101, 101, 98; by hand


def test_what_is_no_task_is_left_out_by_name():
    """IDLE; a scope within a task; one run only; and one that is preempted in a log, which does not say what its jobs are."""
    log = "".join(f"IDLE {100 * i} 1\nIDLE {100 * i + 10} 0\na {100 * i + 10} 1\nf {100 * i + 12} 1\nf {100 * i + 15} 0\n"
                  f"a {100 * i + 30} 0\n" for i in range(5))  # fmt: skip
    log += "once 600 1\nonce 601 0\n" + "".join(f"pre {t} 1\npre {t + 1} 0\n" for t in (610, 620, 630, 700, 705))
    tasks, left = measured(read_recording(log)[0])
    assert [(task.name, task.c_max) for task in tasks] == [("a", 20)]
    assert set(left) == {"IDLE", "f", "once", "pre"} and left["pre"].startswith("not periodic: the median interval is 10")


def test_a_logger_that_is_preempted_is_left_out_of_a_log_and_found_in_a_recording_with_jobs():
    _, left = measured(read_recording(EXAMPLES / "board.log")[0])
    assert "logger" in left
    assert "logger" in {task.name for task in measured(read_recording(EXAMPLES / "board.btf")[0])[0]}


def test_cycles_become_nanoseconds_rounded_to_the_safe_side():
    rows = {"tasks": [{"name": "a", "period": 1000, "wcet": 100}]}
    made = fitted(schedule(rows, "rm", 10_000, hz=216_000_000)[1])
    assert made["unit"] == "ns" and made["tasks"][0] == {"name": "a", "period": 4629, "wcet": 463, "ecet": 463}


def test_the_command_writes_what_schedule_takes(tmp_path, capsys):
    out = tmp_path / "tasks.json"
    assert main(["trace", str(EXAMPLES / "board.btf"), "--fit", str(out)]) == 0
    assert f"{out}: 3 tasks, times in us" in capsys.readouterr().out
    assert main(["schedule", str(out), "--policy", "edf", "--until", "100000"]) == 0
    assert json.loads(capsys.readouterr().out)["accepted"] is True
    assert main(["schedule", str(out), "--policy", "taft", "--until", "100000"]) == 1
    assert "has no ep_wcet" in capsys.readouterr().err


def test_several_cores_need_a_choice(tmp_path, capsys):
    log = tmp_path / "board.log"
    log.write_text("".join(f"a {100 * i} 1 0\na {100 * i + 9} 0 0\nb {50 * i} 1 1\nb {50 * i + 4} 0 1\n" for i in range(9)))
    assert main(["trace", str(log), "--fit", str(tmp_path / "t.json")]) == 1
    assert "it has 2 cores; choose one of 0, 1 with --core" in capsys.readouterr().err
    assert main(["trace", str(log), "--core", "1", "--fit", str(tmp_path / "t.json")]) == 0
    made = json.loads((tmp_path / "t.json").read_text())
    assert made["tasks"] == [{"name": "b", "period": 50, "wcet": 4, "ecet": 4}]
    assert main(["trace", str(log), "--core", "2"]) == 1
    assert "--core 2: there are 0, 1" in capsys.readouterr().err


def test_a_recording_without_a_task_is_told(tmp_path, capsys):
    log = tmp_path / "board.log"
    log.write_text("a 1 1\na 2 0\n")
    assert main(["trace", str(log), "--fit", str(tmp_path / "t.json")]) == 1
    assert "no task with a period in it ('a': 1 activations and 1 whole jobs" in capsys.readouterr().err
