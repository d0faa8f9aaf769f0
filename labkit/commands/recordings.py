"""What happened: logs and other recordings of tasks."""

from __future__ import annotations

import argparse
import json

from labkit.commands.command import Add, print_json


def _trace(args: argparse.Namespace) -> None:
    from labkit.trace import describe, export_chrome, export_csv, export_npz, read_recording, statistics

    trace, report = read_recording(args.log, clock_hz=args.clock_hz)
    table = statistics(trace)
    if args.export:
        writers = {".json": export_chrome, ".csv": export_csv, ".npz": export_npz}
        ending = args.export[args.export.rfind(".") :]
        if ending not in writers:
            raise ValueError(f"--export {args.export}: the ending says the format, it is one of {', '.join(writers)}")
        writers[ending](trace, args.export)
    if args.json:
        cores = {"": table} if trace.core is None else {core: rows.droplevel("core") for core, rows in table.groupby("core")}
        rows = {core: json.loads(part.to_json(orient="index")) for core, part in cores.items()}
        print_json({"statistics": rows.get("", rows), "report": report.as_dict()})  # with several cores, by core, then by name
        return
    print(describe(table))
    print(report)


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("trace", _trace, "statistics of a log of '<name> <us> <0|1> [core]' lines, and its repairs")
    c.add_argument("log")
    c.add_argument(
        "--clock-hz", type=int, metavar="HZ", help="clock of the 32-bit cycle counter behind the stamps, to undo its wrap"
    )
    c.add_argument("--json", action="store_true")
    c.add_argument("--export", metavar="OUT", help="OUT.json for Perfetto or chrome://tracing, OUT.csv or OUT.npz for the events")
