"""Reading scenarios: every mistake is one clear sentence; and random ones, against what must hold for all."""

import copy
import json
from collections import deque
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.kernel import read_scenario, run_scenario
from labkit.trace.folds import holds, runs
from labkit.trace.kinds import KINDS

GOOD = {
    "name": "good",
    "end_tick": 20,
    "objects": [
        {"name": "M", "kind": "mutex", "length": 1, "init": 1},
        {"name": "S", "kind": "counting", "length": 3, "init": 0},
        {"name": "Q", "kind": "queue", "length": 2, "init": 0},
        {"name": "R", "kind": "recursive", "length": 1, "init": 1},
    ],
    "tasks": [
        {"name": "A", "priority": 2, "loop_from": None, "program": [["take", "M", 5, 1], ["give", "M"], ["burn", 3]]},
        {"name": "B", "priority": 1, "loop_from": 0, "program": [["burn", 2], ["send", "Q", "seq", 0, 0]]},
    ],
    "isr": [{"tick": 4, "op": "give", "target": "S", "value": 0}],
}


def test_a_scenario_can_be_a_mapping_or_a_file(tmp_path):
    file = tmp_path / "good.json"
    file.write_text(json.dumps(GOOD))
    assert read_scenario(file) == read_scenario(str(file)) == read_scenario(GOOD)
    assert run_scenario(read_scenario(GOOD)).trace.end == 20


def test_a_scenario_can_be_replayed_under_each_protocol():
    recorded = read_scenario(Path(__file__).parents[1] / "oracle" / "freertos" / "02_inversion_mutex.json")

    def taken_at(protocol):
        return [time for time, kind, task, *_ in rows(run_scenario(recorded, protocol)) if kind == "take" and task == "H"]

    assert taken_at("inheritance") == taken_at("ceiling") == taken_at("freertos")
    assert taken_at("none") > taken_at("freertos")


def test_a_run_with_too_many_events_ends(monkeypatch):
    monkeypatch.setattr("labkit.kernel.scenario.play.MOST_EVENTS", 10_000)
    busy = read_scenario(set_at(("end_tick",), 10_000_000))
    with pytest.raises(ValueError, match="the run makes more than 10000 events, the most that are recorded") as error:
        run_scenario(busy)
    assert error.value.__notes__[0].startswith("in task '")


def set_at(path, value):
    """GOOD with one place changed."""
    data = copy.deepcopy(GOOD)
    place = data
    for key in path[:-1]:
        place = place[key]
    if value is KeyError:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return data


