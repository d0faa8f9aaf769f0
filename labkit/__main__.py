"""The command line: every experiment without a notebook, and the models' file formats.

Exit code 0: done; 1: an error in the input, told in one sentence on standard error; 2: wrong usage; 130: interrupted.
"""

from __future__ import annotations

import argparse
import codecs
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from io import TextIOWrapper
from typing import TYPE_CHECKING, Any, NoReturn

from labkit.outside import one_line, read_json

if TYPE_CHECKING:
    from labkit.experiment import Parameter


def _print_json(value: Any) -> None:
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    json.dump(value, sys.stdout, indent=1, ensure_ascii=not unicode, default=lambda o: o.item() if hasattr(o, "item") else str(o))
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
    with _progress():
        result = experiment.run()
    metrics = experiment.metrics(result)
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


@contextmanager
def _progress() -> Iterator[None]:
    """Shows on standard error how far a slow run is, if someone is watching."""
    from labkit.experiment import progress_listener

    if sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    token = progress_listener.set(lambda done: print(f"\r{done:4.0%}", end="", file=sys.stderr, flush=True))
    try:
        yield
    finally:
        progress_listener.reset(token)
        print("\r    \r", end="", file=sys.stderr, flush=True)


def _value(text: str, parameter: Parameter) -> Any:
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
    from labkit.trace import describe, export_chrome, export_csv, export_npz, read_log, statistics

    trace, report = read_log(args.log, clock_hz=args.clock_hz)
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
        _print_json({"statistics": rows.get("", rows), "report": report.as_dict()})  # with several cores, by core, then by name
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
    from labkit.scheduler import schedule, write_schedule

    verdict, trace = schedule(read_json(args.tasks), args.policy, args.until)
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


def _check_sink(args: argparse.Namespace) -> None:
    from labkit.sink import check_sink, default_ring

    sizes = {name: getattr(args, name) for name in ("producers", "messages", "bytes", "capacity", "modulus", "dma")}
    check = check_sink(args.variant, default_ring(args.variant, **sizes), args.schedule, args.budget)
    if args.json:
        _print_json(check.as_dict())
    else:
        print(check)


def _frames(args: argparse.Namespace) -> None:
    from labkit.sink import read_frames

    found = [reception.as_dict() for reception in read_frames(args.bursts)]
    if args.json:
        _print_json(found)
        return
    for number, reception in enumerate(found, 1):
        values = "".join(f" {name}={value}" for name, value in reception.items() if name != "verdict")
        print(f"{number}: {reception['verdict']}{values}")


#: What each reader takes at most; more is refused with a sentence that says so.
LIMITS = """\
Limits: trace 256 MiB; replay 8 MiB, 1000 tasks, 10000000 ticks, 2000000 events; schedule 8 MiB, 50000 tasks,
1000000 jobs; windows 8 MiB, 1000 parts; cache 5000000 references. What is more is refused and says so.
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))


class _Version(argparse.Action):
    def __call__(self, *_: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"labkit {version('labkit')}")
        sys.exit(0)


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = _Parser(prog="labkit", description="The Real-Time Lab on the command line.", epilog=LIMITS)
    top.add_argument("--version", action=_Version, nargs=0, help="print the version of the lab and exit")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, function: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.set_defaults(function=function)
        return command

    c = add("list", _list, "list the experiments with their parameters")
    c.add_argument("--json", action="store_true")
    c = add("run", _run, "run one experiment and print its numbers")
    c.add_argument("name")
    c.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter; may be repeated")
    c.add_argument("--json", action="store_true")
    c = add("trace", _trace, "statistics of a log of '<name> <us> <0|1> [core]' lines, and its repairs")
    c.add_argument("log")
    c.add_argument(
        "--clock-hz", type=int, metavar="HZ", help="clock of the 32-bit cycle counter behind the stamps, to undo its wrap"
    )
    c.add_argument("--json", action="store_true")
    c.add_argument("--export", metavar="OUT", help="OUT.json for Perfetto or chrome://tracing, OUT.csv or OUT.npz for the events")
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
    c = add("check-sink", _check_sink, "look at every interleaving of a variant of the trace sink for the shortest failure")
    c.add_argument(
        "--variant", required=True, metavar="V", help="such as published-first; an unknown one is answered with the list"
    )
    c.add_argument("--producers", type=int, metavar="N", help="tasks that write (default: 2)")
    c.add_argument("--messages", type=int, metavar="K", help="messages of each of them (default: 2)")
    c.add_argument("--bytes", type=int, metavar="B", help="bytes of a message (default: what the variant needs, 1 or 2)")
    c.add_argument("--capacity", type=int, metavar="C", help="slots of the ring (default: 2)")
    c.add_argument("--modulus", type=int, metavar="M", help="indices count modulo this (default: 8 times the capacity)")
    c.add_argument("--schedule", default="free", help="free, or the consumer's priority: higher, equal, lowest (default: free)")
    c.add_argument("--dma", action="store_true", help="a DMA sends the bytes, and notifies the consumer")
    c.add_argument("--budget", type=int, metavar="STATES", default=500_000, help="undecided after so many (default: %(default)s)")
    c.add_argument("--json", action="store_true")
    c = add("frames", _frames, "check receptions of velocity frames: 24 bytes of three doubles and their CRC-32/MPEG-2")
    c.add_argument("bursts", metavar="BURSTS.txt", help="one reception per line: the bytes between two idle times, in hex")
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
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="labkit.plain")  # no character is worth a traceback, whatever the terminal
    args = parser().parse_args(argv)
    try:
        if sys.stdout is None:
            raise OSError("standard output is closed")
        args.function(args)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        _drop_output()
    except KeyboardInterrupt:
        return _fail(args.command, "interrupted", 130)
    except MemoryError:
        return _fail(args.command, "the input needs more memory than there is", 1)
    except (ValueError, OSError) as error:
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
        return _fail(args.command, f"{error}{notes}", 1)
    return 0


def _fail(command: str, message: str, code: int) -> int:
    if sys.stderr is not None:
        print(f"labkit {command}: {one_line(message)}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _drop_output()
    return code


def _drop_output() -> None:
    """Lets go of what cannot be written, so that the interpreter does not try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _plain(error: UnicodeError) -> tuple[str, int]:
    """What to write for characters that an encoding does not have: a blank for a thin one, else an escape."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return text.replace("\u202f", " ").encode("ascii", "backslashreplace").decode("ascii"), error.end


codecs.register_error("labkit.plain", _plain)


if __name__ == "__main__":
    sys.exit(main())
