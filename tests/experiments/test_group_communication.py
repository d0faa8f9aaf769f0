"""Notebook 10's experiments: what the metrics promise, the story that is told, and the exercises with their solutions."""

import json
import re
from pathlib import Path

import pytest

import labkit.experiments as lab
from labkit.experiments import (
    GroupCommunication,
    LossPatterns,
    OmissionDegrees,
    OneLoss,
    check_bursts,
    check_degree,
    check_leaves,
    check_two_generals,
)
from labkit.experiments.group_communication import PARTS
from labkit.experiments.group_patterns import LONGEST, MOST_STEPS, power, story, to_the_end
from labkit.network import Group, every_pattern, play

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "10_group_communication.ipynb"


def test_the_parameters_and_metrics_have_their_names():
    assert GroupCommunication.name() == "group-communication"
    names = [p.name for p in GroupCommunication.parameters()]
    assert names == ["stations", "loss", "burst", "omission_degree", "bytes", "round_time", "seed"]
    values = GroupCommunication().values()
    assert {"delivered to all", "lost for all", "disagreements", "latest delivery", "bandwidth used"} <= values.keys()
    assert values["disagreements"] == 0


@pytest.mark.parametrize("seed", range(4))
def test_worst_sliders_lose_for_all_and_never_disagree(seed):
    worst = GroupCommunication(stations=6, loss=60, burst=20, omission_degree=1, seed=seed)
    said = worst.run()
    values = {metric.name: metric.value for metric in worst.metrics(said)}
    assert values["disagreements"] == 0
    assert values["delivered to all"] + values["lost for all"] + values["to a smaller group"] == pytest.approx(100)
    assert said["plain"].disagreements() + said["at once"].disagreements() > 0


def test_the_shares_of_each_way_fill_the_bar():
    experiment = GroupCommunication(loss=40)
    figure = experiment.figure(experiment.run())
    parts = [trace["x"] for trace in figure["data"] if trace.get("name") in PARTS]
    assert len(parts) == 4 and [sum(row) for row in zip(*parts)] == pytest.approx([100] * 4)
    assert figure["layout"]["barmode"] == "stack"


def test_a_larger_degree_buys_share_and_costs_delay():
    result = OmissionDegrees().run()
    assert result.formula == sorted(result.formula) and result.share[-1] > result.share[0]
    assert result.bound == pytest.approx([20 * (4 * degree + 1) for degree in range(1, 6)])
    assert all(latest <= bound for latest, bound in zip(result.latest, result.bound) if latest is not None)


def test_one_lost_acknowledgement_costs_a_round_and_a_repetition():
    assert OneLoss(missing="nothing").values()["cost"] == 0
    for stations, slot, cost in ((2, 1, 2), (3, 2, 3), (3, 1, 2)):  # of three, one waits for S2 anyway
        values = OneLoss(stations=stations, slot=slot).values()
        assert values["cost"] == cost and values["times sent"] == 2
    lost_for_good = OneLoss(missing="to S1", slot=0, rounds=5)
    assert lost_for_good.values()["delivered by all after"] is None


@pytest.mark.parametrize("delivery", ["agreed", "at once", "silence is no", "silence is yes"])
def test_the_story_ends_as_the_search_says(delivery):
    experiment = LossPatterns(delivery=delivery)
    result = experiment.run()
    says = experiment.figure(result)["layout"]["meta"]["says"]
    assert ("disagree" in says) == (delivery != "agreed")
    hops, states = story(result.worst, 2)
    assert len(states) == len(hops) + 1
    assert {hop.slot for hop in hops} == set(range(result.found.slots))
    assert any("takes A for rejected" in hop.text for hop in hops) == (delivery == "silence is no")
    delivers = {i for turn in result.worst for i, _ in turn.delivered}
    assert {i for i in (0, 1) if states[-1][i + 1] == "accepted, delivered"} == delivers