STEP = ("tasks", 0, "program", 0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (STEP, ["jump", 3], r"task 'A', step 0: unknown step \['jump', 3\]; there are burn, delay"),
        (STEP, 7, "task 'A', step 0: unknown step 7"),
        (STEP, [], "unknown step"),
        (STEP, ["take", "M", 5], "take has 2 arguments; it takes 3"),
        (STEP, ["take", "X", 5, 0], "there is no binary or counting or mutex 'X'; known names are M, S, Q, R, A, B"),
        (STEP, ["take", "Q", 5, 0], "'Q' is a queue; a binary or counting or mutex is allowed"),
        (STEP, ["take", "R", 5, 0], "'R' is a recursive"),
        (STEP, ["rtake", "M", 5, 0], "'M' is a mutex; a recursive is allowed"),
        (STEP, ["take", ["M"], 5, 0], r"there is no binary or counting or mutex \['M'\]"),
        (STEP, ["take", "M", -1, 0], r"take: timeout is -1; a whole number from 0 to 2\*\*62 is allowed"),
        (STEP, ["take", "M", 5, 3], "take: skip is 3; a whole number from 0 to 2 is allowed"),
        (STEP, ["burn", -2], "burn: ticks is -2"),
        (STEP, ["burn", 1.5], "burn: ticks is 1.5"),
        (STEP, ["burn", True], "burn: ticks is True"),
        (STEP, ["delay_until", 0], "delay_until: period is 0"),
        (STEP, ["notify_give", "C"], "there is no task 'C'"),
        (STEP, ["notify_take", "all", None, 0], "'all' is not allowed; 'clear' or 'decrement' is"),
        (STEP, ["set_prio", "self", 8], "set_prio: priority is 8; a whole number from 0 to 7 is allowed"),
        (STEP, ["send", "Q", "first", 0, 0], "item .or 'seq' or 'last'. is 'first'"),
        (STEP, ["overwrite", "Q", 1], "overwrite on queue 'Q' of length 2"),
        (("tasks", 0, "priority"), -1, "task 'A': priority is -1; a whole number from 0 to 7 is allowed"),
        (("tasks", 0, "priority"), "high", "task 'A': priority is 'high'"),
        (("tasks", 0, "loop_from"), 3, "task 'A': loop_from is 3; a whole number from 0 to 2 is allowed"),
        (("tasks", 0, "program"), "burn", "task 'A': program is 'burn'; a list of at most 10000 steps is allowed"),
        (("tasks", 0, "name"), "B", "the name 'B' is used more than once"),
        (("tasks", 0, "name"), "M", "the name 'M' is used more than once"),
        (("tasks", 0, "name"), "IDLE", "task 0: name is 'IDLE'; a text of 1 to 100 printable characters, other than IDLE"),
        (("tasks", 0), None, "task 0 is None; an object is allowed"),
        (("objects", 0, "kind"), "lock", "object 'M': kind is 'lock'; one of binary, counting, mutex"),
        (("objects", 1, "init"), 4, "object 'S': init is 4; a whole number from 0 to 3 is allowed"),
        (("objects", 2, "length"), 0, "object 'Q': length is 0"),
        (("objects", 0), {"kind": "mutex"}, "object 0 has no name; a text of 1 to 100 printable characters"),
        (("objects", 0, "name"), "a\nb", r"object 0: name is 'a\\nb'; a text of 1 to 100 printable characters"),
        (("tasks", 0, "name"), "\ud800", r"task 0: name is '\\ud800'; a text of 1 to 100 printable characters"),
        (("tasks", 0, "name"), "x" * 101, "a text of 1 to 100 printable characters"),
        (("tasks", 0, "priority"), 10**400, r"priority is 10+\.\.\.0+; a whole number from 0 to 7"),
        (("tasks",), GOOD["tasks"] * 501, "the scenario has 1002 tasks; a list of at most 1000 tasks is allowed"),
        (("isr", 0, "tick"), -4, "isr 0: tick is -4"),
        (("isr", 0, "op"), "burn", "isr 0: op is 'burn'; one of notify_give, notify, resume, give, take, send"),
        (("isr", 0, "target"), "M", "isr 0: give: 'M' is a mutex; a binary or counting is allowed"),
        (("end_tick",), 0, "end_tick is 0"),
        (("end_tick",), KeyError, "the scenario has no end_tick; a whole number from 1 to 10000000 is needed"),
        (("tasks",), KeyError, "the scenario has no tasks; a list of at most 1000 tasks is needed"),
        (("config",), {"cores": 2}, "config: cores is 2; only 1, which the model covers, is allowed"),
        (("config",), {"pending_ticks": "two"}, "config: pending_ticks is 'two'; one of all, one is allowed"),
        (("config",), {"timers": 1}, "config: timer_task_priority is None; a whole number from 0 to 7 is allowed"),
        (STEP, ["delay_until", 5, 0, 0], "delay_until has 3 arguments; it takes 1 to 2: period, skip"),
        (STEP, ["notify", "B", "eFly", 0, 0, 0], "notify: 'eFly' is not allowed; 'eNoAction', 'eSetBits', "),
        (STEP, ["notify_give", "B", 3], "notify_give: index is 3; a whole number from 0 to 2 is allowed"),
        (STEP, ["wait_bits", "M", 1, "any", "keep", 0, 0], "wait_bits: 'M' is a mutex; an event_group is allowed"),
        (STEP, ["set_last_wake", None], "set_last_wake: offset is None; a whole number from -4294967295 to"),
        (STEP, ["timer_start", "T", 0, 0], "timer_start: there is no timer 'T'; known names are M, S, Q, R, A, B"),
        (
            STEP,
            ["pend_call", [["burn", 1]], 0, 0],
            "pend_call is for the timer task, and the scenario has none; config: timers 1",
        ),
        (STEP, ["create", "self"], "create: there is no task 'self'"),
        (("objects", 0), {"name": "T", "kind": "timer"}, "a timer is for the timer task, and the scenario has none"),
        (("objects", 0), {"name": "W", "kind": "stream_buffer", "length": 3, "trigger": 4}, "object 'W': trigger is 4; a whole"),
        (("objects", 0), {"name": "W", "kind": "message_buffer", "length": 4}, "object 'W': length is 4; a whole number from 5"),
        (
            ("objects", 3),
            {"name": "G", "kind": "queue_set", "members": ["M"]},
            "members: there is no queue or binary or counting 'M'",
        ),
        (("objects", 3), {"name": "G", "kind": "queue_set", "members": ["Q", "Q"]}, "members are Q, Q; each is allowed once"),
        (
            ("isr", 0),
            {"tick": 1, "op": "set_bits", "target": "S"},
            "isr 0: set_bits: 'S' is a counting; an event_group is allowed",
        ),
        (("isr", 0), {"tick": 1, "op": "notify", "target": "A", "action": "x"}, "isr 0: notify: 'x' is not allowed; 'eNoAction'"),
        (("isr", 0), {"tick": 1, "op": "overwrite", "target": "Q"}, "isr 0: overwrite: overwrite on queue 'Q' of length 2"),
    ],
)
def test_a_mistake_is_one_sentence_with_place_and_remedy(path, value, message):
    with pytest.raises(ValueError, match=message):
        read_scenario(set_at(path, value))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "is not JSON") for text in ("", "{", "[1, 2", "nul", "[" * 100_000, '{"end_tick": NaN}', "9" * 5000)),
        ('{"end_tick": 1, "end_tick": 2}', "the key 'end_tick' comes twice in one object"),
        ('{"end_tick": 1e400, "objects": [], "tasks": []}', "end_tick is inf; a whole number"),
        ('{"end_tick": 1, "objects": [], "tasks": [' + "[" * 500 + "]" * 500 + "]}", r"task 0 is \[\[\[.*; an object is allowed"),
        ("[]", r"the scenario is \[\]; an object is allowed"),
        (b"\xff", "bad.json is not UTF-8 text: byte 0 is 0xff"),
        (" " * (8 << 20) + "{}", "bad.json is longer than 8 MiB"),
    ],
)
def test_a_file_that_cannot_be_taken_says_why(tmp_path, text, message):
    file = tmp_path / "bad.json"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=message):
        read_scenario(file)


