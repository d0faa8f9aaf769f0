"""The application made from a scenario: compiled against prototypes where gcc is present, and read where it is not."""

import shutil
import subprocess
from pathlib import Path

import pytest

from labkit.__main__ import main
from labkit.kernel import firmware, read_scenario
from labkit.kernel.firmware.program import ANSWERS, CALLS
from labkit.kernel.scenario.steps import STEPS

ORACLE = Path(__file__).parents[1] / "oracle"
STUBS = Path(__file__).parent / "stubs"
SCENARIOS = sorted([*(ORACLE / "freertos").glob("*.json"), *(ORACLE / "freertos2").glob("*.json")])
GCC = shutil.which("gcc")
STRICT = ["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-Wno-format", "-fsyntax-only"]


def compiles(folder):
    """Compile all C of a folder; gcc's complaints, if it has any."""
    files = sorted(map(str, folder.rglob("*.c")))
    command = [GCC, *STRICT, "-I", str(folder), "-I", str(STUBS), *files]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


def written(scenario, folder):
    for name, text in firmware(scenario).items():
        (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.skipif(GCC is None, reason="no gcc")
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem)
def test_every_recorded_scenario_compiles(scenario, tmp_path):
    written(read_scenario(scenario), tmp_path)
    assert compiles(tmp_path) == ""


def test_every_step_is_there():
    assert set(CALLS) | set(ANSWERS) | {"set_last_wake", "create"} == set(STEPS)


PENDED = [["burn", 1], ["send", "a-b-c", "last", 0, 0]]
ODD = {
    "end_tick": 10,
    "config": {"timers": 1, "timer_task_priority": 2},
    "objects": [
        {"name": 'a"b\\', "kind": "queue", "length": 2},
        {"name": "a-b", "kind": "mutex"},
        {"name": "a b", "kind": "stream_buffer", "length": 9},
        {"name": "while", "kind": "timer", "period": 3, "callback": [["pend_call", PENDED, 0, 0]]},
        {"name": "a-b-c", "kind": "queue", "length": 1},
        {"name": "*/ int main", "kind": "event_group"},
    ],
    "tasks": [
        {
            "name": "déjà ?/vu",
            "priority": 1,
            "loop_from": 1,
            "program": [
                ["set_last_wake", -3],
                ["take", "a-b", None, 3],
                ["send", 'a"b\\', "seq", 5, 2],
                ["wait_bits", "*/ int main", 5, "all", "clear", 2, 2],
                ["notify_wait", 1, 4294967295, None, 1, 2],
                ["stream_send", "a b", 3, 0, 0],
                ["burn", 1],
            ],
        }
    ],
    "isr": [{"tick": 3, "op": "send", "target": "a-b-c", "value": -(1 << 40)}],
}


@pytest.mark.skipif(GCC is None, reason="no gcc")
def test_odd_names_and_numbers_compile(tmp_path):
    written(read_scenario(ODD), tmp_path)
    assert compiles(tmp_path) == ""


@pytest.mark.skipif(GCC is None, reason="no gcc")
def test_a_mistake_would_be_found(tmp_path):
    """The compiler looks at what it should: a call with a wrong argument, a name that is not there."""
    written(read_scenario(SCENARIOS[0]), tmp_path)
    text = (tmp_path / "main.c").read_text()
    typo, argument = text.replace("xSemaphoreGive(", "xSemaphoreGibt("), text.replace("Scheduler();", "Scheduler(1);")
    for wrong in (typo, argument):
        assert wrong != text
        (tmp_path / "main.c").write_text(wrong)
        assert "error" in compiles(tmp_path)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (["burn", 1 << 33], "step burn has 8589934592 ticks; at most 4294967295 are allowed on a board"),
        (["take", "M", (1 << 32) - 1, 0], "step take has 4294967295 ticks; at most 4294967294 are allowed on a board"),
        (["stream_send", "B", 70_000, 0, 0], "step stream_send has 70000 bytes; at most 65536 are allowed on a board"),
    ],
)
def test_what_does_not_fit_a_board_says_so(step, message):
    objects = [{"name": "M", "kind": "mutex"}, {"name": "B", "kind": "stream_buffer", "length": 100_000}]
    task = {"name": "A", "priority": 1, "loop_from": None, "program": [step]}
    with pytest.raises(ValueError, match=message):
        firmware(read_scenario({"end_tick": 5, "objects": objects, "tasks": [task]}))


def test_the_command_writes_the_files(tmp_path, capsys):
    main(["firmware", str(SCENARIOS[0]), "--out", str(tmp_path / "new"), "--tick-hz", "5000"])
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["FreeRTOSConfig.h", "board.c", "board.h", "main.c"]
    assert "#define configTICK_RATE_HZ                      5000" in (tmp_path / "new" / "FreeRTOSConfig.h").read_text()
    assert "main.c" in capsys.readouterr().out


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    assert main(["firmware", str(SCENARIOS[0]), "--out", str(tmp_path), "--tick-hz", "0"]) != 0
    assert "tick_hz is 0; a whole number from 1 to" in capsys.readouterr().err
