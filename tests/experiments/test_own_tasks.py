"""Notebook 07's table: text to rows to tasks, verdicts that agree with the command line, and every mistake a sentence."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.experiments.own_tasks import HZ, MOST_JOBS, MOST_TASKS, OwnTaskSet, Ruled
from labkit.experiments.task_table import FIELDS, cells, text_of
from labkit.scheduler import POLICIES, schedule
from labkit.trace import jobs


def test_tables_as_spreadsheets_copy_them():
    plain = [("a", "2", "5", "", "", "", "", ""), ("b", "4", "7", "6", "", "", "", "")]
    assert cells("a\t2\t5\nb\t4\t7\t6\n") == cells("a, 2, 5; b, 4, 7, 6") == plain
    assert cells("Task\tPeriod [ms]\tWCET (ms)\tDeadline\r\na\t5\t2\t\r\nb\t7\t4\t6\r\n") == plain
    assert cells("") == [] and cells(" ; \n") == []


@given(st.lists(st.tuples(*[st.text("ab1 ", max_size=4)] * len(FIELDS)), max_size=5))
def test_text_and_rows_turn_into_each_other(rows):
    wanted = [tuple(" ".join(cell.split()) for cell in row) for row in rows if any(cell.strip() for cell in row)]
    assert cells(text_of(rows)) == wanted


tasks = st.builds(
    lambda period, c, d, offset, ecet, ep: (period, min(c, d, period), min(d, period), offset, ecet, ep),
    *(st.integers(2, 30), st.integers(1, 8), st.integers(1, 30), st.integers(0, 9), st.integers(1, 4), st.integers(0, 2)),
)


@settings(max_examples=40, deadline=None)
@given(st.lists(tasks, min_size=1, max_size=4))
def test_verdicts_are_those_of_labkit_schedule_and_no_response_exceeds_its_bound(drawn):
    rows = [(f"t{i}", c, t, d, o, min(ecet, c), ep) for i, (t, c, d, o, ecet, ep) in enumerate(drawn)]
    mine = OwnTaskSet(tasks=text_of([*map(str, row), ""] for row in rows))
    result = mine.run()
    for policy in POLICIES:
        now = result.ruled[policy]
        if not isinstance(now, Ruled):
            with pytest.raises(ValueError):
                schedule(mine.data(), policy, 10)
            continue
        assert now.verdict == schedule(mine.data(), policy, 1)[0]
        assert now.verdict["accepted"] <= (not any(now.missed.values()))
        for name, bound in now.bound.items():
            assert bound is None or now.longest[name] <= bound
        assert sum(now.missed.values()) == jobs(now.history.trace).missed.sum()


@pytest.mark.parametrize(
    ("text", "row", "sentence"),
    [
        ("a, 2", 0, "T missing"),
        (", 2, 5", 0, "name missing"),
        ("a, 2.5, 5", 0, "C is '2.5'; whole numbers only (choose a finer unit for parts of one)"),
        ("a, 0, 5", 0, "C is 0; a whole number from 1"),
        ("a, 2, -5", 0, "T is -5; a whole number from 1"),
        ("a, 2, 5; a, 1, 9", 1, "another task has this name"),
        ("a, 6, 5, , , 1, 0", 0, "not under RM, DM, EDF: C 6 exceeds its D 5 by 1"),
        ("a, 2, 5, , , 3, 0", 0, "not under TAFT: ECET 3 exceeds the C 2"),
        ("a, 2, 5", 0, "not under TAFT: no ECET"),
        ("a, 2, 5, , , 1, 1, 1 x", 0, "times is 'x'"),
        ("a, 99999999999999999999, 5", 0, "C is '99999999999999999999'"),
    ],
)
def test_a_mistake_is_a_sentence_beside_its_row(text, row, sentence):
    experiment = OwnTaskSet(tasks=text)
    result = experiment.run()
    assert sentence in result.wrong[row]
    for policy in POLICIES:
        view = experiment.replace(policy=policy)
        assert view.figure(result)["data"] and len(view.metrics(result)) == 5


@given(st.text("ab,;\t\n 0123-.x", max_size=60))
@settings(max_examples=60, deadline=None)
def test_no_text_crashes_or_takes_long(text):
    experiment = OwnTaskSet(tasks=text)
    result = experiment.run()
    experiment.figure(result), experiment.metrics(result)
    assert all(len(now.history.releases) <= 2 * MOST_JOBS for now in result.ruled.values() if isinstance(now, Ruled))


def test_too_many_tasks_are_told():
    many = "; ".join(f"t{i}, 1, 99" for i in range(MOST_TASKS + 1))
    assert OwnTaskSet(tasks=many).run().ruled["rm"] == f"{MOST_TASKS + 1} tasks; there have to be 1 to {MOST_TASKS}"


def test_files_come_and_go_unchanged():
    start = OwnTaskSet(unit="us", tasks="a, 2, 5, 4, 1, 1, 1, 1 2 1; b, 4, 70")
    assert OwnTaskSet.from_json(start.to_json()) == start
    assert json.loads(start.to_json())["tasks"][1] == {"name": "b", "wcet": 4, "period": 70}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "is not JSON"),
        ("[]", "is no task set"),
        ('{"tasks": [1]}', "is no task set"),
        ('{"tasks": [{"nme": "a"}]}', "has a task with a field 'nme'; there are name, wcet"),
        ('{"tasks": [], "unit": "h"}', "has the unit 'h'; there are ms, us, ns"),
    ],
)
def test_files_that_are_no_task_sets_are_refused_with_a_sentence(text, sentence):
    with pytest.raises(ValueError, match=r"the text .*") as told:
        OwnTaskSet.from_json(text)
    assert sentence in str(told.value)


def test_time_is_that_of_the_unit():
    for unit, hz in HZ.items():
        assert OwnTaskSet(unit=unit).run().ruled["rm"].history.trace.hz == hz
