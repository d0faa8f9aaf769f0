"""Experiment 1 of the diploma thesis on several stations: the laser chain on each of them, one radio, and what their fusion sees.

What is published: the windows, no deadline missed on two stations. Not published, and parameters here: how late a scan is after
the window of the input has begun, as the mirror of the scanner has to come round (`mirror_ns`); the drift of the clocks, and how
wrong their readings are; the size of what is sent; the losses of the radio. Each station's load is drawn for itself
(`laser_chain.laser_load`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.checks import whole
from labkit.network import Correction, Group, GroupMail, Loss, Plan, period_starts
from labkit.phases.distributed import OVERHEAD, CommunicationUnit, DataObject, FusionUnit, Team
from labkit.phases.framework import Organiser, Unit
from labkit.phases.laser_chain import MS, PERIOD_NS, contour_model, laser_chain, laser_load
from labkit.phases.windows import Part, phases_of
from labkit.trace import jobs

SENDS, FUSES = "LMSCommunication", "LMSContourFusion"
STEPS = 4  # results of a main part


@dataclass(frozen=True, eq=False)
class LaserTeam:
    """What the team did.

    Attributes:
        team: after its run. bound_ns: of the delivery of a data object. window_ns: the window of the communication.
        apart_ns: for each fusion the difference between the timestamps it used; -1 where a station's data had not come at all.
        missed: deadlines missed, of all stations. left: how often a station left the group.
    """

    team: Team
    bound_ns: int
    window_ns: int
    apart_ns: np.ndarray
    missed: int
    left: int

    def coherent(self, threshold_ns: int) -> float:
        """The share of fusions that had the data of all, with timestamps that differ by no more than this (5.1)."""
        return float(np.mean((self.apart_ns >= 0) & (self.apart_ns <= threshold_ns))) if len(self.apart_ns) else 0.0


def laser_team(
    stations: int = 2,
    periods: int = 400,
    correction: Correction = "absolute",
    drift_ppm: float = 2.14,
    offset_ns: int = 0,
    reading_ns: int = 10_000,
    mirror_ns: int = 13 * MS,
    omission_degree: int = 1,
    size: int = 722,
    loss: Loss | None = None,
    seed: int = 1,
    skip: frozenset[str] = frozenset(),
) -> LaserTeam:
    """Run the chain of table 5 on several stations.

    Args:
        correction: how the periods are kept together.
        drift_ppm: the clock of station i is fast by i times that. offset_ns: and it starts so much later, i times.
        reading_ns: largest error of a reading of the clocks. mirror_ns: the longest wait for a scan.
        size: bytes of a data object.
        skip: phases that hand their input on.
    Raises:
        ValueError: a number out of bounds, or a phase that does not exist.
    """
    whole(stations, 2, "the number of stations", 16)
    whole(periods, 1, "the number of periods", 100_000)
    rng = np.random.default_rng([seed, 10])
    index = np.arange(stations)
    plan = Plan(PERIOD_NS)
    errors = rng.integers(-reading_ns, reading_ns, (periods, stations), endpoint=True)
    ppb = np.round(index * drift_ppm * 1000).astype(np.int64)
    starts = period_starts(plan, correction, ppb, errors, index * offset_ns)
    chain = laser_chain()
    organisers = []
    for station in range(stations):
        load = laser_load(chain, periods, contour_model(), True, seed * 100 + station, 1)
        organisers.append(Organiser(_units(chain, load), PERIOD_NS, plan.reserve_ns))
    team = Team(organisers, starts, skip)
    window = next(w for w in organisers[0].windows if w.phase == SENDS).deadline_ns
    group = Group(stations, omission_degree)
    mail = GroupMail(group, size + OVERHEAD, window // (group.bound_rounds + 1), team.deliver, loss, seed)
    waits = rng.integers(0, mirror_ns, (periods, stations), endpoint=True)
    stamped, payload = waits + errors, bytes(size)
    fused = team.run(mail, lambda station, period, now: DataObject(station, now + int(stamped[period, station]), payload))
    apart = np.array([-1 if (d := one.apart_ns(stations)) is None else d for one in fused], np.int64)
    missed = sum(int(np.sum(found.missed & (found.job < periods))) for found in (jobs(o.trace()) for o in organisers))
    return LaserTeam(team, mail.bound_ns, window, apart, missed, mail.left)


def _units(chain: list[Part], load: np.ndarray) -> list[Unit]:
    """The phases as units; in each period a part takes what `load` says for it."""
    units: list[Unit] = []
    communication: CommunicationUnit | None = None
    column = 0
    for phase, parts in phases_of(chain).items():
        if phase == SENDS:
            communication = CommunicationUnit(phase, parts[0].ecet_ns, parts[0].wcet_ep_ns)
            units.append(communication)
        elif phase == FUSES:
            assert communication is not None, "the communication comes before the fusion"
            units.append(FusionUnit(phase, communication, _joined, parts[0].ecet_ns, parts[0].wcet_ep_ns))
        else:
            units.append(_working(phase, parts, load[:, column : column + len(parts)]))
        column += len(parts)
    return units


def _joined(objects: Mapping[int, DataObject]) -> DataObject:
    """All data in one, as old as the oldest of them."""
    return DataObject(
        -1, min(item.timestamp_ns for item in objects.values()), b"".join(item.payload for item in objects.values())
    )


def _working(phase: str, parts: list[Part], load: np.ndarray) -> Unit:
    """A unit that hands its input on after the time that is drawn for it."""
    unit = Unit(phase)
    for part, times in zip(parts, load.T, strict=True):
        unit.add(_main(iter(times.tolist())), part.ecet_ns, part.wcet_ep_ns, exception=None, name=part.name)
    last: list[Any] = [None]

    def hand_on(unit: Unit, results: dict[str, Any]) -> None:
        found = [result for result in results.values() if result is not None]
        last[0] = found[0] if found else last[0]
        unit.make_output_available(last[0])

    unit.last_action(hand_on)
    return unit


def _main(times: Iterator[int]) -> Callable[[Any], Generator[tuple[int, Any], None, None]]:
    def main(data: Any) -> Generator[tuple[int, Any], None, None]:
        time = next(times)
        for step in range(STEPS):
            yield max(1, time * (step + 1) // STEPS - time * step // STEPS), data

    return main
