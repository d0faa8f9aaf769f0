"""The fusion of measurements."""

from __future__ import annotations

import argparse
from typing import Any

from labkit.commands.command import Add, print_json


def _track(args: argparse.Namespace) -> None:
    from labkit.fusion import (
        GlobalNearest,
        JointCompatible,
        NearestFirst,
        Rule,
        consistency_band,
        read_measurements,
        track,
        write_estimates,
    )

    rules: dict[str, Any] = {
        "global": lambda: GlobalNearest(args.gate),
        "joint": lambda: JointCompatible(args.gate),
        "source": lambda: NearestFirst(args.a_max, 3 * args.sigma if args.e_max is None else args.e_max),
    }
    rule: Rule = rules[args.association]()
    read = read_measurements(args.measurements, args.sigma)
    found = track(read.measurements, args.model, args.q, rule, confirm=args.confirm, drop=args.drop)
    with open(args.out, "w", encoding="utf-8", newline="") as file:
        write_estimates(found.rows(), file)
    report = {
        "measurements": len(read.measurements),
        "used": len(read.measurements) - found.unused,
        "unused": found.unused,
        "moved": read.moved,
        "copies": read.copies,
        "ignored_columns": read.ignored,
        "tracks": [
            {
                "track": number,
                "measurements": len(one.steps),
                "first_s": one.steps[0].measurement.time,
                "last_s": one.steps[-1].measurement.time,
                "mean_nis": one.mean_nis(),
            }
            for number, one in enumerate(found.tracks, 1)
        ],
    }
    if args.json:
        print_json(report)
        return
    print(
        f"{report['measurements']} measurements, {report['used']} used, {len(found.tracks)} track{'s' * (len(found.tracks) != 1)}"
    )
    for text, value in (
        ("of tracks that were dropped unconfirmed: {}", found.unused),
        ("rows that stood after one of a later time, sorted: {}", read.moved),
        ("copies of a row, left out: {}", read.copies),
        ("columns that nobody asked for: {}", ", ".join(map(ascii, read.ignored))),
    ):
        if value:
            print(f"    {text.format(value)}")
    for number, one in enumerate(found.tracks, 1):
        first, last = one.steps[0].measurement.time, one.steps[-1].measurement.time
        line = f"    track {number}: {len(one.steps)} measurements from {first:g} to {last:g} s"
        if (nis := one.mean_nis()) is not None:
            low, high = consistency_band(2, len(one.steps) - 1)
            line += f", mean NIS {nis:.2f} ({low:.2f} to {high:.2f} if sigma and q fit)"
        print(line)


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("track", _track, "follow moving elements through measurements of any stations with a Kalman filter")
    c.add_argument("measurements", metavar="MEASUREMENTS.csv", help="columns t_s, x_m, y_m, station, rows in any order")
    c.add_argument(
        "--model", choices=("cp", "cv", "ca"), default="cv", help="constant position, velocity or acceleration (%(default)s)"
    )
    c.add_argument("--q", type=float, required=True, metavar="Q", help="density of the white noise: m^2/s, m^2/s^3 or m^2/s^5")
    c.add_argument("--sigma", type=float, required=True, metavar="S", help="standard deviation of a measurement per axis in m")
    c.add_argument("--out", required=True, metavar="ESTIMATES.csv", help="one row per measurement used, after its update")
    c.add_argument(
        "--association",
        choices=("global", "source", "joint"),
        default="global",
        help="global nearest neighbour (default), the source's most recent first, or joint compatibility",
    )
    c.add_argument("--gate", type=float, default=0.999, metavar="SHARE", help="of true measurements let through (%(default)s)")
    c.add_argument("--a-max", type=float, default=1.0, metavar="A", help="source's gate: acceleration in m/s^2 (%(default)s)")
    c.add_argument("--e-max", type=float, metavar="E", help="source's gate: largest error in m (default: 3 S)")
    c.add_argument("--confirm", type=int, default=3, metavar="N", help="measurements that confirm a track (%(default)s)")
    c.add_argument(
        "--drop", type=int, default=5, metavar="N", help="measurements of another track that end one without any (%(default)s)"
    )
    c.add_argument("--json", action="store_true")
