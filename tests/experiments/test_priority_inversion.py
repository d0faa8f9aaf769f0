"""Notebook 01: the benches against the recorded kernel, the bounds, and their own exercises."""

import csv
import pathlib

import pytest
from hypothesis import given, settings

from labkit.experiments.mars_pathfinder import MarsPathfinder
from labkit.experiments.messages import QueueLab, SignalLab, check_shortest_queue
from labkit.experiments.nested_mutexes import NestedMutexes, check_prompt_middle
from labkit.experiments.priority_inversion import PriorityInversion, check_bound_reached, check_harmless_inversion
from labkit.experiments.start_here import ThreeTasks
from labkit.trace.folds import runs

ORACLE = pathlib.Path(__file__).parents[1] / "oracle" / "freertos"


def timeline_ms(run):
    ms = run.trace.hz // 1000
    return [
        (start // ms, end // ms, run.trace.names[task])
        for task, start, end in runs(run.trace).tolist()
        if run.trace.names[task] != "IDLE"
    ]


@pytest.mark.parametrize(
    ("protocol", "scenario"), [("semaphore", "01_inversion_binary_semaphore"), ("freertos", "02_inversion_mutex")]
)
def test_the_start_values_are_what_the_real_kernel_did(protocol, scenario):
    with open(ORACLE / f"{scenario}.timeline.csv", newline="") as file:
        recorded = [(int(r["start"]), int(r["end"]), r["task"]) for r in csv.DictReader(file) if r["task"] != "IDLE"]
    assert timeline_ms(PriorityInversion().simulate(protocol)) == recorded


@settings(max_examples=60)
@given(PriorityInversion.strategy())
def test_blocking_stays_below_its_bound_and_a_protocol_never_makes_it_longer(experiment):
    semaphore, mutex = experiment.run()
    assert semaphore.blocked <= experiment.bound("semaphore")
    assert mutex.blocked <= experiment.bound(experiment.protocol)
    assert experiment.protocol == "none" or experiment.bound(experiment.protocol) == experiment.hold


@settings(max_examples=40)
@given(NestedMutexes.strategy())
def test_the_late_drop_never_helps_the_middle_task(experiment):
    result = experiment.run()
    assert result["freertos"].response >= result["inheritance"].response or experiment.first_given == "B"


def test_pathfinder_resets_without_inheritance_only():
    result = MarsPathfinder().run()
    assert result["off"].resets == [625.0] and result["on"].resets == []


@settings(max_examples=40)
@given(MarsPathfinder.strategy())
def test_inheritance_never_adds_a_reset(experiment):
    result = experiment.run()
    assert len(result["on"].resets) <= len(result["off"].resets)


@settings(max_examples=40)
@given(QueueLab.strategy())
def test_items_of_a_queue_arrive_in_order_and_none_vanishes(experiment):
    result = experiment.run()
    received = result.received[:, 1].tolist()
    assert received == sorted(set(received))
    in_queue = int(experiment.fill(result)[1][-1])
    assert len(result.sent) == len(received) + len(experiment.overwritten(result)) + in_queue
    assert experiment.mode == "drop" or not len(result.dropped)


@settings(max_examples=40)
@given(SignalLab.strategy())
def test_only_a_semaphore_loses_events(experiment):
    metrics = {m.name: m.value for m in experiment.metrics(experiment.run())}
    assert metrics["raised"] == metrics["served"] + metrics["lost"] + metrics["not yet served at the end"]
    assert metrics["lost"] == 0 or not experiment.mechanism.startswith("notify")
    assert metrics["not yet served at the end"] >= 0


def test_a_cheaper_notification_wakes_the_handler_sooner():
    def latency(mechanism):
        return SignalLab(mechanism=mechanism, burst=1).measure("interrupt to handler, idle CPU")

    semaphore, notification = latency("binary"), latency("notify_clear")
    # 200 cycles of switch, 100 of entry and 50 of exit, and a give of 400 cycles, or of 400/1.45, at 216 MHz
    assert (semaphore, notification) == (pytest.approx((350 + 400) / 216), pytest.approx((350 + 276) / 216))


@settings(max_examples=40)
@given(ThreeTasks.strategy())
def test_the_longest_response_of_a_synchronous_start_is_the_computed_one(experiment):
    result = experiment.run()
    for task in experiment.tasks():
        bound = result.bound[task.name]
        if bound is not None and bound <= task.period / 1000:  # later jobs of a longer busy period may lie behind the window
            assert bound - 0.001 < result.longest[task.name] <= bound


def test_exercises_ask_the_model():
    assert not check_harmless_inversion(PriorityInversion()).solved
    assert not check_harmless_inversion(PriorityInversion(interference=0)).solved
    assert check_harmless_inversion(PriorityInversion(release_H=17, release_M=0)).solved
    assert check_harmless_inversion(PriorityInversion(release_H=7, release_M=7)).solved
    for dodge in ({"release_H": 0}, {"release_H": 20, "release_M": 0}, {"hold": 1, "release_H": 20}):
        assert not check_harmless_inversion(PriorityInversion(**dodge)).solved
    assert not check_bound_reached(PriorityInversion()).solved
    assert check_bound_reached(PriorityInversion(release_H=1)).solved
    assert not check_bound_reached(PriorityInversion(hold=1, release_H=20)).solved
    assert not check_bound_reached(PriorityInversion(release_H=1, protocol="ceiling")).solved
    assert not check_prompt_middle(NestedMutexes()).solved
    assert check_prompt_middle(NestedMutexes(first_given="B")).solved
    assert not check_prompt_middle(NestedMutexes(first_given="B", second=1)).solved
    assert [n for n in range(1, 13) if check_shortest_queue(QueueLab(length=n)).solved] == [11]
    assert not check_shortest_queue(QueueLab(length=11, mode="wait")).solved


@pytest.mark.parametrize("check", [check_harmless_inversion, check_bound_reached, check_prompt_middle, check_shortest_queue])
@pytest.mark.parametrize("answer", [None, 11, "PriorityInversion(release_H=7)", PriorityInversion, ThreeTasks()])
def test_an_answer_of_another_kind_gets_a_sentence(check, answer):
    feedback = check(answer)
    assert not feedback.solved and "it has to be a setting of the bench" in feedback.text


@settings(max_examples=60)
@given(PriorityInversion.strategy())
def test_marked_is_what_m_runs_while_h_waits(experiment):
    ms = 216_000
    for contest, protocol in zip(experiment.run(), ("semaphore", experiment.protocol), strict=True):
        assert contest.wrong_ms <= min(contest.blocked, experiment.interference)
        if protocol in ("freertos", "inheritance", "ceiling"):
            assert not len(contest.wrong)
        else:  # H is blocked by L's section and by what M runs in it, and by nothing else
            assert contest.blocked - contest.wrong_ms <= experiment.hold
            for start, end in contest.wrong.tolist():
                ran = [who for since, till, who in timeline_ms(contest.run) if since * ms < end and start < till * ms]
                assert ran == ["M"]


def test_the_start_values_are_marked_where_they_are_wrong():
    semaphore, mutex = PriorityInversion().run()
    assert (semaphore.wrong // 216_000).tolist() == [[5, 15]] and not len(mutex.wrong)
    found = NestedMutexes().run()
    assert (found["freertos"].wrong // 216_000).tolist() == [[5, 16]] and not len(found["inheritance"].wrong)
    assert not len(NestedMutexes(first_given="B").run()["freertos"].wrong)


def test_a_broken_promise_is_never_green():
    good = {m.name: m.good for m in PriorityInversion().metrics(PriorityInversion().run())}
    assert good["H blocked, semaphore"] is False and good["H blocked, mutex"] is True


def test_the_time_looked_at_is_told():
    def says(experiment):
        return experiment.figure(experiment.run())["layout"]["meta"]["says"]

    assert "Semaphore: H waits for S; M runs; L is ready and holds S. Mutex: H runs" in says(PriorityInversion(at=8))
    assert "FreeRTOS: H is ready and holds A; M is ready; L runs and holds B" in says(NestedMutexes(at=9))
    assert "bc_dist waits for select; comm runs; ASI_MET is ready and holds select" in says(MarsPathfinder(at=600))
    assert "3 in the queue, 1 lost. Last received: item 5, 5.8 ms old" in says(QueueLab(at=18))
    assert "handler runs. 4 raised, 1 begun to be served, 2 lost" in says(SignalLab(at=350))