keys = st.sampled_from(["name", "tasks", "objects", "program", "isr", "end_tick", "kind", "priority"])
anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3), lambda inner: st.lists(inner) | st.dictionaries(keys, inner)
)


@given(anything)
@settings(max_examples=200, deadline=None)
def test_whatever_it_is_given_it_says_so(data):
    try:
        read_scenario(data if isinstance(data, dict) else {"tasks": data})
    except ValueError as error:
        assert str(error)


# Random scenarios

OBJECTS = [
    {"name": "M1", "kind": "mutex"},
    {"name": "M2", "kind": "mutex"},
    {"name": "R", "kind": "recursive"},
    {"name": "S", "kind": "binary"},
    {"name": "C", "kind": "counting", "length": 2, "init": 1},
    {"name": "Q", "kind": "queue", "length": 2},
    {"name": "B", "kind": "queue", "length": 1},
]
TASKS = ("T0", "T1", "T2", "T3")

ticks = st.integers(1, 5)
timeouts = st.none() | st.integers(0, 6)
queues = st.sampled_from(("Q", "B"))
others = st.sampled_from(TASKS)

simple_step = st.one_of(
    st.tuples(st.just("burn"), ticks),
    st.tuples(st.just("delay"), st.integers(0, 4)),
    st.tuples(st.just("delay_until"), ticks),
    st.just(("yield",)),
    st.tuples(st.just("take"), st.sampled_from(("S", "C")), timeouts, st.just(0)),
    st.tuples(st.just("give"), st.sampled_from(("S", "C"))),
    st.tuples(st.sampled_from(("send", "send_front")), queues, st.just("seq") | st.integers(0, 9), timeouts, st.just(0)),
    st.tuples(st.just("overwrite"), st.just("B"), st.just("seq") | st.just("last")),
    st.tuples(st.sampled_from(("recv", "peek")), queues, timeouts, st.just(0)),
    st.tuples(st.just("notify_give"), others),
    st.tuples(st.just("notify_take"), st.sampled_from(("clear", "decrement")), timeouts, st.just(0)),
    st.tuples(st.just("suspend"), st.sampled_from(("self", "T0"))),
    st.tuples(st.just("resume"), others),
    st.tuples(st.just("set_prio"), others | st.just("self"), st.integers(1, 7)),
)


