"""Tracks of several elements from the measurements of several stations, in order of time.

A look is what one station measured at one time. For each look the tracks are predicted to its time; confirmed tracks are
associated first, the others with what is left, and a measurement that fits none starts a track. Two measurements of one look that
are as near to each other as measurements of one place are (by the gate, `Rule.again`) count as two of one object.

- A track is *confirmed* by its third measurement (`confirm`).
- It is *dropped* when some other track has had five measurements (`drop`) since its own last one. That needs no time limit, so a
  gap in the data ends nothing, and an element that is alone is never dropped.
- What was dropped unconfirmed was a false detection. Only its measurements are not used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import groupby
from typing import NamedTuple

import numpy as np

from labkit.checks import whole
from labkit.fusion.association import GlobalNearest, Rule, pairs, squared_distance
from labkit.fusion.filters import Filter, Forecast, start
from labkit.fusion.kalman import MOTIONS, Model
from labkit.fusion.measurements import Measurement

#: Most tracks at one time, and most predictions of one call of `track`: about a minute of work.
MOST_TRACKS, MOST_PREDICTIONS = 1000, 20_000_000


class Step(NamedTuple):
    """A measurement that a track took, and what its filter says after it: `row` as in `Filter.row`.

    `nis` is its normalised innovation squared, the squared Mahalanobis distance from the forecast; the first one has none.
    """

    measurement: Measurement
    row: tuple[float, float, float, float, float, float]
    nis: float | None


@dataclass(eq=False)
class Track:
    """An element that is followed.

    Attributes:
        number: in order of the first measurement, from 1.
        filter: its state.
        steps: its measurements so far, with the estimates after them.
    """

    number: int
    filter: Filter
    steps: list[Step]
    _looks: deque[int] = field(repr=False)  # numbers of the looks that gave it a measurement, the last `drop` of them

    def mean_nis(self) -> float | None:
        """Mean of the normalised innovations squared: about 2 if sigma and q fit, whatever the truth is; None after one step."""
        found = [step.nis for step in self.steps if step.nis is not None]
        return sum(found) / len(found) if found else None


class Tracker:
    """Follows elements: `take` looks in order of time.

    Args:
        begin: the filter of a track after its first measurement.
        rule: which measurement belongs to which track.
        confirm: measurements that make a track believed.
        drop: measurements of another track, since the own last one, that end a track.

    Attributes:
        tracks: all that are followed, confirmed or not.
        ended: those that were dropped.
        predictions: how many there were, the work done so far.
    """

    def __init__(
        self, begin: Callable[[Measurement], Filter], rule: Rule | None = None, *, confirm: int = 3, drop: int = 5
    ) -> None:
        self.rule: Rule = rule or GlobalNearest()
        self.confirm, self.drop = whole(confirm, 1, "confirm"), whole(drop, 1, "drop")
        self.tracks: list[Track] = []
        self.ended: list[Track] = []
        self.predictions = 0
        self._begin = begin
        self._look = self._started = 0
        self._time = -np.inf

    def confirmed(self, track: Track) -> bool:
        """Whether the track has enough measurements to be believed."""
        return len(track.steps) >= self.confirm

    def take(self, look: Sequence[Measurement]) -> list[Track]:
        """Take what a station measured at one time, at least one measurement; the track of each of them.

        Raises:
            ValueError: the look is empty, of several times, or older than one before; there are too many tracks; the numbers are
                too far apart for double precision.
        """
        times = {m.time for m in look}
        if len(times) != 1 or (time := times.pop()) < self._time:
            raise ValueError("a look has measurements of one time, and is not older than the look before")
        self._time = time
        self._look += 1
        self.predictions += len(self.tracks)
        chosen: list[Track | None] = [None] * len(look)
        sure = [track for track in self.tracks if self.confirmed(track)]
        for group in (sure, [track for track in self.tracks if not self.confirmed(track)]):
            free = [i for i, track in enumerate(chosen) if track is None]
            if group and free:
                self._associate(group, [look[i] for i in free], free, chosen)
        served = [(m, track) for m, track in zip(look, chosen) if track]
        taken = [self._left_over(m, served) if track is None else track for m, track in zip(look, chosen)]
        for measurement, track in zip(look, taken):
            self._give(track, measurement)
        if len(self.tracks) > MOST_TRACKS:
            advice = "do sigma, q and speeds up to about 7 m/s fit?"
            raise ValueError(f"more than {MOST_TRACKS} tracks at {time:g} s, the most that are followed; {advice}")
        self._end_overtaken()
        return taken

    def _give(self, track: Track, measurement: Measurement) -> None:
        """Let a track have a measurement; one that is new has begun with it."""
        nis = None
        if track.steps:
            nis = squared_distance(track.filter.forecast(self._time), measurement)
            track.filter = track.filter.update(measurement)
        else:
            self.tracks.append(track)
        track.steps.append(Step(measurement, track.filter.row(), nis))
        if not track._looks or track._looks[-1] != self._look:
            track._looks.append(self._look)

    def _associate(self, group: list[Track], look: list[Measurement], free: list[int], chosen: list[Track | None]) -> None:
        found = pairs([track.filter.forecast(self._time) for track in group], look)
        owners = self.rule.owners(found, [self._time - track.filter.time for track in group])
        for i, owner in zip(free, owners.tolist()):
            if owner >= 0:
                chosen[i] = group[owner]

    def _left_over(self, measurement: Measurement, served: list[tuple[Measurement, Track]]) -> Track:
        """The track of a measurement that is left over: that of one of the same look in the same place, else a new one."""
        if self.rule.again and served:
            found = pairs([Forecast(m.x, m.y, m.xx, m.xy, m.yy) for m, _ in served], [measurement])
            allowed = self.rule.allowed(found, [0.0] * len(served))[:, 0]
            if allowed.any():
                return served[int(np.argmin(np.where(allowed, found.cost[:, 0], np.inf)))][1]
        self._started += 1
        track = Track(self._started, self._begin(measurement), [], deque(maxlen=self.drop))
        served.append((measurement, track))
        return track

    def _end_overtaken(self) -> None:
        """Drop every track that another one has overtaken by `drop` measurements."""
        mark = max((track._looks[0] for track in self.tracks if len(track._looks) == self.drop), default=0)
        if any(track._looks[-1] < mark for track in self.tracks):
            self.ended += [track for track in self.tracks if track._looks[-1] < mark]
            self.tracks = [track for track in self.tracks if track._looks[-1] >= mark]

    def all(self) -> list[Track]:
        """Every track but those dropped unconfirmed, in order of the first measurement."""
        kept = [track for track in self.ended if self.confirmed(track)] + self.tracks
        return sorted(kept, key=lambda track: track.number)


def looks(measurements: Iterable[Measurement]) -> Iterator[list[Measurement]]:
    """Measurements in order of time as looks: those of one time by station, in the order in which stations come."""
    for _, same in groupby(measurements, key=lambda m: m.time):
        stations: dict[str, list[Measurement]] = {}
        for m in same:
            stations.setdefault(m.station, []).append(m)
        yield from stations.values()


class Tracked(NamedTuple):
    """What `track` found: the tracks that were not dropped unconfirmed, and how many measurements those had that were."""

    tracks: list[Track]
    unused: int

    def rows(self) -> list[tuple[float | int, ...]]:
        """One row per measurement used, in order of time, in the columns of `labkit.fusion.ESTIMATE`; tracks count from 1."""
        found = [(step.measurement.time, n, *step.row) for n, track in enumerate(self.tracks, 1) for step in track.steps]
        return sorted(found, key=lambda row: row[0])


def track(
    measurements: Iterable[Measurement], model: Model, q: float, rule: Rule | None = None, *, confirm: int = 3, drop: int = 5
) -> Tracked:
    """Follow whatever is in the measurements, given in order of time.

    Args:
        model: cp, cv or ca. q: density of its white noise, per axis: m^2/s, m^2/s^3 or m^2/s^5.
        rule: association; global nearest neighbour if there is none.
        confirm, drop: as in `Tracker`.

    Raises:
        ValueError: an argument is not allowed, times go back, or it is more than `MOST_TRACKS` or `MOST_PREDICTIONS` allow.
    """
    if model not in MOTIONS:
        raise ValueError(f"model {model!r}; there are {', '.join(MOTIONS)}")
    if not 0 <= q <= 1e12:
        raise ValueError(f"q is {q}; 0 to 1e12 is allowed")
    tracker = Tracker(lambda first: start(model, q, first), rule, confirm=confirm, drop=drop)
    for look in looks(measurements):
        tracker.take(look)
        if tracker.predictions > MOST_PREDICTIONS:
            raise ValueError(f"more than {MOST_PREDICTIONS} predictions (looks x tracks), the most that are made; split the file")
    return Tracked(tracker.all(), sum(len(t.steps) for t in tracker.ended if not tracker.confirmed(t)))


class Reorderer:
    """Puts what comes late back into order: a heap that holds everything until it is `delay` seconds old.

    What comes when something younger has gone out already is dropped and counted. Without a delay nothing is held.

    Attributes:
        dropped: how many came too late.
    """

    def __init__(self, delay: float) -> None:
        if not delay >= 0:
            raise ValueError(f"the delay is {delay} s; a number of at least 0 is allowed")
        self.delay, self.dropped = delay, 0
        self._heap: list[tuple[float, int, Measurement]] = []
        self._count = 0
        self._out = -np.inf

    def push(self, now: float, measurement: Measurement) -> list[Measurement]:
        """A measurement arrives at the time `now`: those that are old enough to go out, in order of time."""
        if measurement.time < self._out:
            self.dropped += 1
        else:
            self._count += 1
            heappush(self._heap, (measurement.time, self._count, measurement))
        return self.pop(now - self.delay)

    def pop(self, until: float = np.inf) -> list[Measurement]:
        """All that were measured up to `until`; without it, all there are."""
        out = []
        while self._heap and self._heap[0][0] <= until:
            out.append(heappop(self._heap)[2])
        if out:
            self._out = out[-1].time
        return out
