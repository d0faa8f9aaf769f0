"""The command line: every experiment without a notebook, and the models' file formats.

Exit code 0: done; 1: an error in the input, told in one sentence on standard error; 2: wrong usage.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any


def _print_json(value: Any) -> None:
    json.dump(value, sys.stdout, indent=1, ensure_ascii=False, default=lambda o: o.item() if hasattr(o, "item") else str(o))
    print()


def _list(args: argparse.Namespace) -> None:
    from labkit.experiments import experiments

    known = experiments()
    if args.json:
        _print_json(
            {
                name: {
                    "title": cls.title(),
                    "parameters": {
                        p.name: {"default": p.default, "unit": p.unit, "allowed": p.allowed(), "doc": p.doc}
                        for p in cls.parameters()
                    },
                }
                for name, cls in known.items()
            }
        )
        return
    for name, cls in known.items():
        print(f"{name}: {cls.title()}")
        for p in cls.parameters():
            print(f"    {p.name} = {p.default}   {p.doc} ({p.allowed()})")


def _run(args: argparse.Namespace) -> None:
    from labkit.experiment import ParameterError
    from labkit.experiments import find

    cls = find(args.name)
    types = {p.name: p for p in cls.parameters()}
    values = {}
    for item in args.set:
        key, equals, text = item.partition("=")
        if not equals:
            raise ParameterError(f"--set {item!r} has no '='; write --set name=value")
        values[key] = _value(text, types[key]) if key in types else text
    experiment = cls(**values)
    metrics = experiment.metrics(experiment.run())
    if args.json:
        _print_json({"experiment": cls.name(), "parameters": experiment.model_dump(), "metrics": [asdict(m) for m in metrics]})
        return
    print(experiment.code())
    for m in metrics:
        beside = "".join(
            f"   ({word}: {value} {m.unit})"
            for word, value in (("bound", m.bound), ("published", m.published))
            if value is not None
        )
        print(f"    {m.name}: {m.text()}{beside}{'   ' + m.note if m.note else ''}")


def _value(text: str, parameter: Any) -> Any:
    """Text of the command line as the parameter's type; what does not fit is left for the validation to name."""
    if parameter.type is bool:
        return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}.get(text.lower(), text)
    if parameter.type in (int, float):
        try:
            return parameter.type(text)
        except ValueError:
            return text
    return text


def _trace(args: argparse.Namespace) -> None:
    from labkit.trace import describe, export_chrome, export_csv, read_log, statistics

    trace, report = read_log(args.log, clock_hz=args.clock_hz)
    table = statistics(trace)
    if args.export:
        writers = {".json": export_chrome, ".csv": export_csv}
        ending = args.export[args.export.rfind(".") :]
        if ending not in writers:
            raise ValueError(f"--export {args.export}: the ending says the format, it is one of {', '.join(writers)}")
        writers[ending](trace, args.export)
    if args.json:
        _print_json({"statistics": json.loads(table.to_json(orient="index")), "report": report.as_dict()})
        return
    print(describe(table))
    print(report)


def _replay(args: argparse.Namespace) -> None:
    from labkit.kernel import read_scenario, run_scenario, write_events, write_timeline

    run = run_scenario(read_scenario(args.scenario))
    for path, write in ((args.timeline, write_timeline), (args.events, write_events)):
        if path:
            with open(path, "w", encoding="utf-8", newline="") as file:
                write(run, file)
    for wait in run.deadlock:
        print(f"deadlock: {wait}")


def _cache(args: argparse.Namespace) -> None:
    from labkit.cache import count_trace

    counts = count_trace(args.trace, args.size, args.ways, args.line, args.policy, seed=args.seed)
    if args.json:
        _print_json(
            {
                "trace": args.trace,
                "size": args.size,
                "ways": args.ways,
                "line": args.line,
                "policy": args.policy,
                "counts": counts,
            }
        )
        return
    print(f"{args.size} bytes, {args.ways} ways, lines of {args.line} bytes, policy {args.policy}")
    for kind in ("read", "write"):
        of, missed = counts[f"{kind}s"], counts[f"{kind}_misses"]
        print(f"    {kind}s: {of}, of them missed {missed}{f' ({100 * missed / of:.2f} %)' if of else ''}")
    for name in ("lines_touched", "fills", "evictions", "write_backs"):
        print(f"    {name.replace('_', ' ')}: {counts[name]}")


