"""The programs of a scenario as C: one statement, or a few in braces, for each step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from labkit.kernel.scenario.play import KEPT, NOTED
from labkit.kernel.scenario.steps import ACTIONS, Step

#: The longest time-out in ticks that is not for ever, and the longest run of bytes a buffer is given at once.
MOST_TICKS, MOST_BYTES = (1 << 32) - 2, 1 << 16

ENUMERATORS = {ours: theirs for theirs, ours in ACTIONS.items()}

#: Steps that are one call of these arguments; {0} is the first, {handle} the task or NULL for the caller itself.
CALLS = {
    "burn": "burn({0})",
    "delay": "vTaskDelay({0})",
    "yield": "taskYIELD()",
    "give": "xSemaphoreGive({0})",
    "rgive": "xSemaphoreGiveRecursive({0})",
    "queue_reset": "xQueueReset({0})",
    "suspend": "vTaskSuspend({0})",
    "resume": "vTaskResume({0})",
    "set_prio": "vTaskPrioritySet({0}, {1})",
    "delete": "vTaskDelete({0})",
    "enter_critical": "taskENTER_CRITICAL()",
    "exit_critical": "taskEXIT_CRITICAL()",
    "suspend_all": "vTaskSuspendAll()",
    "notify_give": "xTaskNotifyGiveIndexed({0}, {1})",
}

#: Steps that return something, and the C condition on `answer` under which they have failed.
ANSWERS = {
    "delay_until": ("xTaskDelayUntil(&own->wake, {0})", "answer == pdFALSE"),
    "tick_count": ("xTaskGetTickCount()", ""),
    "take": ("xSemaphoreTake({0}, {1})", "answer != pdPASS"),
    "rtake": ("xSemaphoreTakeRecursive({0}, {1})", "answer != pdPASS"),
    "recv": ("xQueueReceive({0}, &own->last, {1})", "answer != pdPASS"),
    "peek": ("xQueuePeek({0}, &own->last, {1})", "answer != pdPASS"),
    "send": ("xQueueSendToBack({0}, &item, {2})", "answer != pdPASS"),
    "send_front": ("xQueueSendToFront({0}, &item, {2})", "answer != pdPASS"),
    "overwrite": ("xQueueOverwrite({0}, &item)", ""),
    "messages_waiting": ("uxQueueMessagesWaiting({0})", ""),
    "spaces_available": ("uxQueueSpacesAvailable({0})", ""),
    "select": ("(own->selected = xQueueSelectFromSet({0}, {1})) != NULL", "answer == 0"),
    "recv_selected": ("receive_selected(own)", "answer != pdPASS"),
    "notify_take": ("ulTaskNotifyTakeIndexed({2}, {0}, {1})", "answer == 0"),
    "notify": ("xTaskNotifyIndexed({0}, {3}, {2}, {1})", "answer != pdPASS"),
    "notify_wait": ("xTaskNotifyWaitIndexed({3}, {0}, {1}, &value, {2})", "answer == pdFALSE"),
    "notify_state_clear": ("xTaskNotifyStateClearIndexed({0}, {1})", "answer == pdFALSE"),
    "notify_value_clear": ("ulTaskNotifyValueClearIndexed({0}, {2}, {1})", ""),
    "set_bits": ("xEventGroupSetBits({0}, {1})", ""),
    "clear_bits": ("xEventGroupClearBits({0}, {1})", ""),
    "get_bits": ("xEventGroupGetBits({0})", ""),
    "wait_bits": ("xEventGroupWaitBits({0}, {1}, {3}, {2}, {4})", "bits"),
    "sync": ("xEventGroupSync({0}, {1}, {2}, {3})", "(answer & {2}) != {2}"),
    "stream_send": ("xStreamBufferSend({0}, payload, {1}, {2})", "answer < {1}"),
    "stream_recv": ("xStreamBufferReceive({0}, received, {1}, {2})", "answer == 0"),
    "message_send": ("xMessageBufferSend({0}, payload, {1}, {2})", "answer < {1}"),
    "message_recv": ("xMessageBufferReceive({0}, received, {1}, {2})", "answer == 0"),
    "stream_available": ("xStreamBufferBytesAvailable({0})", ""),
    "stream_spaces": ("xStreamBufferSpacesAvailable({0})", ""),
    "timer_start": ("xTimerStart({0}, {1})", "answer != pdPASS"),
    "timer_stop": ("xTimerStop({0}, {1})", "answer != pdPASS"),
    "timer_reset": ("xTimerReset({0}, {1})", "answer != pdPASS"),
    "timer_change_period": ("xTimerChangePeriod({0}, {1}, {2})", "answer != pdPASS"),
    "timer_active": ("xTimerIsTimerActive({0})", "answer == pdFALSE"),
    "pend_call": ("xTimerPendFunctionCall(call_{0}, NULL, 0, {2})", "answer != pdPASS"),
    "abort_delay": ("xTaskAbortDelay({0})", "answer != pdPASS"),
    "get_prio": ("uxTaskPriorityGet({0})", ""),
    "get_base_prio": ("uxTaskBasePriorityGet({0})", ""),
    "resume_all": ("xTaskResumeAll()", ""),
}

#: Steps whose first argument may be left out for the caller itself.
ABOUT_SELF = {"suspend", "set_prio", "delete", "get_prio", "get_base_prio", "notify_state_clear", "notify_value_clear"}
TIMED = {"take", "rtake", "recv", "peek", "send", "send_front", "select", "notify_take", "notify_wait", "wait_bits", "sync"}
TIMED |= {"stream_send", "stream_recv", "message_send", "message_recv", "pend_call"}
TIMED |= {"timer_start", "timer_stop", "timer_reset", "timer_change_period"}
#: Where a time-out stands among the arguments; last, if it is not here.
TIMEOUT_AT = {"notify_take": 1, "notify_wait": 2}


def statements(program: Sequence[Step], names: Mapping[str, str], loop_from: int | None = None) -> list[str]:
    """The lines of C for a program; with `loop_from` it goes on there after the last step. Names -> C identifiers.

    Errors: ValueError for a number that does not fit a board.
    """
    targets = {at + 1 + step.skip for at, step in enumerate(program) if step.skip and _fails(step)}
    targets |= set() if loop_from is None else {loop_from}
    lines = []
    for at, step in enumerate(program):
        if at in targets:
            lines.append(f"step_{at}:;")
        lines += _step(step, at, names)
    if len(program) in targets:
        lines.append(f"step_{len(program)}:;")
    if loop_from is not None:
        lines.append(f"goto step_{loop_from};")
    return lines


def _fails(step: Step) -> bool:
    return bool(ANSWERS.get(step.name, ("", ""))[1])


def _step(step: Step, at: int, names: Mapping[str, str]) -> list[str]:
    name = step.name
    if name == "set_last_wake":
        return [f"own->wake = xTaskGetTickCount() + (TickType_t) ({step.arguments[0]});"]
    if name == "create":
        task = names[step.arguments[0]]
        return [f"create_{task}();"]
    arguments = [_written(value, place, step, names) for place, value in enumerate(step.arguments)]
    if name in CALLS:
        return [f"{CALLS[name].format(*arguments)};"]
    call, failed = (text.format(*arguments) for text in ANSWERS[name])
    if name == "wait_bits":
        every = step.arguments[2]
        failed = f"(answer & {arguments[1]}) != {arguments[1]}" if every else f"(answer & {arguments[1]}) == 0"
    lines = []
    if name in ("send", "send_front", "overwrite"):
        lines.append(f"const item_t item = {arguments[1]};")
    if name == "notify_wait":
        lines.append("uint32_t value = 0;")
    kept = "" if name not in KEPT else "value" if name == "notify_wait" else "answer"
    needed = (failed and step.skip) or name in NOTED or kept == "answer"
    lines.append(f"const uint32_t answer = (uint32_t) ({call});" if needed else f"(void) ({call});")
    if kept:
        lines.append(f"own->last = {kept};")
    if name in NOTED:
        lines.append(f'NOTE("{name}", answer);')
    if failed and step.skip:
        lines.append(f"if ({failed}) goto step_{at + 1 + step.skip};")
    if len(lines) == 1:
        return lines
    return ["{", *(f"    {line}" for line in lines), "}"]


def _written(value: Any, place: int, step: Step, names: Mapping[str, str]) -> str:
    """An argument as C."""
    if step.name in TIMED and place == TIMEOUT_AT.get(step.name, len(step.arguments) - 1):
        return "portMAX_DELAY" if value is None else f"{_below(value, MOST_TICKS, step, 'ticks')}u"
    if value is None and step.name in ABOUT_SELF:
        return "NULL"
    if step.name in ("send", "send_front", "overwrite") and place == 1:
        return {"seq": "own->sequence++", "last": "own->last"}.get(value, f"{value}LL")
    if isinstance(value, bool):
        return "pdTRUE" if value else "pdFALSE"
    if isinstance(value, str):
        return ENUMERATORS[value] if step.name == "notify" and place == 1 else names[value]
    if step.name == "pend_call":
        return f"{value}" if place == 0 else ""  # the steps stand in a function of their own
    if isinstance(value, int):
        bytes_of = place == 1 and step.name.startswith(("stream_", "message_"))
        return f"{_below(value, MOST_BYTES if bytes_of else MOST_TICKS + 1, step, 'bytes' if bytes_of else 'ticks')}u"
    raise AssertionError(f"{step} has an argument that is no word of a step")


def _below(value: int, most: int, step: Step, unit: str) -> int:
    if value > most:
        raise ValueError(f"step {step.name} has {value} {unit}; at most {most} are allowed on a board")
    return value
