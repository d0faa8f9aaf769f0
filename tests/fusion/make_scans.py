"""Writes the sample scans of data/examples: `scans.csv` and `scans_carmen.log`. Run it to write them again.

Both are made by the lab: a ball rolls past a robot and away from the scanner of a second one, at one scan in 200 ms.
"""

from pathlib import Path

import numpy as np

from labkit.fusion import Pose, Scan, Scanner, Straight, World, ball, field, robot, scan

EXAMPLES = Path(__file__).parents[2] / "data" / "examples"
POSE, BALL, SPEED = Pose(1.0, 2.5), Pose(2.0, 1.9), (0.25, 0.2)
MS = 1_000_000


def world(pose: Pose = POSE) -> World:
    others = [robot("R", Straight(Pose(4.0, 3.6, 0.5))), ball(Straight(BALL, *SPEED))]
    return field(8.0, 5.0, [robot("A", Straight(pose)), *others])


def scans(count: int, resolution: float) -> list[Scan]:
    rng = np.random.default_rng(11)
    return [scan(world(), Scanner(resolution_deg=resolution, range_m=6.0), "A", i * 200 * MS, rng) for i in range(count)]


def ranges(made: Scan, nothing: str, form: str = ".2f") -> list[str]:
    return [nothing if np.isinf(r) else format(r, form) for r in made.ranges]


def csv() -> str:
    made = scans(20, 1.0)
    header = ",".join(["time_ms", *(f"r{i}" for i in range(len(made[0].ranges)))])
    note = "# made by the lab: 20 scans over 180 degrees; nothing came back from beyond 6 m; the scanner stands at (1.0, 2.5)"
    return "\n".join([note, header, *(f"{one.time_ns / MS:.3f},{','.join(ranges(one, ''))}" for one in made), ""])


def carmen() -> str:
    """Both kinds of message, and two of other kinds. The host name is made up."""
    made = scans(4, 1.0)
    lines = [
        "# made by the lab, in the format of CARMEN",
        "PARAM robot_frontlaser_offset 0.0 0.0 lab 0.0",
        "ODOM 1.0 2.5 0 0 0 0 0.0 lab 0.0",
    ]
    for i, one in enumerate(made):
        seconds = f"{one.time_ns / 1e9:.6f}"
        pose = "1.000 2.500 0.000"
        if i % 2:
            head = f"ROBOTLASER1 0 {-np.pi / 2:.6f} {np.pi:.6f} {np.pi / 180:.9f} 6.0 0.01 0 {len(one.ranges)}"
            tail = f"0 {pose} {pose} 0 0 0 0 0 {seconds} lab {seconds}"
        else:
            head, tail = f"FLASER {len(one.ranges)}", f"{pose} {pose} {seconds} lab {seconds}"
        lines.append(" ".join([head, *ranges(one, "6.00"), tail]))
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    for name, text in (("scans.csv", csv()), ("scans_carmen.log", carmen())):
        (EXAMPLES / name).write_text(text, encoding="utf-8", newline="\n")
        print(f"wrote {name}")