def locked(inner):
    """Steps within a mutex, jumped over if it cannot be had in time."""

    def wrap(lock, timeout, steps):
        take, give = ("rtake", "rgive") if lock == "R" else ("take", "give")
        return [(take, lock, timeout, len(steps) + 1), *steps, (give, lock)]

    return st.builds(wrap, st.sampled_from(("M1", "M2", "R")), timeouts, inner)


def flat(blocks):
    return [step for block in blocks for step in block]


block = st.builds(lambda step: [step], simple_step)
inner = locked(st.lists(block, max_size=2).map(flat))
outer = locked(st.lists(block | inner, max_size=3).map(flat))
programs = st.lists(block | outer, max_size=5).map(flat)
interrupts = st.tuples(
    st.integers(1, 60),
    st.sampled_from((("give", "S"), ("give", "C"), ("send", "Q"), ("notify_give", "T0"), ("resume", "T0"), ("resume", "T1"))),
)


@st.composite
def scenarios(draw):
    tasks = []
    for name in TASKS[: draw(st.integers(2, 4))]:
        program = [("burn", draw(ticks)), *draw(programs)]
        loop_from = 0 if name == "T0" else draw(st.sampled_from((None, 0)))  # T0 is suspended by others, so it never ends
        tasks.append({"name": name, "priority": draw(st.integers(1, 5)), "program": program, "loop_from": loop_from})
    absent = set(TASKS) - {task["name"] for task in tasks}
    for task in tasks:  # a step about a task that is not there becomes a yield
        task["program"] = [("yield",) if absent.intersection(step) else step for step in task["program"]]
    drawn = draw(st.lists(interrupts, max_size=6))
    isr = [{"tick": tick, "op": op, "target": target, "value": tick} for tick, (op, target) in drawn]
    return read_scenario({"name": "random", "end_tick": 60, "objects": OBJECTS, "tasks": tasks, "isr": isr})


def own_mutex_twice(scenario):
    """Whether a task can take a plain mutex that it holds: FreeRTOS does not allow it."""
    for task in scenario.tasks:
        open_locks = []
        for name, arguments, _ in task.program:
            if name == "take" and arguments[0] in open_locks:
                return True
            if name in ("take", "give") and arguments[0] in ("M1", "M2"):
                open_locks.append(arguments[0]) if name == "take" else open_locks.remove(arguments[0])
    return False


def rows(run):
    names = (*run.trace.names, None)
    for time, kind, task, other, value, extra in run.trace.rows().tolist():
        yield time, KINDS[kind], names[task], names[other], value, extra


protocols = st.sampled_from(("freertos", "none", "inheritance"))


