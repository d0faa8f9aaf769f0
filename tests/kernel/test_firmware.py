"""The application made from a scenario: compiled against prototypes where gcc is present, and read where it is not."""

import re
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


# The way through a program: run it on functions that answer as they are told, and follow the steps beside it.


def answers():
    """Zeros and ones, the same as in the C below."""
    state = 1
    while True:
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
        yield state >> 16 & 1


SCRIPT = """
#define main application
#include "main.c"
#undef main
#include "timers.h"
#include <stdio.h>
#include <stdlib.h>
static uint32_t state = 1;
static int calls = 0;
static unsigned called(const char *name)
{
    puts(name);
    if (++calls == 60) exit(0);
    state = (state * 1103515245u + 12345u) & 0x7fffffffu;
    return state >> 16 & 1u;
}
void board_start(void) {}
uint32_t board_cycles(void) { return 0; }
void board_finished(void) {}
"""


def answering():
    """A body for every prototype: it tells its name, and returns the next answer."""
    text = SCRIPT
    for header in sorted(STUBS.glob("*.h")):
        prototypes = re.findall(r"^(\w+) (\w+)\(([^;]*)\);", header.read_text(), flags=re.MULTILINE | re.DOTALL)
        for kind, name, arguments in prototypes:
            back = "" if kind == "void" else f"return ({kind}) (uintptr_t) "
            text += f'{kind} {name}({arguments}) {{ {back}called("{name}"); }}\n'
    return text


def followed(task):
    """Names of the functions that the steps call, with those answers, at most 60."""
    answer, at, selected, called = answers(), 0, False, []
    while len(called) < 60:
        if at == len(task.program):
            if task.loop_from is None:
                return [*called, "vTaskDelete"]
            at = task.loop_from
            continue
        step = task.program[at]
        at += 1
        if step.name == "burn" or (step.name == "recv_selected" and not selected):
            at += step.skip if step.name == "recv_selected" else 0
            continue
        call = CALLS.get(step.name) or ANSWERS.get(step.name, ({"create": "xTaskCreate"}.get(step.name, "xTaskGetTickCount"),))[0]
        call = "xSemaphoreTake" if step.name == "recv_selected" else re.search(r"[uvx]\w*[A-Z]\w+|task[A-Z]\w+", call)[0]
        called.append(call)
        got = next(answer)
        match step.name:
            case "select":
                selected = bool(got)
            case "wait_bits":
                bits, every = step.arguments[1:3]
                got = got & bits == bits if every else got & bits
            case "sync":
                got = got & step.arguments[2] == step.arguments[2]
            case "stream_send" | "message_send":
                got = got >= step.arguments[1]
        at += 0 if got else step.skip
    return called


@pytest.mark.skipif(GCC is None, reason="no gcc")
@pytest.mark.parametrize("scenario", [path for path in SCENARIOS if path.stem[0] in "m2"][::3], ids=lambda path: path.stem)
def test_each_task_goes_the_way_its_steps_say(scenario, tmp_path):
    sound = read_scenario(scenario)
    written(sound, tmp_path)
    text = (tmp_path / "main.c").read_text()
    for number, task in enumerate(sound.tasks):
        if not any(step.name != "burn" for step in task.program):
            continue  # it makes no call that would end it
        run = re.findall(r"^static void (run_\w+)\(", text, flags=re.MULTILINE)[number]
        (tmp_path / "script.c").write_text(f"{answering()}int main(void) {{ {run}(NULL); return 0; }}\n")
        command = [GCC, "-w", "-I", str(tmp_path), "-I", str(STUBS), "-o", str(tmp_path / "script"), str(tmp_path / "script.c")]
        subprocess.run(command, check=True)
        told = subprocess.run([tmp_path / "script"], capture_output=True, text=True, check=True, timeout=20).stdout
        assert told.split() == followed(task)[:60], task.name
