"""Notebook 08: windows against table 5, six designs, experiment 1, exercises."""

import pytest
from hypothesis import given, settings

from labkit.data import published_table
from labkit.experiments.taft_phases import (
    PhaseWindows,
    SixDesigns,
    Timeliness,
    check_chain,
    check_few_aborts,
    check_period,
    published_ends,
)
from labkit.phases.windows import Part
from labkit.trace import jobs

MS = 1_000_000


def test_table_5_is_reproduced_to_the_nanosecond_but_for_its_swapped_digits():
    made = PhaseWindows().run()
    printed = published_table("diplom_table5_windows.csv")["deadline_ns"].tolist()[:8]
    assert [p - w.deadline_ns for p, w in zip(printed, made, strict=True)] == [0, 0, 63, 0, 0, 0, 0, 0]
    assert [p - w.end_ns for p, w in zip(published_ends(), made, strict=True)] == [0, 0, 63, 63, 63, 63, 63, 0]


@settings(max_examples=60)
@given(PhaseWindows.strategy())
def test_windows_conserve_the_period_or_say_what_is_missing(experiment):
    result = experiment.run()
    demand = sum(p.demand_ns for p in experiment.chain())
    room = (experiment.period - experiment.reserve) * MS
    if demand <= room:
        assert sum(w.deadline_ns for w in result) == room and all(w.spare_ns >= 0 for w in result)
    else:
        assert f"{demand - room} ns too short" in result
        assert {m.name: m.value for m in experiment.metrics(result)}["spare"] == (room - demand) / MS


@settings(max_examples=15)
@given(SixDesigns.strategy())
def test_windows_keep_all_four_promises_under_any_load(experiment):
    run = experiment.run().runs["taft windows"]
    demand = 94.1 + experiment.arcs_ecet - 30 + 2
    if experiment.period < demand:
        assert "too short" in run
    else:
        assert all(g.kept for g in run.guarantees)


def test_every_other_design_breaks_a_promise_at_the_start_values():
    start = SixDesigns()
    runs = start.run().runs
    broken = {design: [g.name for g in run.guarantees if not g.kept] for design, run in runs.items()}
    assert broken == {
        "edf thread": ["G2", "G3"],
        "taft thread": ["G3"],
        "taft thread, wcet": ["G3"],
        "taft phases": ["G4"],
        "taft releases": ["G2", "G4"],
        "taft windows": [],
    }
    assert [d for d, run in runs.items() if not run.verdict.accepted] == ["edf thread", "taft thread, wcet"]


def test_a_click_on_a_broken_promise_leads_to_its_first_period():
    start = SixDesigns()
    result = start.run()
    targets = next(trace["meta"]["set"] for trace in start.figure(result)["data"] if "meta" in trace)
    assert len(targets) == 24
    for number, target in enumerate(targets):
        guarantee = result.runs[target["design"]].guarantees[number % 4]
        assert target.get("period_shown") == guarantee.period
        SixDesigns(**target)


@settings(max_examples=10)
@given(Timeliness.strategy())
def test_no_deadline_is_missed_whatever_the_run_times(experiment):
    result = experiment.run()
    assert result.missed == 0 and result.other_aborts == 0


def test_a_longer_expected_time_aborts_less_and_an_idle_filter_at_most_every_second_period():
    counts = [Timeliness(arcs_ecet=ms).run().aborted_periods for ms in (10, 20, 30)]
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]
    assert Timeliness(scan_again=False).run().aborted_periods * 2 == Timeliness().run().aborted_periods


def test_exercises_ask_the_model():
    assert (
        not check_period(96).solved and check_period(97).solved and not check_period(100).solved and not check_period("97").solved
    )
    assert not check_few_aborts(Timeliness()).solved and check_few_aborts(None).solved
    assert "does not fit" in str(check_few_aborts(Timeliness(arcs_ecet=40)))
    chain = [Part("Read", "Read", 2 * MS, MS // 10), Part("Filter", "Filter", 5 * MS, MS // 10)]
    assert not check_chain(chain, 10).solved
    assert check_chain([*chain, Part("Send", "Send", MS, MS // 10)], 10).solved
    assert "too short" in str(check_chain(chain, 5))


def test_a_chain_without_phases_is_refused():
    with pytest.raises(ValueError):
        PhaseWindows(period=10)
    assert not check_chain([], 10).solved


def test_margins_are_those_of_the_jobs_and_what_was_aborted_ends_within_an_exception_part_of_its_deadline():
    result = Timeliness().run()
    left = Timeliness.margins(result)
    table = jobs(result.run.trace)
    assert sum(map(len, left.values())) == len(result.chain) * 400
    assert min(times.min() for times in left.values()) == Timeliness().measure("least left before a deadline") >= 0
    aborted = table.abort >= 0
    late = (table.deadline - table.completion)[aborted]
    assert aborted.any() and late.max() <= 2 * max(part.wcet_ep_ns for part in result.chain)
