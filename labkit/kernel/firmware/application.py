"""The files of the application: main.c, its FreeRTOSConfig.h, and what it needs of the board.

What the recorded interrupts do at a tick, the tick hook does here, which the kernel calls at the same place: after the tasks that
are due have been woken and before the switch. A computation of a tick is a loop, calibrated once against a counter of CPU cycles.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from labkit.checks import whole
from labkit.kernel.firmware.board import BOARD_C, BOARD_H, CONFIG_H, MAIN_C
from labkit.kernel.firmware.program import ENUMERATORS, MOST_BYTES, statements
from labkit.kernel.scenario.read import InterruptSpec, ObjectSpec, Scenario, TaskSpec
from labkit.kernel.scenario.steps import Step

#: Kind of object -> type of its handle, and the call that makes it.
MADE = {
    "binary": ("SemaphoreHandle_t", "xSemaphoreCreateBinary()"),
    "counting": ("SemaphoreHandle_t", "xSemaphoreCreateCounting({length}, {init})"),
    "mutex": ("SemaphoreHandle_t", "xSemaphoreCreateMutex()"),
    "recursive": ("SemaphoreHandle_t", "xSemaphoreCreateRecursiveMutex()"),
    "queue": ("QueueHandle_t", "xQueueCreate({length}, sizeof(item_t))"),
    "event_group": ("EventGroupHandle_t", "xEventGroupCreate()"),
    "stream_buffer": ("StreamBufferHandle_t", "xStreamBufferCreate({length}, {trigger})"),
    "message_buffer": ("MessageBufferHandle_t", "xMessageBufferCreate({length})"),
    "queue_set": ("QueueSetHandle_t", "xQueueCreateSet({length})"),
    "timer": ("TimerHandle_t", "xTimerCreate({text}, {period}, {auto}, NULL, expired_{id})"),
}

#: What an interrupt calls; {0} is the target, {1} and so on its arguments.
FROM_ISR = {
    "notify_give": "vTaskNotifyGiveIndexedFromISR({0}, {1}, NULL)",
    "notify": "(void) xTaskNotifyIndexedFromISR({0}, {3}, {2}, {1}, NULL)",
    "resume": "(void) xTaskResumeFromISR({0})",
    "give": "(void) xSemaphoreGiveFromISR({0}, NULL)",
    "take": "(void) xSemaphoreTakeFromISR({0}, NULL)",
    "send": "(void) xQueueSendToBackFromISR({0}, &item, NULL)",
    "send_front": "(void) xQueueSendToFrontFromISR({0}, &item, NULL)",
    "overwrite": "(void) xQueueOverwriteFromISR({0}, &item, NULL)",
    "recv": "(void) xQueueReceiveFromISR({0}, &item, NULL)",
    "set_bits": "(void) xEventGroupSetBitsFromISR({0}, {1}, NULL)",
    "clear_bits": "(void) xEventGroupClearBitsFromISR({0}, {1})",
    "stream_send": "(void) xStreamBufferSendFromISR({0}, payload, {1}, NULL)",
    "message_send": "(void) xMessageBufferSendFromISR({0}, payload, {1}, NULL)",
    "timer_start": "(void) xTimerStartFromISR({0}, NULL)",
    "timer_stop": "(void) xTimerStopFromISR({0}, NULL)",
    "timer_reset": "(void) xTimerResetFromISR({0}, NULL)",
    "timer_change_period": "(void) xTimerChangePeriodFromISR({0}, {1}, NULL)",
}


def write_firmware(scenario: Scenario, folder: str | Path, cpu_hz: int = 216_000_000, tick_hz: int = 1000) -> list[Path]:
    """Write the application into a folder, which is made if it is not there; returns the files.

    Errors: ValueError as from `firmware`; OSError.
    """
    files = firmware(scenario, cpu_hz, tick_hz)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in files]


def firmware(scenario: Scenario, cpu_hz: int = 216_000_000, tick_hz: int = 1000) -> dict[str, str]:
    """The application that does on a board what the scenario does in the model: name of each file -> its text.

    Errors: ValueError for a number that does not fit a board.
    """
    whole(tick_hz, 1, "tick_hz", whole(cpu_hz, 1, "cpu_hz", 1 << 32))
    names = _identifiers(scenario)
    config = CONFIG_H.format(
        cpu_hz=cpu_hz,
        tick_hz=tick_hz,
        priorities=scenario.priorities,
        time_slicing=int(scenario.time_slicing),
        idle_should_yield=int(scenario.idle_should_yield),
        timers=int(scenario.timer_priority is not None),
        timer_priority=scenario.timer_priority or 0,
        timer_queue=scenario.timer_queue,
    )
    return {"main.c": _main(scenario, names), "FreeRTOSConfig.h": config, "board.h": BOARD_H, "board.c": BOARD_C}


def _main(scenario: Scenario, names: Mapping[str, str]) -> str:
    calls = sorted(_calls(scenario), key=lambda call: call[0])
    functions: list[str] = []
    for number, program in calls:
        functions += _function(f"call_{number}(void *unused, uint32_t number)", ["unused", "number"], program, names)
    for each in scenario.objects:
        if each.kind == "timer":
            functions += _function(f"expired_{names[each.name]}(TimerHandle_t unused)", ["unused"], each.callback, names)
    for task in scenario.tasks:
        functions += _task(task, names)
    prototypes = [f"static void call_{number}(void *unused, uint32_t number);" for number, _ in calls]
    prototypes += [f"static void create_{names[task.name]}(void);" for task in scenario.tasks]
    objects = [f"static {MADE[each.kind][0]} {names[each.name]};" for each in scenario.objects]
    tasks = [f"static TaskHandle_t {names[task.name]};" for task in scenario.tasks]
    starts = [line for each in scenario.objects for line in _made(each, names)]
    starts += [f"create_{names[task.name]}();" for task in scenario.tasks if task.created]
    starts += [
        f"(void) xTimerStart({names[each.name]}, 0);" for each in scenario.objects if each.kind == "timer" and each.started
    ]
    return MAIN_C.format(
        name=_comment(scenario.name),
        headers="\n".join(f'#include "{header}"' for header in _headers(scenario)),
        payload=max(_bytes(scenario), default=1) or 1,
        end=scenario.end_tick,
        objects="\n".join([*objects, *tasks]),
        prototypes="\n".join(prototypes),
        selected="\n".join(_receive_selected(scenario, names)),
        functions="\n".join(functions),
        interrupts="\n".join(f"    {line}" for line in _interrupts(scenario, names)),
        starts="\n".join(f"    {line}" for line in starts),
    )


def _headers(scenario: Scenario) -> list[str]:
    headers = ["FreeRTOS.h", "task.h", "queue.h", "semphr.h", "event_groups.h", "stream_buffer.h", "message_buffer.h"]
    return [*headers, "timers.h"] if scenario.timer_priority is not None else headers


def _identifiers(scenario: Scenario) -> dict[str, str]:
    """A C identifier for each name: its letters and digits, made unique, and with a word before it that no macro begins with."""
    found: dict[str, str] = {}
    for word, each in [("obj", each) for each in scenario.objects] + [("task", each) for each in scenario.tasks]:
        plain = re.sub(r"\W", "_", f"{word}_{each.name}", flags=re.ASCII)
        found[each.name] = plain if plain not in found.values() else f"{plain}_{len(found)}"
    return found


def _text(name: str) -> str:
    """A name as a string of C; what is not ASCII is a question mark."""
    plain = re.sub(r"[^ -~]", "?", name)[:15].replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{plain}"'


def _comment(name: str) -> str:
    return re.sub(r"[^\w .,:()-]", "_", name, flags=re.ASCII)[:100]


def _function(head: str, unused: list[str], program: tuple[Step, ...], names: Mapping[str, str]) -> list[str]:
    """A function that the timer task runs; all of them share one counter and one last value."""
    body = ["    own_t *own = &daemon;", *(f"    (void) {name};" for name in unused), "    (void) own;"]
    return [f"static void {head}", "{", *body, *(f"    {line}" for line in statements(program, names)), "}", ""]


def _task(task: TaskSpec, names: Mapping[str, str]) -> list[str]:
    name = names[task.name]
    body = ["    own_t fresh = { 0 };", "    own_t *own = &fresh;", "    (void) unused;", "    (void) own;"]
    steps = [f"    {line}" for line in statements(task.program, names, task.loop_from)]
    end = [] if task.loop_from is not None else ["    vTaskDelete(NULL);"]
    create = f"if (xTaskCreate(run_{name}, {_text(task.name)}, STACK_WORDS, NULL, {task.priority}, &{name}) != pdPASS) {{"
    return [
        *(f"static void run_{name}(void *unused)", "{", *body, *steps, *end, "}", ""),
        *(f"static void create_{name}(void)", "{", f"    {create}", f"        {name} = NULL;", "    }", "}", ""),
    ]


def _made(each: ObjectSpec, names: Mapping[str, str]) -> Iterator[str]:
    name = names[each.name]
    numbers = {"length": each.length, "init": each.init, "trigger": each.trigger, "period": each.period}
    call = MADE[each.kind][1].format(**numbers, auto=f"pd{str(each.auto_reload).upper()}", id=name, text=_text(each.name))
    yield f"{name} = {call};"
    if each.kind == "binary" and each.init:
        yield f"(void) xSemaphoreGive({name});"
    for member in each.members:
        yield f"(void) xQueueAddToSet({names[member]}, {name});"


def _calls(scenario: Scenario) -> Iterator[tuple[int, tuple[Step, ...]]]:
    """The programs of pended calls, by their numbers."""
    for step in _steps(scenario):
        if step.name == "pend_call":
            yield step.arguments[0], step.arguments[1]


def _steps(scenario: Scenario) -> Iterator[Step]:
    """All steps, those of callbacks and pended calls included."""
    programs = [each.callback for each in scenario.objects] + [task.program for task in scenario.tasks]
    while programs:
        for step in programs.pop():
            yield step
            if step.name == "pend_call":
                programs.append(step.arguments[1])


def _bytes(scenario: Scenario) -> Iterator[int]:
    """How many bytes are sent or received at once."""
    for step in _steps(scenario):
        if step.name in ("stream_send", "stream_recv", "message_send", "message_recv"):
            yield step.arguments[1]
    for interrupt in scenario.interrupts:
        if interrupt.op in ("stream_send", "message_send"):
            yield whole(interrupt.arguments[0], 0, f"an interrupt's {interrupt.op}", MOST_BYTES)


def _receive_selected(scenario: Scenario, names: Mapping[str, str]) -> list[str]:
    """Receive from the member that was selected, or take it, without waiting."""
    if not any(step.name == "recv_selected" for step in _steps(scenario)):
        return []
    queues = [names[each.name] for each in scenario.objects if each.kind == "queue"]
    members = [f"    if (own->selected == {name}) return xQueueReceive({name}, &own->last, 0);" for name in queues]
    return [
        *("static BaseType_t receive_selected(own_t *own)", "{", "    if (own->selected == NULL) return pdFAIL;"),
        *(*members, "    return xSemaphoreTake(own->selected, 0);", "}", ""),
    ]


def _interrupts(scenario: Scenario, names: Mapping[str, str]) -> Iterator[str]:
    """The cases of the tick hook."""
    by_tick: dict[int, list[InterruptSpec]] = {}
    for interrupt in scenario.interrupts:
        by_tick.setdefault(interrupt.tick, []).append(interrupt)
    tasks = {task.name for task in scenario.tasks}
    for tick in sorted(by_tick):
        yield f"if (elapsed == {tick}u) {{"
        for interrupt in by_tick[tick]:
            target = names[interrupt.target]
            call = FROM_ISR[interrupt.op].format(target, *map(_number, interrupt.arguments))
            guard = f"if ({target} != NULL) " if interrupt.target in tasks else ""
            if "&item" in call:
                value = interrupt.arguments[0] if interrupt.arguments else 0
                yield f"    {{ item_t item = {value}LL; {call}; }}"
            else:
                yield f"    {guard}{call};"
        yield "}"


def _number(value: Any) -> str:
    return ENUMERATORS[value] if isinstance(value, str) else f"{value}u"
