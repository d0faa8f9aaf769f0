"""Writes the sample recordings of data/examples: one schedule in the formats of four tracers. Run it to write them again.

The schedule is the lab's own (deadline monotonic, times in microseconds, 200 ms), so that what the readers find in them can be
compared with what was simulated.
"""

from pathlib import Path

from labkit.scheduler import schedule
from labkit.trace import Trace, export_chrome, export_csv

EXAMPLES = Path(__file__).parents[2] / "data" / "examples"
TASKS = {
    "tasks": [
        {"name": "ctl", "period": 5000, "deadline": 3000, "wcet": 1200, "times": [1100, 1200, 1150, 1180]},
        {"name": "odom", "period": 10000, "offset": 300, "wcet": 2100, "times": [2000, 2100]},
        {"name": "logger", "period": 40000, "wcet": 9000, "times": [9000, 7500, 8000]},
    ]
}
UNTIL = 200_000  # us


def simulated() -> Trace:
    return schedule(TASKS, "dm", UNTIL, hz=1_000_000)[1]


def steps(trace: Trace):
    """(time, "release" | "complete" | "switch", task, task before, whether that one has ended) in order."""
    ended = set()
    before = None
    for time, kind, task, *_ in trace.frame().itertuples(index=False):
        if kind == "complete":
            ended.add(task)
        elif kind == "release":
            yield time, kind, task, None, False
        elif kind == "switch" and task != before:
            yield time, kind, task, before, before in ended
            ended.discard(before)
            before = task


def as_log(trace: Trace) -> str:
    lines = []
    for time, kind, task, before, _ in steps(trace):
        if kind == "switch":
            lines += [f"{before} {time} 0"] if before else []
            lines += [f"{task} {time} 1"] if task else []
    return "# made by the lab: a simulated schedule as a board would send it\n" + "\n".join(lines) + "\n"


def as_btf(trace: Trace) -> str:
    lines = ["#version 2.2.0", "#creator the lab, a simulated schedule", "#timeScale us"]
    released, started = dict.fromkeys(trace.names, -1), dict.fromkeys(trace.names, -1)
    for time, kind, task, before, ended in steps(trace):
        if kind == "release":
            released[task] += 1
            lines.append(f"{time},Timer_{task},{released[task]},T,{task},{released[task]},activate")
            continue
        if before:
            lines.append(f"{time},Core_1,0,T,{before},{started[before]},{'terminate' if ended else 'preempt'}")
            started[before] += ended  # the next number is that of the job it starts next
        if task:
            first = started[task] < 0 or f"T,{task},{started[task]},start" not in "\n".join(lines)
            started[task] = max(started[task], 0)
            lines.append(f"{time},Core_1,0,T,{task},{started[task]},{'start' if first else 'resume'}")
    return "\n".join(lines) + "\n"


def as_ftrace(trace: Trace) -> str:
    pids = {name: 100 + number for number, name in enumerate(trace.names)} | {None: 0}
    lines = ["# tracer: nop", "# made by the lab: a simulated schedule as Linux would record it", "#"]
    running = None

    def comm(name):
        return name or "swapper/0"

    for time, kind, task, before, ended in steps(trace):
        head = f"{running or '<idle>':>16}-{pids[running]:<7} [000] d..2. {1000 + time // 10**6}.{time % 10**6:06}: "
        if kind == "release":
            lines.append(f"{head}sched_wakeup: comm={task} pid={pids[task]} prio=50 target_cpu=000")
            continue
        state = "R" if before is None else "S" if ended else "R+"
        lines.append(
            f"{head}sched_switch: prev_comm={comm(before)} prev_pid={pids[before]} prev_prio=50 prev_state={state} ==> "
            f"next_comm={comm(task)} next_pid={pids[task]} next_prio=50"
        )
        running = task
    return "\n".join(lines) + "\n"


def made() -> dict[str, str]:
    trace = simulated()
    return {"board.log": as_log(trace), "board.btf": as_btf(trace), "linux_ftrace.txt": as_ftrace(trace)}


def main() -> None:
    for name, text in made().items():
        (EXAMPLES / name).write_text(text, encoding="utf-8")
    export_csv(simulated(), EXAMPLES / "run.csv")
    export_chrome(simulated(), EXAMPLES / "run.json")


if __name__ == "__main__":
    main()