def steps_of(experiment):
    """How many steps the picture tells."""
    says = experiment.figure(experiment.run())["layout"]["meta"]["says"]
    return int(re.match(r"Step (\d+) of \1, .*; nothing changes any more$", says)[1])


def test_the_step_slider_is_as_long_as_the_longest_story():
    """In every story of the pattern with one loss the slider's end is the end; in some of three stations it is its last step."""
    experiments = [
        OneLoss(missing=missing, slot=slot, rounds=rounds, stations=stations, omission_degree=degree)
        for missing in ("poll", "answer", "to S0", "to S1", "to S2")
        for slot in (0, 1, 2, 5, 8)
        for rounds in (1, 3, 5)
        for stations, degree in ((2, 1), (3, 1), (3, 2))
    ]
    assert max(map(steps_of, experiments)) == LONGEST < MOST_STEPS
    assert steps_of(OneLoss(missing="nothing")) == 6 and steps_of(OneLoss(slot=8)) == 27, "with the loss, though it costs nothing"


def test_a_story_ends_with_the_slot_after_which_nobody_learns_anything():
    whole = story(play(Group(2, 1), 1, frozenset()), 2)
    hops, states = to_the_end(*whole)
    assert hops == whole[0][: len(hops)] and states == whole[1][: len(states)] and len(states) == len(hops) + 1
    assert set(whole[1][len(hops) :]) == {states[-1]} and states[-1] != states[-1 - 3]


def test_a_lost_transmission_has_a_cross_and_nothing_follows_a_lost_poll():
    hops, _ = story(play(Group(2, 1), 1, frozenset({(0, "poll"), (1, "answer"), (2, 1)})), 2)
    by_slot = {slot: [hop for hop in hops if hop.slot == slot] for slot in range(3)}
    assert len(by_slot[0]) == 2 and by_slot[0][0].lost == (1,)
    assert by_slot[1][1].lost == (0,) and by_slot[2][2].lost == (2,)
    assert by_slot[2][2].carries == "the packet"


def test_huge_counts_are_readable():
    assert power(99_999) == "99999" and power(12**10) == "6.19 · 10¹⁰"


def test_exercises_refuse_what_is_beside_the_point():
    assert not check_degree(GroupCommunication(stations=5, loss=10, omission_degree=3)).solved
    assert not check_degree(GroupCommunication(stations=5, loss=20, omission_degree=3, round_time=40)).solved
    assert not check_bursts(GroupCommunication(loss=30, burst=10)).solved
    assert not check_two_generals(LossPatterns(adversary="assumption", delivery="at once")).solved
    assert not check_leaves(set()).solved and not check_leaves({(0, "poll"), (2, "poll")}).solved
    found = every_pattern(Group(2, 1))
    assert check_leaves(set(found.losses["delivered by those who stayed"])).solved


def solutions() -> list[str]:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    folded = re.findall(r"<details>.*?</details>", text, flags=re.S)
    return [code for part in folded for code in re.findall(r"`(check_\w+\(.*?\))`", part)]


def test_there_is_a_solution_for_each_exercise():
    assert len(solutions()) == 4


@pytest.mark.parametrize("code", solutions())
def test_the_folded_solutions_solve(code):
    names = {name: getattr(lab, name) for name in re.findall(r"\b(?:check_\w+|[A-Z]\w+)\b", code)}
    assert eval(code, names).solved


def test_the_cells_of_the_exercises_are_not_solved_yet():
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = [line for cell in cells if cell["cell_type"] == "code" for line in "".join(cell["source"]).splitlines()]
    calls = [line for line in code if line.startswith("check_")]
    names = {name: getattr(lab, name) for call in calls for name in re.findall(r"\b(?:check_\w+|[A-Z]\w+)\b", call)}
    assert len(calls) == 4 and not any(eval(call, names).solved for call in calls)


def test_no_card_of_one_loss_knows_the_end_before_it():
    end = steps_of(OneLoss())
    assert set(OneLoss(step=end - 1).values().values()) == {None} and None not in OneLoss(step=end).values().values()
