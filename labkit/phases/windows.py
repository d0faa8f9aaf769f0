"""Windows of a chain of phases within a period, in whole nanoseconds: equations 4.6 to 4.18, 5.6 to 5.8.

Every phase gets a share of the period in proportion to what its parts expect, ECET plus the exception part's WCET. The ends are
rounded down *cumulatively*: window i ends at floor((Period - Deadline_C) * sum of the first i demands / sum of all). So the
windows add up to the period exactly, no rounding error grows, and no window is shorter than its demand if the whole is not.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), sections 4.1, 4.2, 5.2. Its table 5 follows to the
nanosecond, but for two swapped digits: the communication window is 36 554 729 ns, printed as 36 554 792; the 63 ns run on in the
printed cumulative deadlines down to the last but one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from labkit.checks import whole


@dataclass(frozen=True)
class Part:
    """One sub-function of a phase: a main part with its expected time and an exception part with its worst case, in ns.

    `wcet_ns` is the longest time the main part may take, None if nobody knows; only designs that plan with worst cases need it.
    """

    phase: str
    part: str
    ecet_ns: int
    wcet_ep_ns: int
    wcet_ns: int | None = None

    def __post_init__(self) -> None:
        where = f"phase {self.phase!r}, part {self.part!r}"
        object.__setattr__(self, "ecet_ns", whole(self.ecet_ns, 1, f"{where}: ecet_ns"))
        object.__setattr__(self, "wcet_ep_ns", whole(self.wcet_ep_ns, 0, f"{where}: wcet_ep_ns"))
        if self.wcet_ns is None:
            return
        object.__setattr__(self, "wcet_ns", whole(self.wcet_ns, 1, f"{where}: wcet_ns"))
        over = self.ecet_ns - self.wcet_ns
        if over > 0:
            raise ValueError(
                f"{where}: the expected time {self.ecet_ns} ns exceeds the worst case {self.wcet_ns} ns by {over} ns"
            )

    @property
    def demand_ns(self) -> int:
        return self.ecet_ns + self.wcet_ep_ns

    @property
    def name(self) -> str:
        return self.phase if self.part == self.phase else f"{self.phase}.{self.part}"


@dataclass(frozen=True)
class Window:
    """Where a phase may run: from `release_ns` on for `deadline_ns`, relative to the start of the period; `end_ns` is their sum.

    `demand_ns` is the sum of ECET and EP of the parts, `spare_ns` the rest of the window.
    """

    phase: str
    release_ns: int
    deadline_ns: int
    end_ns: int
    demand_ns: int
    spare_ns: int


def phases_of(chain: Sequence[Part]) -> dict[str, list[Part]]:
    """Phase -> its parts, in the order of the chain; ValueError for an empty chain, a phase that comes twice, or a part that
    does.
    """
    if not chain:
        raise ValueError("the chain is empty; it needs at least one phase")
    phases: dict[str, list[Part]] = {}
    last = None
    for part in chain:
        if part.phase in phases and part.phase != last:
            raise ValueError(f"phase {part.phase!r} comes twice in the chain; its parts must follow each other")
        if any(part.part == other.part for other in phases.get(part.phase, ())):
            raise ValueError(f"phase {part.phase!r} has two parts called {part.part!r}")
        phases.setdefault(part.phase, []).append(part)
        last = part.phase
    return phases


def check_period(chain: Sequence[Part], period_ns: int, reserve_ns: int = 0) -> None:
    """Equation 4.14, with a reserve 5.6: Period >= sum of (ECET + WCET of EP) + Deadline_C.

    Raises:
        ValueError: it does not hold; the sentence names the phase at which the time runs out and the nanoseconds missing.
    """
    phases = phases_of(chain)
    period_ns = whole(period_ns, 1, "the period in ns")
    reserve_ns = whole(reserve_ns, 0, "the reserve in ns")
    room = period_ns - reserve_ns
    needed = sum(part.demand_ns for part in chain)
    if needed <= room:
        return
    used = accumulate(sum(part.demand_ns for part in parts) for parts in phases.values())
    phase = next(name for name, end in zip(phases, used, strict=True) if end > room)
    expected = sum(part.ecet_ns for part in chain)
    reserve = f" less the reserve of {reserve_ns} ns" if reserve_ns else ""
    also = f"; the expected times alone, {expected} ns, would fit, the exception parts do not" if expected <= room else ""
    raise ValueError(
        f"phase {phase!r} does not fit: the period of {period_ns} ns{reserve} is {needed - room} ns too short for "
        f"the {needed} ns that main and exception parts need{also}"
    )


def windows(chain: Sequence[Part], period_ns: int, reserve_ns: int = 0, release_ns: int = 0) -> list[Window]:
    """The fair split of the period, equations 4.12 (4.18, 5.7) and 4.13.

    Args:
        chain: the parts in order; those of one phase share its window (4.15, 4.16).
        reserve_ns: Deadline_C, kept free at the end of the period for clock correction.
        release_ns: Release(P1).

    Raises:
        ValueError: as `check_period`.
    """
    check_period(chain, period_ns, reserve_ns)
    phases = phases_of(chain)
    room, total = period_ns - reserve_ns, sum(part.demand_ns for part in chain)
    made, used, begin = [], 0, 0
    for phase, parts in phases.items():
        demand = sum(part.demand_ns for part in parts)
        used += demand
        end = room * used // total
        made.append(Window(phase, release_ns + begin, end - begin, release_ns + end, demand, end - begin - demand))
        begin = end
    return made


def check_windows(
    chain: Sequence[Part], manual: Sequence[tuple[str, int, int]], period_ns: int, reserve_ns: int = 0
) -> list[Window]:
    """Windows chosen by hand, (phase, release, deadline) relative to the period, checked by 4.8 to 4.11 and 4.17.

    Raises:
        ValueError: a phase has no window or two, a window overlaps the next (4.8), ends after the period less the reserve (4.9),
            or is shorter than its demand (4.17). The sentence names the phase and the nanoseconds.
    """
    phases = phases_of(chain)
    period_ns = whole(period_ns, 1, "the period in ns")
    names = [phase for phase, _, _ in manual]
    if names != list(phases):
        raise ValueError(
            f"windows for {', '.join(names) or 'no phase'}; the chain needs one each, in order, for {', '.join(phases)}"
        )
    made = []
    for i, (phase, release, deadline) in enumerate(manual):
        release = whole(release, 0, f"the release of phase {phase!r} in ns")
        deadline = whole(deadline, 1, f"the deadline of phase {phase!r} in ns")
        end, demand = release + deadline, sum(part.demand_ns for part in phases[phase])
        if i + 1 < len(manual) and end > manual[i + 1][1]:
            over = end - manual[i + 1][1]
            raise ValueError(f"the window of phase {phase!r} overlaps that of {manual[i + 1][0]!r} by {over} ns (4.8)")
        limit = manual[0][1] + period_ns - reserve_ns
        if end > limit:
            raise ValueError(f"the window of phase {phase!r} ends {end - limit} ns after the period less the reserve (4.9)")
        if demand > deadline:
            raise ValueError(f"the window of phase {phase!r} is {demand - deadline} ns too short for its {demand} ns (4.17)")
        made.append(Window(phase, release, deadline, end, demand, deadline - demand))
    return made
