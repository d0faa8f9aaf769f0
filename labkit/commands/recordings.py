"""What happened: logs and other recordings of tasks."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING

from labkit.commands.command import Add, print_json
from labkit.outside import one_line

if TYPE_CHECKING:
    from labkit.trace import Trace


def _trace(args: argparse.Namespace) -> None:
    from labkit.trace import describe, read_recording, statistics

    trace, report = read_recording(args.log, clock_hz=args.clock_hz)
    if args.core is not None:
        trace = _core(trace, args.core)
    table = statistics(trace)
    if args.export:
        _export(trace, args.export)
    fitted = _fit(trace, args.fit) if args.fit else ""
    if args.json:
        cores = {"": table} if trace.core is None else {core: rows.droplevel("core") for core, rows in table.groupby("core")}
        rows = {core: json.loads(part.to_json(orient="index")) for core, part in cores.items()}
        print_json({"statistics": rows.get("", rows), "report": report.as_dict()})  # with several cores, by core, then by name
        return
    print(describe(table))
    print(report)
    if fitted:
        print(fitted)


def _core(trace: Trace, number: int) -> Trace:
    cores = trace.cores()
    if number not in cores:
        raise ValueError(f"--core {number}: there are {', '.join(map(str, cores))}")
    return replace(cores[number], core=None)


def _export(trace: Trace, path: str) -> None:
    from labkit.trace import export_chrome, export_csv, export_npz

    writers = {".json": export_chrome, ".csv": export_csv, ".npz": export_npz}
    ending = path[path.rfind(".") :]
    if ending not in writers:
        raise ValueError(f"--export {path}: the ending says the format, it is one of {', '.join(writers)}")
    writers[ending](trace, path)


def _fit(trace: Trace, path: str) -> str:
    """Write the task set that was measured; returns what to say of it."""
    from labkit.scheduler import fitted

    try:
        made = fitted(trace)
    except ValueError as error:
        raise ValueError(f"--fit: {error}{' with --core' if trace.core is not None else ''}") from None
    with open(path, "w", encoding="utf-8") as file:
        json.dump(made, file, indent=1, ensure_ascii=False)
        file.write("\n")
    left = "".join(f"\n  left out: {one_line(name)}, {why}" for name, why in made["left_out"].items())
    return f"{path}: {len(made['tasks'])} tasks, times in {made['unit']}{left}"


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("trace", _trace, "statistics of a recording of tasks, and what was repaired or left out")
    c.add_argument(
        "log",
        help="a log of '<name> <us> <0|1> [core]' lines, ftrace's text, BTF, Chrome or Perfetto JSON, or what --export wrote; "
        "recognised by its content",
    )
    c.add_argument(
        "--clock-hz",
        type=int,
        metavar="HZ",
        help="clock of the 32-bit cycle counter behind the stamps of a log, to undo its wrap",
    )
    c.add_argument("--core", type=int, metavar="N", help="of this core only")
    c.add_argument("--json", action="store_true")
    c.add_argument("--export", metavar="OUT", help="OUT.json for Perfetto or chrome://tracing, OUT.csv or OUT.npz for the events")
    c.add_argument(
        "--fit", metavar="TASKS.json", help="write the tasks that were measured, with C, T and jitter, for labkit schedule"
    )
