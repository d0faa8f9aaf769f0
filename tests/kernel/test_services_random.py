"""Random scenarios with all services: what must hold for each of them, whoever runs when."""

from collections import deque
from functools import cache
from random import Random

from labkit.kernel import read_scenario, run_scenario
from labkit.kernel.scenario.play import Play
from labkit.trace import KINDS, runs

END = 70
TASKS = ("T0", "T1", "T2", "T3")
LENGTHS = {"Q": 2, "B": 1, "QS": 2, "SB": 6, "MB": 14}
STARTED = {"X0": 0, "X1": 1}
OBJECTS = [
    {"name": "M", "kind": "mutex"},
    {"name": "S", "kind": "binary"},
    {"name": "C", "kind": "counting", "length": 2, "init": 1},
    {"name": "SS", "kind": "binary"},
    *({"name": name, "kind": "queue", "length": LENGTHS[name]} for name in ("Q", "B", "QS")),
    {"name": "SET", "kind": "queue_set", "length": 3, "members": ["QS", "SS"]},
    {"name": "E", "kind": "event_group"},
    {"name": "SB", "kind": "stream_buffer", "length": LENGTHS["SB"], "trigger": 3},
    {"name": "MB", "kind": "message_buffer", "length": LENGTHS["MB"]},
]

# Each argument of a step is a value, or a function that draws one.


def whole(least, most):
    return lambda draw: draw.randint(least, most)


def of(*some):
    return lambda draw: draw.choice(some)


def drawn(draw, what):
    return what(draw) if callable(what) else what


ticks, timeouts, bits = whole(1, 5), of(None, 0, 1, 2, 3, 4, 6), whole(1, 7)
others, own, index, values = of(*TASKS), of("self", *TASKS), whole(0, 2), whole(0, 20)
items = of("seq", "last", 3, 7)
actions = of("eNoAction", "eSetBits", "eIncrement", "eSetValueWithOverwrite", "eSetValueWithoutOverwrite")
timers = of("X0", "X1")

#: What neither waits nor gives the CPU away for good: allowed inside sections and callbacks.
AT_ONCE = (
    ("burn", ticks),
    ("tick_count",),
    ("give", of("S", "C", "SS")),
    ("take", of("S", "C"), 0, 0),
    ("send", of("Q", "QS"), items, 0, 0),
    ("overwrite", "B", items),
    ("recv", of("Q", "QS"), 0, 0),
    ("messages_waiting", of("S", "M", "Q")),
    ("spaces_available", "Q"),
    ("queue_reset", of("Q", "B")),
    ("notify_give", others, index),
    ("notify", others, actions, values, index, 0),
    ("notify_state_clear", own, index, 0),
    ("notify_value_clear", own, values, index),
    ("set_bits", "E", bits),
    ("clear_bits", "E", bits),
    ("get_bits", "E"),
    ("resume", others),
    ("set_prio", others, whole(0, 7)),
    ("get_prio", others),
    ("get_base_prio", others),
    ("abort_delay", others, 0),
    ("timer_start", timers, 0, 0),
    ("timer_stop", timers, 0, 0),
    ("timer_reset", timers, 0, 0),
    ("timer_change_period", timers, ticks, 0, 0),
    ("timer_active", timers, 0),
    ("stream_available", of("SB", "MB")),
    ("stream_spaces", of("SB", "MB")),
)
WAITING = (
    ("delay", whole(0, 4)),
    ("delay_until", ticks, 0),
    ("set_last_wake", whole(-3, 3)),
    ("yield",),
    ("take", of("S", "C", "SS"), timeouts, 0),
    ("send", of("Q", "B", "QS"), items, timeouts, 0),
    ("recv", of("Q", "B", "QS"), timeouts, 0),
    ("peek", of("Q", "B"), timeouts, 0),
    ("select", "SET", timeouts, 0),
    ("recv_selected", 0),
    ("notify_take", of("clear", "decrement"), timeouts, 0, index),
    ("notify_wait", values, values, timeouts, 0, index),
    ("wait_bits", "E", bits, of("any", "all"), of("clear", "keep"), timeouts, 0),
    ("sync", "E", bits, bits, timeouts, 0),
    ("suspend", of("self", "T0")),
    ("timer_start", timers, timeouts, 0),
    ("pend_call", lambda draw: at_once(draw, 2), timeouts, 0),
)
#: One task may write a buffer and one may read it.
BUFFERS = {
    "T1": (("stream_send", "SB", whole(1, 8), timeouts, 0), ("message_recv", "MB", whole(1, 10), timeouts, 0)),
    "T2": (("stream_recv", "SB", whole(1, 8), timeouts, 0), ("message_send", "MB", whole(1, 11), timeouts, 0)),
}
INTERRUPTS = (
    {"op": of("give", "take"), "target": of("S", "C", "SS")},
    {"op": of("send", "send_front", "recv"), "target": of("Q", "QS"), "value": values},
    {"op": "overwrite", "target": "B", "value": values},
    {"op": of("notify_give", "resume"), "target": others},
    {"op": "notify", "target": others, "value": values, "action": actions, "index": index},
    {"op": of("set_bits", "clear_bits"), "target": "E", "value": bits},
    {"op": of("timer_start", "timer_stop", "timer_reset"), "target": timers},
    {"op": "timer_change_period", "target": timers, "value": ticks},
)


