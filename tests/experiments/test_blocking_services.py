"""Notebook 01: critical sections against mutexes, and the timer task's priority."""

import pytest
from hypothesis import given, settings

from labkit.experiments.mutual_exclusion import WAYS, MutualExclusion
from labkit.experiments.timer_task import BEAT, TimerTask, check_prompt_beats


@settings(max_examples=40)
@given(MutualExclusion.strategy())
def test_a_section_holds_everybody_and_a_mutex_who_shares(experiment):
    result = experiment.run()
    for way, seen in result.items():
        high, sharing = experiment.bounds(way)
        assert seen.high.blocked <= high and (sharing is None or seen.sharing.blocked <= sharing)
        held = seen.handled - experiment.interrupt
        assert held == 0 or way == "critical section"
        assert seen.lost == 0 or way == "critical section"
    assert result["mutex"].high.blocked == 0
    assert result["suspended"].sharing.blocked <= result["critical section"].sharing.blocked


@pytest.mark.parametrize("section", [1, 2, 5, 9])
def test_only_one_tick_survives_a_critical_section(section):
    result = MutualExclusion(section=section).run()  # from 0.5 ms on, so that `section` ticks fall into it
    assert result["critical section"].lost == section - 1


def test_the_bound_of_the_urgent_task_is_reached_but_for_the_start_of_the_section():
    for section in range(1, 10):
        experiment = MutualExclusion(section=section, interrupt=1)
        for way in ("critical section", "suspended"):
            assert experiment.run()[way].high.blocked == section - 0.5 and experiment.bounds(way)[0] == section


def test_whom_the_start_values_hold_up():
    seen = MutualExclusion().values()
    assert [seen[f"H waits, {way}"] for way in WAYS] == [3.5, 3.5, 0]
    assert [seen[f"S waits, {way}"] for way in WAYS] == [4, 2.5, 2.5]
    assert [seen[f"interrupt held, {way}"] for way in WAYS] == [3.5, 0, 0]


@settings(max_examples=40)
@given(TimerTask.strategy())
def test_beats_come_in_order_and_none_is_lost(experiment):
    result = experiment.run()
    assert result.late.min() >= 0 and (result.called[1:] >= result.called[:-1]).all() and len(result.called) == 11
    if experiment.priority > 3:  # nobody but the other callback holds up a beat
        assert result.late.max() == (0 if experiment.made_by == "task" else experiment.report)
        assert result.control == experiment.control + (experiment.report if experiment.made_by == "callback" else 0)
    if experiment.priority < 3:  # wheel_ctrl does, and is held up by nobody
        assert result.control == experiment.control
        assert experiment.made_by == "task" or result.late.max() > experiment.report
        assert result.late.max() >= experiment.control
    assert (
        experiment.measure("beats at once")
        == 1 + (result.late[:-1] >= BEAT).any() + (result.late[:-2] >= 2 * BEAT).any() + (result.late[:-3] >= 3 * BEAT).any()
    )


def test_what_waits_in_a_callback_holds_up_timers_but_no_task():
    computes, waits = TimerTask().run(), TimerTask(made_by="waiting callback").run()
    assert waits.late.tolist() == computes.late.tolist() and waits.late.max() == 6
    assert (computes.control, waits.control) == (9, 3)


def test_the_exercise_asks_the_model():
    answers = [TimerTask(priority=p, made_by=by) for p in range(1, 6) for by in ("callback", "waiting callback", "task")]
    assert [a for a in answers if check_prompt_beats(a).solved] == [
        TimerTask(priority=4, made_by="task"),
        TimerTask(made_by="task"),
    ]
    assert not check_prompt_beats(TimerTask(made_by="task", report=1)).solved
    assert not check_prompt_beats("TimerTask(made_by='task')").solved