def _schedule(args: argparse.Namespace) -> None:
    from labkit.scheduler.taskfile import schedule, write_schedule

    with open(args.tasks, encoding="utf-8") as file:
        try:
            data = json.load(file)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{args.tasks} is not JSON: {error}") from None
    verdict, trace = schedule(data, args.policy, args.until)
    if args.trace:
        with open(args.trace, "w", encoding="utf-8", newline="") as file:
            write_schedule(trace, file)
    _print_json(verdict)


def _windows(args: argparse.Namespace) -> None:
    from labkit.phases import read_chain, windows

    made = windows(read_chain(args.chain), args.period_ns, args.reserve_ns)
    if args.json:
        _print_json([asdict(window) for window in made])
        return
    print(f"{'phase':20} {'release ns':>14} {'deadline ns':>14} {'end ns':>14} {'spare ns':>14}")
    for window in made:
        print(f"{window.phase:20} {window.release_ns:14} {window.deadline_ns:14} {window.end_ns:14} {window.spare_ns:14}")


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = argparse.ArgumentParser(prog="labkit", description="The Real-Time Lab on the command line.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, function: Any, text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.set_defaults(function=function)
        return command

    c = add("list", _list, "list the experiments with their parameters")
    c.add_argument("--json", action="store_true")
    c = add("run", _run, "run one experiment and print its numbers")
    c.add_argument("name")
    c.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter; may be repeated")
    c.add_argument("--json", action="store_true")
    c = add("trace", _trace, "statistics of a log of '<name> <us> <0|1>' lines, and its repairs")
    c.add_argument("log")
    c.add_argument(
        "--clock-hz", type=int, metavar="HZ", help="clock of the 32-bit cycle counter behind the stamps, to undo its wrap"
    )
    c.add_argument("--json", action="store_true")
    c.add_argument("--export", metavar="OUT", help="OUT.json for Perfetto or chrome://tracing, OUT.csv for the events")
    c = add("replay", _replay, "run a kernel scenario and write who ran when")
    c.add_argument("scenario", metavar="SCENARIO.json")
    c.add_argument("--timeline", metavar="T.csv", help="who consumed each tick: start,end,task")
    c.add_argument("--events", metavar="E.csv", help="every kernel event: tick,event,task,detail")
    c = add("schedule", _schedule, "schedule a set of periodic tasks and print as JSON whether its acceptance test takes it")
    c.add_argument(
        "tasks",
        metavar="TASKS.json",
        help="tasks with name, period, deadline, offset, times, and wcet or (taft) ecet and ep_wcet",
    )
    c.add_argument("--policy", required=True, choices=("rm", "dm", "edf", "taft"))
    c.add_argument("--until", required=True, type=int, metavar="N", help="length of the schedule in time units")
    c.add_argument("--trace", metavar="OUT.csv", help="write who ran when: task,job,part,event,start,end")
    c = add("cache", _cache, "count the hits and misses of a recorded trace of data references")
    c.add_argument("trace", metavar="TRACE.npz", help="arrays op (uint8: 1 store, 2 load, 3 modify), addr (uint64), size (uint8)")
    c.add_argument("--size", type=int, default=16384, metavar="BYTES", help="capacity of the cache (default: %(default)s)")
    c.add_argument("--ways", type=int, default=4, help="lines per set (default: %(default)s)")
    c.add_argument("--line", type=int, default=32, metavar="BYTES", help="bytes per line (default: %(default)s)")
    c.add_argument("--policy", default="lru", help="replacement: lru, plru, fifo or random (default: %(default)s)")
    c.add_argument("--seed", type=int, default=0, help="for the policy random")
    c.add_argument("--json", action="store_true")
    c = add("windows", _windows, "split a period into windows for a chain of phases")
    c.add_argument("chain", metavar="CHAIN.csv", help="columns phase, part, ecet_ns, wcet_ep_ns")
    c.add_argument("--period-ns", required=True, type=int, metavar="P")
    c.add_argument(
        "--reserve-ns", type=int, default=0, metavar="R", help="kept free at the end of the period for clock correction"
    )
    c.add_argument("--json", action="store_true")
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of `labkit`."""
    args = parser().parse_args(argv)
    try:
        args.function(args)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has seen enough; nor may the interpreter flush again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ValueError, OSError) as error:
        print(f"labkit {args.command}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