def one(draw, among):
    return [drawn(draw, part) for part in draw.choice(among)]


def at_once(draw, most):
    return [one(draw, AT_ONCE) for _ in range(draw.randint(0, most))]


def block(draw, task):
    """Some steps that belong together."""
    match draw.randrange(8):
        case 0:
            inside = at_once(draw, 3)
            return [["take", "M", timeouts(draw), len(inside) + 1], *inside, ["give", "M"]]
        case 1:
            return [["enter_critical"], *at_once(draw, 3), ["exit_critical"]]
        case 2:
            return [["suspend_all"], *at_once(draw, 3), ["resume_all"]]
        case 3 if draw.random() < 0.3:
            inside = [["enter_critical"], *at_once(draw, 2), ["exit_critical"]]
            return [["suspend_all"], *at_once(draw, 1), *inside, *at_once(draw, 1), ["resume_all"]]
        case 4 if task == "T1":
            return [["create", "V"], *(one(draw, WAITING) for _ in range(3)), ["delete", "V"]]
        case 5 if task in BUFFERS:
            return [one(draw, BUFFERS[task])]
    return [one(draw, AT_ONCE + WAITING)]


@cache
def scenario(seed):
    """A random scenario."""
    draw = Random(seed)
    tasks = []
    for name in TASKS:
        program = [step for _ in range(draw.randint(1, 6)) for step in block(draw, name)]
        tasks.append({"name": name, "priority": draw.randint(0, 5), "program": [["burn", ticks(draw)], *program], "loop_from": 0})
    victim = [["burn", 1], one(draw, AT_ONCE), one(draw, WAITING), ["delay", 1]]
    tasks.append({"name": "V", "priority": draw.randint(0, 5), "program": victim, "loop_from": 0, "created": 0})
    made = [
        {"name": name, "kind": "timer", "period": draw.randint(1, 9), "auto_reload": draw.randrange(2), "started": started}
        | {"callback": at_once(draw, 2)}
        for name, started in STARTED.items()
    ]
    calls = [draw.choice(INTERRUPTS) for _ in range(draw.randint(0, 6))]
    isr = [{"tick": draw.randint(1, END), **{key: drawn(draw, value) for key, value in call.items()}} for call in calls]
    config = {
        "timers": 1,
        "timer_task_priority": draw.randint(0, 7),
        "timer_queue_length": draw.randint(1, 4),
        "idle_should_yield": draw.randrange(2),
        "pending_ticks": draw.choice(("all", "one")),
    }
    return read_scenario({"end_tick": END, "config": config, "objects": [*OBJECTS, *made], "tasks": tasks, "isr": isr})


SEEDS = range(300)


@cache
def played(seed):
    """The run, or None: a program that is drawn may take no time for ever, or give a mutex it has lost to a time-out."""
    try:
        return run_scenario(scenario(seed))
    except ValueError as error:
        assert "caught in a loop that takes no time" in str(error) or "only its holder may give it" in str(error), (seed, error)
        return None


def runs_played():
    return [(seed, run) for seed in SEEDS if (run := played(seed)) is not None]


def for_every_run(check):
    """A test that checks every run and names the seed of one that fails."""

    def test():
        for seed, run in runs_played():
            try:
                check(seed, run)
            except AssertionError as error:
                error.add_note(f"seed {seed}")
                raise

    test.__name__, test.__doc__ = check.__name__, check.__doc__
    return test


def rows(run):
    names = (*run.trace.names, None)
    for time, kind, task, other, value, extra in run.trace.rows().tolist():
        yield time, KINDS[kind], names[task], names[other], value, extra


