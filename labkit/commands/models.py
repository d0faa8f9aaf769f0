"""The kernel, the schedulers, the caches and the phases, each with files of its own format."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from labkit.commands.command import Add, print_json
from labkit.outside import read_json


def _replay(args: argparse.Namespace) -> None:
    from labkit.kernel import read_scenario, run_scenario, runtime_stats, write_events, write_timeline

    run = run_scenario(read_scenario(args.scenario))
    for path, write in ((args.timeline, write_timeline), (args.events, write_events)):
        if path:
            with open(path, "w", encoding="utf-8", newline="") as file:
                write(run, file)
    if not (args.timeline or args.events):
        stats, ticks = runtime_stats(run), run.trace.end // run.tick
        print(f"{ticks} ticks, {len(run.trace)} events, {stats.switches} context switches")
        for task in stats.tasks:
            print(f"    {task.name}: {task.time / run.tick:g} ticks, {task.share:.1%}")
    for wait in run.deadlock:
        print(f"deadlock: {wait}")


def _firmware(args: argparse.Namespace) -> None:
    from labkit.kernel import read_scenario, write_firmware

    for path in write_firmware(read_scenario(args.scenario), args.out, args.cpu_hz, args.tick_hz):
        print(path)


def _schedule(args: argparse.Namespace) -> None:
    from labkit.scheduler import schedule, write_schedule

    verdict, trace = schedule(read_json(args.tasks), args.policy, args.until)
    if args.trace:
        with open(args.trace, "w", encoding="utf-8", newline="") as file:
            write_schedule(trace, file)
    print_json(verdict)


def _cache(args: argparse.Namespace) -> None:
    from labkit.cache import count_trace, read_references

    recorded = read_references(args.trace)
    counts = count_trace(recorded.references, args.size, args.ways, args.line, args.policy, seed=args.seed)
    if args.json:
        print_json(
            {
                "trace": args.trace,
                "format": recorded.format,
                "left_out": recorded.left_out,
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
    print(f"{args.trace}: {recorded}")


def _windows(args: argparse.Namespace) -> None:
    from labkit.phases import read_chain, windows

    made = windows(read_chain(args.chain), args.period_ns, args.reserve_ns)
    if args.json:
        print_json([asdict(window) for window in made])
        return
    print(f"{'phase':20} {'release ns':>14} {'deadline ns':>14} {'end ns':>14} {'spare ns':>14}")
    for window in made:
        print(f"{window.phase:20} {window.release_ns:14} {window.deadline_ns:14} {window.end_ns:14} {window.spare_ns:14}")


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("replay", _replay, "run a kernel scenario: who ran how long, or when")
    c.add_argument("scenario", metavar="SCENARIO.json")
    c.add_argument("--timeline", metavar="T.csv", help="who consumed each tick: start,end,task")
    c.add_argument("--events", metavar="E.csv", help="every kernel event: tick,event,task,detail")
    c = add("firmware", _firmware, "write a kernel scenario as a small FreeRTOS application in C")
    c.add_argument("scenario", metavar="SCENARIO.json")
    c.add_argument("--out", required=True, metavar="DIR", help="folder for main.c, FreeRTOSConfig.h and board.c")
    c.add_argument("--cpu-hz", type=int, default=216_000_000, metavar="N", help="CPU cycles per second (default: %(default)s)")
    c.add_argument("--tick-hz", type=int, default=1000, metavar="N", help="ticks per second (default: %(default)s)")
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
    c.add_argument("trace", metavar="TRACE", help="text of valgrind's lackey (--trace-mem=yes) or of Dinero (din), or .npz")
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
