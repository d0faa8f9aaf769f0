"""Notebook 10: one radio, four ways of telling the others (source 2, T4), and what a larger omission degree buys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric, View
from labkit.figures import BLUE, GREY, INK, ORANGE, SKY, VERMILION, Bar, Curve, axis, curves, held, lengths, stack, stacked
from labkit.network import BYTE_NS, FRAME_NS, WAYS, Conversation, GilbertElliott, Loss, Way, converse, fragment_count, reaches_all

MS = 1_000_000
MESSAGES = 120  # about so many packets could be sent in a run
PARTS = {"delivered to all": BLUE, "to a smaller group": SKY, "lost for all": GREY, "disagreement": VERMILION}
DEGREES = range(1, 6)

Stations = Annotated[int, Interval(ge=2, le=10), Doc("stations in the group")]
LossShare = Annotated[int, Interval(ge=0, le=60), Unit("%"), Doc("share of the transmissions that a receiver loses")]
Burst = Annotated[int, Interval(ge=1, le=50), Unit("times"), Doc("length of a run of losses; 1: as without memory")]
Bytes = Annotated[int, Interval(ge=0, le=6000), Doc("of a message; 1483 fit into one packet")]
RoundTime = Annotated[int, Interval(ge=10, le=100), Unit("ms"), Doc("time in which each station is asked once")]
Seed = Annotated[int, Interval(ge=0, le=99), Doc("another one draws other losses")]


def channel(loss: int, burst: int) -> Loss:
    """Losses of so many percent in runs so many times as long as those without memory."""
    return GilbertElliott.bursts(loss / 100, burst)


class GroupCommunication(Experiment[Mapping[Way, Conversation]]):
    """How do you tell everybody the same?

    Stations send one message after the other over an access point. Four ways: say it once; ask every receiver for an
    acknowledgement; collect acknowledgements with the next answers; and do that all or nothing.
    """

    headline: ClassVar[tuple[str, ...]] = ("delivered to all", "disagreements", "latest delivery")
    stations: Stations = 4
    loss: LossShare = 10
    burst: Burst = 1
    omission_degree: Annotated[int, Interval(ge=1, le=5), Doc("OD: a packet is sent OD + 1 times at most")] = 2
    bytes: Bytes = 722
    round_time: RoundTime = 20
    seed: Seed = 1

    def run(self) -> Mapping[Way, Conversation]:
        rounds = MESSAGES // self.stations
        loss = channel(self.loss, self.burst)
        return {
            way: converse(
                way, self.stations, self.omission_degree, self.bytes, rounds, self.round_time * MS, loss=loss, seed=self.seed
            )
            for way in WAYS
        }

    def figure(self, result: Mapping[Way, Conversation]) -> dict[str, Any]:
        bars = [Bar(WAYS[way], shares(said)) for way, said in result.items()]
        outcome = stacked(
            bars, PARTS, axis("share of the messages [%]", range=[0, 100]), title="What becomes of a message", left=212, width=1.6
        )
        bounds = [said.bound_ns / MS for said in result.values()]
        latest = [None if said.latest_ns() is None else (said.latest_ns() or 0) / MS for said in result.values()]
        late = axis("latest delivery [ms]", range=[0, held(1.4 * max(bounds), coarse=True)])
        # what a message would need with three transmissions per packet and nothing lost, eight times
        whole = fragment_count(self.bytes) * 3 * FRAME_NS + 2 * self.bytes * BYTE_NS
        price = axis("per message [ms]", range=[0, held(8 * whole / MS, coarse=True)])
        return stack(
            [
                outcome,
                lengths(latest, bounds, BLUE, late, "ms", title="How late at most", left=40),
                lengths([air(said) for said in result.values()], None, ORANGE, price, "ms", title="Air time", left=40),
            ],
            height=400,
            keys=("bound by analysis",),
            barmode="stack",
        )

    def metrics(self, result: Mapping[Way, Conversation]) -> list[Metric]:
        group, plain = result["agreed"], result["plain"]
        to_all, smaller, lost, _ = shares(group)
        latest, wrong = group.latest_ns(), group.disagreements()
        fits = group.round_ns <= self.round_time * MS + self.stations
        return [
            Metric("delivered to all", to_all, "%", note="all or nothing: of the messages, to every station"),
            Metric(
                "disagreements", wrong, good=wrong == 0, note="delivered by one in the group and not by another, or out of order"
            ),
            Metric(
                "latest delivery",
                None if latest is None else latest / MS,
                "ms",
                bound=group.bound_ns / MS,
                note="nothing was delivered" if latest is None else "after it was offered first",
            ),
            Metric("lost for all", lost, "%"),
            Metric("to a smaller group", smaller, "%", note="to all in the group; the others had left it, and knew"),
            Metric("left the group", group.left, "times"),
            Metric("messages", len(group.sent)),
            Metric(
                "bandwidth used", 100 * group.air_ns / group.elapsed_ns, "%", note="share of the time in which somebody sends"
            ),
            Metric("bandwidth, plain", 100 * plain.air_ns / plain.elapsed_ns, "%", note=f"for {len(plain.sent)} messages"),
            Metric("disagreements, plain", plain.disagreements()),
            Metric("disagreements, acknowledged", result["acknowledged"].disagreements()),
            Metric("disagreements, no verdict", result["at once"].disagreements()),
            Metric(
                "round", group.round_ns / MS, "ms", good=None if fits else False, note="as long as it needs, if more than asked"
            ),
        ]


def shares(said: Conversation) -> tuple[float, ...]:
    """What becomes of the messages in %, in the order of `PARTS`."""
    counts = (said.to_all(), said.smaller_group(), said.to_none(), said.disagreements())
    return tuple(100 * count / len(said.sent) for count in counts)


def air(said: Conversation) -> float | None:
    """Time on the air in ms for each message that all delivered; None if there is none."""
    return said.air_ns / MS / said.to_all() if said.to_all() else None


@dataclass(frozen=True)
class Degrees:
    """For each of `DEGREES`: share delivered to all in % and latest delivery in ms (None: none), beside formula and bound."""

    formula: list[float]
    share: list[float]
    latest: list[float | None]
    bound: list[float]


class OmissionDegrees(Experiment[Degrees]):
    """What does one more repetition buy?

    The same messages with an omission degree of 1 to 5, all or nothing. The formula is for losses without memory: how likely a
    packet that is sent OD + 1 times reaches all the others.
    """

    stations: Stations = 4
    loss: LossShare = 20
    burst: Burst = 1
    round_time: RoundTime = 20
    wanted: Annotated[int, Interval(ge=50, le=99), Unit("%"), View(), Doc("share that has to reach all")] = 99
    seed: Seed = 1

    def run(self) -> Degrees:
        loss = channel(self.loss, self.burst)
        rounds = MESSAGES // self.stations
        told = [
            converse("agreed", self.stations, degree, 722, rounds, self.round_time * MS, loss=loss, seed=self.seed)
            for degree in DEGREES
        ]
        return Degrees(
            [100 * reaches_all(self.loss / 100, degree, self.stations - 1) for degree in DEGREES],
            [shares(said)[0] for said in told],
            [None if (latest := said.latest_ns()) is None else latest / MS for said in told],
            [said.bound_ns / MS for said in told],
        )

    def figure(self, result: Degrees) -> dict[str, Any]:
        x = axis("omission degree OD", range=[0.8, 5.2], dtick=1)
        wanted = Curve("wanted", [0.8, 5.2], [self.wanted] * 2, INK, "dot")
        formula = Curve("reaches all, by formula", DEGREES, result.formula, GREY, "dash")
        share = Curve("delivered to all, simulated", DEGREES, result.share, BLUE)
        bound = Curve("bound", DEGREES, result.bound, GREY, "dash")
        latest = Curve("latest delivery, simulated", DEGREES, result.latest, BLUE)
        top = max(result.bound)
        return stack(
            [
                curves([formula, share, wanted], x, axis("share of the messages [%]", range=[-3, 103]), title="What it buys"),
                curves(
                    [bound, latest],
                    x,
                    axis("delay [ms]", range=[0, held(1.05 * top, coarse=True)]),
                    title="What it costs",
                    legend=False,
                    left=90,
                ),
            ],
            height=420,
        )

    def metrics(self, result: Degrees) -> list[Metric]:
        enough = [i for i, share in enumerate(result.formula) if share >= self.wanted]
        first = enough[0] if enough else None
        return [
            Metric(
                "degree needed, by formula",
                None if first is None else DEGREES[first],
                note="without memory: (1 - p^(OD+1))^m" if enough else "more than 5",
            ),
            Metric("bound at that degree", None if first is None else result.bound[first], "ms", note="" if enough else "none"),
            Metric(
                "delivered to all there", None if first is None else result.share[first], "%", note="simulated" if enough else "-"
            ),
            Metric("delivered to all, OD 1", result.share[0], "%"),
            Metric("delivered to all, OD 5", result.share[-1], "%"),
            Metric("bound, OD 1", result.bound[0], "ms"),
            Metric("bound, OD 5", result.bound[-1], "ms"),
        ]


def check_degree(answer: GroupCommunication) -> Feedback:
    """Exercise: at 20 % loss without bursts, five stations: at least 97 % to all, and everything within 400 ms."""
    if (answer.stations, answer.loss, answer.burst, answer.bytes) != (5, 20, 1, 722):
        return Feedback(False, "keep 5 stations, 20 % loss, no bursts and 722 bytes; change omission degree and round time")
    found = [answer.replace(seed=seed).run()["agreed"] for seed in range(3)]
    share = sum(shares(said)[0] for said in found) / 3
    bound = found[0].bound_ns / MS
    if found[0].round_ns > answer.round_time * MS + answer.stations:
        return Feedback(False, f"a round does not fit into {answer.round_time} ms; it takes {found[0].round_ns / MS:.1f} ms")
    if share < 97:
        return Feedback(False, f"{share:.1f} % of the messages reach all, over three seeds")
    if bound > 400:
        return Feedback(False, f"the bound is {bound:.0f} ms: (4 OD + 1) rounds")
    return Feedback(True, f"{share:.1f} % reach all, over three seeds, and every delivery comes within {bound:.0f} ms")


def check_bursts(answer: GroupCommunication) -> Feedback:
    """Exercise: bursts that break the assumption; the same mean loss without them does not."""
    calm = answer.replace(burst=1)
    if answer.burst == 1 or answer.loss > 10:
        return Feedback(False, "use bursts, and at most 10 % loss")
    hurt, whole = shares(answer.run()["agreed"])[0], shares(calm.run()["agreed"])[0]
    if whole < 98:
        return Feedback(False, f"without bursts only {whole:.0f} % reach all; the bursts should be to blame")
    if hurt > 80:
        return Feedback(False, f"with bursts {hurt:.0f} % still reach all; fewer than 80 % is asked for")
    return Feedback(
        True, f"{whole:.0f} % reach all without bursts, {hurt:.0f} % with them, at the same mean loss of {answer.loss} %"
    )
