"""Notebook 10: every pattern of losses in a small group, and the worst of them told step by step (source 2, T4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Interval
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View, progress
from labkit.figures import Hop, sequence
from labkit.network import DELIVERIES, OUTCOMES, Adversary, Delivery, Found, Group, Lost, Turn, every_pattern, play

MOST_STEPS = 81  # three stations, an omission degree of 2: 27 slots of three transmissions
LONGEST = 63  # the longest story of `OneLoss`: three stations, and the last loss in slot 20
ALL, NONE, LEFT, DISAGREE = OUTCOMES
ADVERSARIES = {"assumption": "OD in a row, at most", "anything": "whatever it likes"}
SHOWN = {"worst": "that ends worst", "latest": "with the latest delivery"}
TIMES = ("first", "second", "third")


@dataclass(frozen=True)
class Told:
    """What all patterns come to, and the two patterns that can be shown, slot by slot."""

    found: Found
    worst: tuple[Turn, ...]
    latest: tuple[Turn, ...]


class LossPatterns(Experiment[Told]):
    """Which losses make a group disagree?

    Station 0 has a packet, A. All patterns of losses are tried until it is decided and told; the one that ends worst, with the
    fewest losses that do it, is told step by step.
    """

    slow: ClassVar[bool] = True
    headline: ClassVar[tuple[str, ...]] = ("patterns", "disagreements", "latest delivery")
    step: Annotated[int, Interval(ge=0, le=MOST_STEPS), View(play=True), Doc("how many transmissions have happened")] = MOST_STEPS
    delivery: Annotated[Delivery, Labels(DELIVERIES), Doc("when a station hands a packet on")] = "agreed"
    adversary: Annotated[Adversary, Labels(ADVERSARIES), Doc("what the adversary may lose")] = "anything"
    shown: Annotated[Literal["worst", "latest"], Labels(SHOWN), View(), Doc("which pattern is shown")] = "worst"
    stations: Annotated[int, Interval(ge=2, le=3), Doc("stations in the group")] = 2
    omission_degree: Annotated[int, Interval(ge=1, le=2), Doc("OD: a packet is sent OD + 1 times at most")] = 1

    @classmethod
    def strategy(cls) -> Any:
        """The largest group takes a while, and differs in nothing but its size."""
        return super().strategy().map(lambda drawn: drawn.replace(omission_degree=1) if drawn.stations == 3 else drawn)

    def run(self) -> Told:
        group = Group(self.stations, self.omission_degree, self.delivery)
        found = every_pattern(group, self.adversary, watch=progress)
        worst = next(outcome for outcome in reversed(OUTCOMES) if outcome in found.losses)
        return Told(found, play(group, 1, found.losses[worst]), play(group, 1, found.latest_losses))

    def figure(self, result: Told) -> dict[str, Any]:
        turns = result.worst if self.shown == "worst" else result.latest
        return picture(turns, self.stations, self.step)

    def metrics(self, result: Told) -> list[Metric]:
        found = result.found
        wrong, left = found.outcomes[DISAGREE], found.outcomes[LEFT]
        worst = next(outcome for outcome in reversed(OUTCOMES) if outcome in found.losses)
        rounds = None if found.latest is None else found.latest / self.stations
        return [
            Metric("patterns", power(found.patterns), note=f"all of {found.slots} slots, in {found.situations} situations"),
            Metric(
                "disagreements", power(wrong), good=wrong == 0, note="patterns after which one has delivered and another has not"
            ),
            Metric(
                "latest delivery", rounds, "rounds", bound=found.group.bound_rounds, note="after the packet was offered first"
            ),
            Metric("delivered by all", 100 * found.outcomes[ALL] / found.patterns, "%", note="of the patterns, not of the time"),
            Metric("delivered by none", 100 * found.outcomes[NONE] / found.patterns, "%"),
            Metric("delivered by those who stayed", 100 * left / found.patterns, "%", note="who left cannot agree, and knows it"),
            Metric("fewest losses for the worst", len(found.losses[worst]), note=f"the worst that happens: {worst}"),
        ]


WHAT = {
    "nothing": "nothing",
    "poll": "the poll",
    "answer": "the answer",
    "to S0": "the broadcast to S0",
    "to S1": "the broadcast to S1",
    "to S2": "the broadcast to S2",
}


class OneLoss(Experiment[tuple[Turn, ...]]):
    """What does one lost transmission cost?

    Station 0 has a packet, A, for the others. One transmission is lost, in one slot or in the same slot of several rounds in a
    row.
    """

    step: Annotated[int, Interval(ge=0, le=LONGEST), View(play=True), Doc("how many transmissions have happened")] = LONGEST
    missing: Annotated[
        Literal["nothing", "poll", "answer", "to S0", "to S1", "to S2"], Labels(WHAT), Doc("the transmission that is lost")
    ] = "answer"
    slot: Annotated[int, Interval(ge=0, le=8), Doc("in which slot; slot k belongs to station k mod the number of stations")] = 1
    rounds: Annotated[int, Interval(ge=1, le=5), Doc("in so many rounds in a row")] = 1
    stations: Annotated[int, Interval(ge=2, le=3), Doc("stations in the group")] = 2
    omission_degree: Annotated[int, Interval(ge=1, le=2), Doc("OD: a packet is sent OD + 1 times at most")] = 1

    def without_effect(self) -> Mapping[str, str]:
        idle = {"slot": "when something is lost", "rounds": "when something is lost"}
        return idle if self.missing == "nothing" else {}

    def run(self) -> tuple[Turn, ...]:
        what: Any = int(self.missing[-1]) if self.missing.startswith("to S") else self.missing
        slots = range(self.slot, self.slot + self.rounds * self.stations, self.stations)
        lost = frozenset() if self.missing == "nothing" else frozenset((slot, what) for slot in slots)
        return play(Group(self.stations, self.omission_degree), 1, lost)

    def figure(self, result: tuple[Turn, ...]) -> dict[str, Any]:
        return picture(result, self.stations, self.step)

    def metrics(self, result: tuple[Turn, ...]) -> list[Metric]:
        when = [turn.slot + 1 for turn in result for _ in turn.delivered]
        least = self.stations  # without a loss the last acknowledgement comes in the last slot of the first round
        over = self.step >= len(to_the_end(*story(result, self.stations))[0])  # no card knows how a story ends
        complete = over and len(when) == self.stations
        why = "" if complete else "not all deliver it" if over else "at the end of the story"
        sent = [turn for turn in result if turn.said.packet is not None]
        left = {i for turn in result for i in turn.left}
        return [
            Metric(
                "delivered by all after",
                max(when) if complete else None,
                "slots",
                bound=Group(self.stations, self.omission_degree).bound_rounds * self.stations,
                note=why or "after it was offered first",
            ),
            Metric("cost", max(when) - least if complete else None, "slots", note=why or "against nothing lost"),
            Metric("times sent", len(sent) if over else None, note="" if over else why),
            Metric("left the group", len(left) if over else None, "stations", note="" if over else why),
        ]


def picture(turns: tuple[Turn, ...], stations: int, step: int) -> dict[str, Any]:
    """The sequence diagram of a played pattern, up to a step, or to where nothing changes any more."""
    hops, states = to_the_end(*story(turns, stations))
    step = min(step, len(hops))
    now = f"Step {step} of {len(hops)}, slot {hops[step - 1].slot}: {hops[step - 1].text}" if step else "Nothing has happened yet"
    end = f". {ending(states[-1])}; nothing changes any more" if step == len(hops) else ""
    return sequence(["access point", *(f"S{i}" for i in range(stations))], hops, states, step, now + end)


def to_the_end(hops: list[Hop], states: list[tuple[str, ...]]) -> tuple[list[Hop], list[tuple[str, ...]]]:
    """A story without the slots after the last one in which anybody learns something, or something is lost."""
    last = max((hop.slot for hop, before, after in zip(hops, states, states[1:]) if hop.lost or after != before), default=0)
    count = sum(hop.slot <= last for hop in hops)
    return hops[:count], states[: count + 1]


def power(count: int) -> str:
    """A count that may be huge, for a reader."""
    if count < 100_000:
        return str(count)
    exponent = len(str(count)) - 1
    return f"{count / 10**exponent:.2f} · 10{str(exponent).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def ending(states: tuple[str, ...]) -> str:
    """What the stations have come to."""
    known = states[1:]
    if "accepted, delivered" in known and any("left" in state for state in known):
        return "Delivered by those who stayed; who has left knows it"
    if len(set(known)) > 1:
        return "The stations disagree, and none of them knows it"
    return "All have delivered it" if known[0] == "accepted, delivered" else "Nobody delivers it"


def story(turns: tuple[Turn, ...], stations: int) -> tuple[list[Hop], list[tuple[str, ...]]]:
    """The transmissions of a played pattern, and what everybody knows: at the begin and after each of them."""
    state = ["nothing", "holds it and waits", *["nothing"] * (stations - 1)]
    hops, states, sent = [], [tuple(state)], 0

    def add(hop: Hop) -> None:
        hops.append(hop)
        states.append(tuple(state))

    for turn in turns:
        source = turn.slot % stations + 1
        polled, name = turn.answer is not None, f"S{source - 1}"
        add(Hop(turn.slot, 0, (source,) * polled, (source,) * (not polled), "", f"asks {name}{'' if polled else ': lost'}"))
        if turn.answer is not None:
            words, what = _answered(turn)
            lost = "" if turn.heard else ": lost"
            add(Hop(turn.slot, source, (0,) * turn.heard, (0,) * (not turn.heard), what, f"{name} {words}{lost}"))
        if turn.said.taken[0][1] == 0:
            verdict = turn.said.verdict(0) if turn.said.first == 0 else state[0] == "accepted, delivered"
            state[0] = "holds it and waits" if verdict is None else "accepted, delivered" if verdict else "nothing"
        sent += turn.said.packet is not None
        words, what = _said(turn, sent)
        delivers, waited = [i for i, _ in turn.delivered], [state[i + 1] == "holds it and waits" for i in range(stations)]
        for i in range(stations):
            state[i + 1] = _known(turn, i, state[i + 1], i in delivers)
        words += "".join(f"; S{i} delivers A" for i in delivers) + "".join(f"; S{i} leaves" for i in turn.left)
        if turn.said.first:
            words += "".join(f"; S{i} takes A for rejected" for i in range(stations) if waited[i] and state[i + 1] == "nothing")
        heard = tuple(i + 1 for i in sorted(turn.received))
        deaf = tuple(i + 1 for i in range(stations) if i not in turn.received)
        add(Hop(turn.slot, 0, heard, deaf, what, words))
    return hops, states


def _known(turn: Turn, station: int, before: str, delivers: bool) -> str:
    """What a station knows after the broadcast."""
    if station in turn.left:
        return "has left the group"
    if delivers or before == "accepted, delivered":
        return "accepted, delivered"
    if station not in turn.received or before == "has left the group":
        return before
    if turn.said.first > 0 or turn.said.verdict(0) is False:
        return "nothing"  # rejected, or taken for it, as nobody tells the verdict any more
    return "holds it and waits" if turn.said.packet is not None else before


def _answered(turn: Turn) -> tuple[str, str]:
    answer = turn.answer
    assert answer is not None, "there is an answer"
    if answer.joins:
        return "asks to be let in", ""
    if answer.offer is not None:
        return "offers A", "the packet"
    return ("acknowledges A", "") if answer.holds else ("has nothing to say", "")


def _said(turn: Turn, sent: int) -> tuple[str, str]:
    said = turn.said
    if said.packet is not None:
        return f"A, for the {TIMES[sent - 1]} time", "the packet"
    verdict = said.verdict(0) if said.first == 0 and said.verdicts else None
    if verdict is None:
        return "no news", ""
    return ("A is accepted" if verdict else "A is rejected"), "the verdict"


def check_two_generals(answer: LossPatterns) -> Feedback:
    """Exercise: a delivery under which stations may disagree if anything may be lost."""
    if answer.adversary != "anything":
        return Feedback(False, "the adversary has to be free: whatever it likes")
    found = answer.run().found
    if DISAGREE not in found.losses:
        return Feedback(False, f"no pattern of {power(found.patterns)} makes this group disagree")
    return Feedback(True, f"{len(found.losses[DISAGREE])} losses are enough: {told(found.losses[DISAGREE])}")


def told(lost: Lost) -> str:
    """Losses in words."""
    words = {"poll": "the poll", "answer": "the answer"}
    parts = sorted(lost, key=lambda one: (one[0], str(one[1])))
    return ", ".join(f"slot {slot} {words.get(str(what), f'the broadcast to S{what}')}" for slot, what in parts)


def check_leaves(lost: Lost) -> Feedback:
    """Exercise: losses after which S0 delivers A in a group of two with an omission degree of 1, and S1 cannot, and knows it."""
    turns = play(Group(2, 1), 1, frozenset(lost))
    who = {i for turn in turns for i, _ in turn.delivered}
    left = {i for turn in turns for i in turn.left}
    if who != {0}:
        return Feedback(False, "both deliver it" if who else "nobody delivers it")
    if 1 not in left:
        return Feedback(False, "S1 is still in the group; that would be a disagreement")
    return Feedback(True, f"S0 delivers A, S1 does not and has left the group: {told(frozenset(lost))}")