@for_every_run
def test_counts_items_and_bytes_are_what_went_in_and_has_not_come_out(seed, run):
    count = {"S": 0, "C": 1, "SS": 0, "M": 1}
    queues = {name: deque() for name in ("Q", "B", "QS")}
    level = {"SB": 0, "MB": 0}
    entries = 0
    for _, kind, _, other, value, extra in rows(run):
        if kind in ("take", "give") and other in count:
            assert value == count[other]
            count[other] += 1 if kind == "give" else -1
        items = queues.get(other)
        if items is not None and kind in ("send", "send_front", "overwrite", "recv", "peek", "queue_reset"):
            assert value == len(items)
            if kind in ("overwrite", "queue_reset"):
                items.clear()
            if kind in ("send", "overwrite"):
                items.append(extra)
            elif kind == "send_front":
                items.appendleft(extra)
            elif kind == "recv":
                assert extra == items.popleft()
            assert len(items) <= LENGTHS[other]
        elif kind in ("send_block", "send_fail") and items is not None:
            assert len(items) == LENGTHS[other]
        elif kind in ("recv_block", "recv_fail", "peek_block", "peek_fail"):
            assert not items
        if kind in ("set_send", "select"):
            assert value == entries
            entries += 1 if kind == "set_send" else -1
        if kind in ("stream_send", "message_send", "stream_recv", "message_recv"):
            assert extra == level[other]
            moved = value + (4 if other == "MB" and value else 0)
            level[other] += moved if kind.endswith("send") else -moved
            assert 0 <= level[other] <= LENGTHS[other]
        if kind == "notify_take":
            assert value >= 0


@for_every_run
def test_nobody_else_runs_inside_a_section(seed, run):
    timeline = runs(run.trace)
    assert timeline[0, 1] == 0 and timeline[-1, 2] == END
    assert (timeline[1:, 1] == timeline[:-1, 2]).all()
    critical = suspended = 0
    for time, kind, _, _, value, _ in rows(run):
        if kind in ("switch", "isr", "timer_expired"):
            assert not critical, (time, kind)
        if kind == "switch":
            assert not suspended, time
        if kind in ("enter_critical", "exit_critical"):
            critical = value
        elif kind in ("suspend_all", "resume_all"):
            suspended += 1 if kind == "suspend_all" else -1


@for_every_run
def test_bits_that_satisfy_are_those_waited_for(seed, run):
    waiting = {}
    for _, kind, task, _, value, extra in rows(run):
        if kind in ("wait_bits_block", "sync_block"):
            waiting[task] = extra
        elif kind in ("wait_bits", "sync"):
            wanted, met = divmod(extra, 2)
            assert wanted == waiting.pop(task, wanted)
            assert bool(value & wanted) >= met
            if kind == "sync":
                assert met == (value & wanted == wanted)


@for_every_run
def test_a_timer_calls_back_once_a_period_and_never_early(seed, run):
    if scenario(seed).pending_ticks == "one":  # then the tick count falls behind
        return
    timers = {each.name: each for each in scenario(seed).objects if each.kind == "timer"}
    earliest = {}
    commands = ("timer_start", "timer_stop", "timer_reset", "timer_change_period")
    period = {name: timer.period for name, timer in timers.items()}
    for time, kind, _, other, value, extra in rows(run):
        if kind == "timer_command":
            match commands[extra]:
                case "timer_stop":
                    earliest.pop(other, None)
                case "timer_change_period":
                    period[other], earliest[other] = value, 0  # from the tick count, which may stand behind the time
                case _:
                    earliest[other] = value + period[other]
        elif kind == "timer_expired":
            assert time >= earliest[other]
            if timers[other].auto_reload:
                earliest[other] += period[other] if earliest[other] else 0
            else:
                del earliest[other]


@for_every_run
def test_cut_anywhere_the_trace_is_the_same(seed, run):
    draw = Random(seed)
    k = Play(scenario(seed)).kernel
    for cut in sorted(draw.sample(range(1, END), draw.randint(0, 8))):
        assert k.peek() >= k.now
        k.advance(cut)
    assert k.run(END).trace.rows().tolist() == run.trace.rows().tolist()


@for_every_run
def test_outside_sections_nobody_runs_below_a_ready_task(seed, run):
    """Without mutexes, that is, for rule 17 is about those."""
    if any(step.name == "take" and step.arguments[0] == "M" for task in scenario(seed).tasks for step in task.program):
        return
    ready, running, before, held = {}, None, 0, 0
    for time, kind, task, other, value, extra in rows(run):
        if time > before:
            if not held:
                assert ready[running] == max(ready.values()), time
            before = time
        if kind in ("ready", "create"):
            ready[task] = value
        elif kind == "switch":
            running = task
            if extra > 0:
                ready.pop(other, None)
        elif kind in ("suspend", "delete") and other != running:
            ready.pop(other, None)
        elif kind in ("enter_critical", "suspend_all"):
            held += 1
        elif kind in ("exit_critical", "resume_all"):
            held -= 1


def test_what_is_drawn_reaches_what_it_is_for():
    """Else the properties above would say little."""
    seen = {KINDS[kind] for _, run in runs_played() for kind in run.trace.kind.tolist()}
    wanted = {"tick_lost", "select", "set_send", "sync", "wait_bits", "notify_wait", "timer_expired", "timer_send_block"}
    wanted |= {"pend_call", "stream_send", "message_recv", "delete", "abort_delay", "queue_reset", "inherit"}
    assert not wanted - seen
    assert len(runs_played()) > 0.8 * len(SEEDS)