@given(scenarios(), protocols)
@settings(max_examples=60, deadline=None)
def test_what_holds_for_every_scenario(scenario, protocol):
    run = run_scenario(scenario, protocol)
    assert run_scenario(scenario, protocol).trace.rows().tolist() == run.trace.rows().tolist()

    timeline = runs(run.trace)
    assert timeline[0, 1] == 0 and timeline[-1, 2] == scenario.end_tick
    assert (timeline[1:, 1] == timeline[:-1, 2]).all()

    for lock in ("M1", "M2", "R"):
        if not own_mutex_twice(scenario):
            held = [(start, end) for _, code, start, end in holds(run.trace).tolist() if run.trace.names[code] == lock]
            assert all(end <= start for (_, end), (start, _) in pairwise(held))

    queues = {"Q": deque(), "B": deque()}
    for _, kind, _, other, value, extra in rows(run):
        items = queues.get(other)
        if kind in ("send", "send_front", "overwrite", "recv", "peek"):
            assert value == len(items)
        if kind == "send":
            items.append(extra)
        elif kind == "send_front":
            items.appendleft(extra)
        elif kind == "overwrite":
            queues[other] = deque([extra])
        elif kind == "recv":
            assert extra == items.popleft()
        elif kind == "peek":
            assert extra == items[0]
        elif kind == "send_fail":
            assert len(items) == {"Q": 2, "B": 1}[other]


@given(scenarios(), st.sampled_from(("none", "inheritance")))
@settings(max_examples=60, deadline=None)
def test_no_task_runs_below_a_ready_one(scenario, protocol):
    """Holds for every protocol but FreeRTOS's own (rule 17)."""
    ready, running, before = {}, None, 0
    for time, kind, task, other, value, extra in rows(run_scenario(scenario, protocol)):
        if time > before:
            assert ready[running] == max(ready.values())
            before = time
        if kind in ("ready", "create"):
            ready[task] = value
        elif kind == "switch":
            running = task
            if extra > 0:
                ready.pop(other, None)
        elif kind == "suspend" and other != running:
            ready.pop(other, None)


@given(scenarios())
@settings(max_examples=60, deadline=None)
def test_textbook_priority_is_the_maximum_of_base_and_waiters(scenario):
    """At every instant a holder runs at least as high as anyone who waits for its lock."""
    priority, base, waiting, held = {}, {}, {}, {}
    before = 0
    for time, kind, task, other, value, _ in rows(run_scenario(scenario, "inheritance")):
        if time > before:
            for waiter, lock in waiting.items():
                if lock in held and held[lock] != waiter:
                    assert priority[held[lock]] >= priority[waiter]
            before = time
        if kind == "create":
            priority[task] = base[task] = value
        elif kind in ("ready", "switch", "inherit", "disinherit", "disinherit_timeout"):
            priority[task] = value
        if kind == "ready" or kind == "suspend":
            waiting.pop(task if kind == "ready" else other, None)
        elif kind == "take_block" and other in ("M1", "M2", "R"):
            waiting[task] = other
        elif kind == "take" and other in ("M1", "M2", "R"):
            held[other] = task
        elif kind == "give":
            held.pop(other, None)


def test_a_step_about_a_task_that_is_not_there_yet_says_so():
    absent = {"name": "C", "priority": 1, "loop_from": None, "created": 0, "program": []}
    scenario = set_at(("tasks",), [{**GOOD["tasks"][0], "program": [["burn", 1], ["notify_give", "C"]]}, absent])
    with pytest.raises(ValueError, match="task 'C' has not been created yet; only a task that exists can be named"):
        run_scenario(read_scenario(scenario))


def test_a_pended_call_is_checked_step_by_step():
    scenario = set_at(STEP, ["pend_call", [["burn", 1], ["take", "M", -1, 0]], 0, 0])
    scenario["config"] = {"timers": 1, "timer_task_priority": 3}
    with pytest.raises(ValueError, match="task 'A', step 0: pend_call, step 1: take: timeout is -1"):
        read_scenario(scenario)
