"""A SICK LMS 200 on a robot: a mirror that turns 75 times a second, and what comes of it.

- One rotation takes 13.32 ms and measures once per degree; 0.5 degrees are two rotations, shifted by half a degree, 0.25 degrees
  are four. Neighbouring beams are 13.32 ms apart, so that what moves is seen twice, like the teeth of a comb.
- Resolution 10 mm, statistical error 5 mm (1 sigma, up to 8 m), systematic error up to 15 mm, range 80 m (10 m at 10 %
  reflectivity).
- A telegram has 10 bytes and 2 per value; over the serial link a byte is 10 bits, so that 361 values take 191 ms at 38 400 baud.
- A spot that falls half on something near and half on what is behind gives a distance between the two ("mixed pixel").

A choice of ours: the order of the four rotations, a spot of a quarter of a degree, a mixed distance drawn evenly between the two.
Reflectivity, glass and the sun are left out. Source: SICK, telegram listing 8007954 and technical description 8008970.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labkit.fusion.laser.formats import Points, Pose, Scan
from labkit.fusion.laser.world import SECOND, World

ROTATION_NS = 13_320_000
ROTATIONS = {1.0: 1, 0.5: 2, 0.25: 4}
HEADER_BYTES, BITS = 10, 10  # of a telegram; of a byte on the line
MIXED_FROM = 0.05  # m between near and far from which a reading is mixed


@dataclass(frozen=True)
class Scanner:
    """A scanner's settings and errors.

    Attributes:
        resolution_deg: 0.25, 0.5 or 1. view_deg: 1 to 180, half of it on either side of the heading.
        noise_m: standard deviation of a distance. offset_m: what every distance is too long. step_m: what it is rounded to.
        range_m: from which distance nothing comes back. spot_deg: width of the beam, 0 for no mixed pixels.
        baud: speed of the serial link.
    """

    resolution_deg: float = 0.5
    view_deg: int = 180
    noise_m: float = 0.005
    offset_m: float = 0.0
    step_m: float = 0.01
    range_m: float = 80.0
    spot_deg: float = 0.25
    baud: int = 38_400

    def __post_init__(self) -> None:
        allowed = {
            "resolution_deg": (self.resolution_deg in ROTATIONS, "0.25, 0.5 or 1"),
            "view_deg": (0 < self.view_deg <= 180, "1 to 180"),
            "noise_m": (0 <= self.noise_m < np.inf, "a number of at least 0"),
            "offset_m": (abs(self.offset_m) < np.inf, "a finite number"),
            "step_m": (0 <= self.step_m < np.inf, "a number of at least 0"),
            "range_m": (0 < self.range_m < np.inf, "a number above 0"),
            "spot_deg": (0 <= self.spot_deg <= 1, "0 to 1"),
            "baud": (self.baud > 0, "a number above 0"),
        }
        for name, (fine, words) in allowed.items():
            if not fine:
                raise ValueError(f"the scanner's {name} is {getattr(self, name)!r}; {words} is allowed")

    @property
    def values(self) -> int:
        """Distances in one scan: 361 for 180 degrees at 0.5."""
        return round(self.view_deg / self.resolution_deg) + 1

    @property
    def scan_ns(self) -> int:
        """Time of the rotations of one scan."""
        return ROTATIONS[self.resolution_deg] * ROTATION_NS

    @property
    def link_ns(self) -> int:
        """Time of one telegram on the link."""
        return (2 * self.values + HEADER_BYTES) * BITS * SECOND // self.baud

    def angles(self) -> np.ndarray:
        """Of the beams, in rad from the heading, from right to left."""
        return np.deg2rad(np.arange(self.values) * self.resolution_deg - self.view_deg / 2)

    def rotation(self) -> np.ndarray:
        """In which rotation each beam is measured, from 0."""
        return np.arange(self.values) % ROTATIONS[self.resolution_deg]

    def beam_ns(self, start_ns: int) -> np.ndarray:
        """When each beam is measured, in a scan that starts at `start_ns`."""
        degrees = np.arange(self.values) * self.resolution_deg
        return start_ns + self.rotation() * ROTATION_NS + np.rint(degrees / 360 * ROTATION_NS).astype(np.int64)


def scan(world: World, scanner: Scanner, carrier: str, start_ns: int, rng: np.random.Generator) -> Scan:
    """One scan from the robot `carrier`. Its time is the middle between its first and its last beam, its pose that of the robot
    at this time: what the robot moves meanwhile bends the scan.

    Raises:
        ValueError: the world has no such body.
    """
    own = world.index(carrier)
    angles, times = scanner.angles(), scanner.beam_ns(start_ns)
    middle = int(times.min() + times.max()) // 2
    poses = world.bodies[own].motion.at(times)
    spot = np.deg2rad(scanner.spot_deg) / 2
    rays = (0.0, -spot, spot) if spot else (0.0,)
    found, seen = world.cast(
        np.tile(poses[:, :2], (len(rays), 1)),
        np.concatenate([angles + poses[:, 2] + beside for beside in rays]),
        np.tile(times, len(rays)),
        own,
    )
    spots = np.minimum(found, 2 * scanner.range_m).reshape(len(rays), -1)
    near, far = spots.min(axis=0), spots.max(axis=0)
    mixed = (far - near > MIXED_FROM) & (far < scanner.range_m) & (np.ptp(seen.reshape(len(rays), -1), axis=0) > 0)
    share, noise = rng.uniform(size=len(angles)), rng.normal(size=len(angles))  # drawn whether needed or not: one beam, one draw
    ranges = np.where(mixed, near + share * (far - near), found[: len(angles)])
    lost = ranges >= scanner.range_m
    ranges = ranges + scanner.offset_m + scanner.noise_m * noise
    if scanner.step_m:
        ranges = np.rint(ranges / scanner.step_m) * scanner.step_m
    ranges = np.where(lost, np.inf, np.maximum(ranges, 0))
    pose = Pose(*map(float, world.bodies[own].motion.at(middle)))
    ready = start_ns + scanner.scan_ns + scanner.link_ns
    hits = np.where(lost | mixed, -1, seen[: len(angles)])
    return Scan(carrier, middle, pose, angles, ranges, times, hits, ready)


def points(scanned: Scan) -> Points:
    """Where the beams ended, in the frame of the field; those that did not come back, are negative or no number are left out."""
    there = np.isfinite(scanned.ranges) & (scanned.ranges > 0)
    angle, distance = scanned.angles[there] + scanned.pose.heading, scanned.ranges[there]
    xy = np.stack([scanned.pose.x + distance * np.cos(angle), scanned.pose.y + distance * np.sin(angle)], axis=1)
    step = float(np.median(np.diff(scanned.angles))) if len(scanned.angles) > 1 else 0.0
    here = np.array([[scanned.pose.x, scanned.pose.y]])
    return Points(scanned.station, scanned.time_ns, xy, np.zeros(len(xy), np.int64), here, step, scanned.seen[there])
