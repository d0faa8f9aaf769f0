"""Notebook 07: a task set of one's own as a table, under RM, DM, EDF and TAFT at once."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import lcm
from typing import Annotated, Any, ClassVar, Literal, Self

from annotated_types import MaxLen
from typing_extensions import Doc

from labkit.checks import shown
from labkit.experiment import Experiment, Labels, Metric, View
from labkit.experiments.task_table import FIELDS, cells, complaint, entry, text_of
from labkit.figures import BLUE, History, axis, gantt, held, lengths, stack
from labkit.outside import json_value, read_text
from labkit.scheduler import (
    POLICIES,
    PeriodicTask,
    TaskPair,
    TaskSet,
    UndecidedError,
    deadline_monotonic,
    edf_response_times,
    rate_monotonic,
    read_tasks,
    response_times,
    simulate,
    taft_utilization,
    utilization,
    verdict_of,
)
from labkit.trace import Trace, jobs

HZ = {"ms": 1000, "us": 10**6, "ns": 10**9}
MOST_TASKS, MOST_JOBS = 12, 2000  # in the table, and simulated
PERIODS_SHOWN = 3  # of the longest period, in the picture
KEYS = ("ready", "release", "deadline", "missed", "beyond ECET", "aborted", "exception part")

POLICY = {"rm": "Rate monotonic", "dm": "Deadline monotonic", "edf": "EDF", "taft": "TAFT"}
EXAMPLE = "lidar, 2, 6, 6, 0, 1, 1; planner, 4, 12, 12, 0, 2, 1; brake, 1, 8, 2, 0, 1, 0"


@dataclass(frozen=True)
class Ruled:
    """What a policy makes of the set. Times in units of the table; by name of the task.

    Attributes:
        history: of the simulation.
        verdict: of the sharpest test, see `labkit.scheduler.verdict_of`.
        bound: on the response time; None where there is none.
        longest: longest response time simulated, of jobs that were completed.
        missed: deadlines missed.
        aborted: main parts aborted.
    """

    history: History
    verdict: Mapping[str, Any]
    bound: Mapping[str, int | None]
    longest: Mapping[str, int]
    missed: Mapping[str, int]
    aborted: int


@dataclass(frozen=True)
class Judged:
    """A table and what becomes of it.

    Attributes:
        rows: its cells.
        wrong: beside each row, what is wrong with it or missing; "" if nothing is.
        until: how long was simulated; 0 if there was nothing to simulate.
        shown: how much of that the picture shows.
        ruled: policy -> what it makes of the set, or the sentence why it cannot.
    """

    rows: Sequence[tuple[str, ...]]
    wrong: Sequence[str]
    until: int
    shown: int
    ruled: Mapping[str, Ruled | str]


class OwnTaskSet(Experiment[Judged]):
    """Does your task set fit?

    A row per task: C, T, D and offset for RM, DM and EDF; ECET, EP, T, D and offset for TAFT; D is T where it is empty. Every job
    takes its C (without one: its ECET), or what `times` lists for one job after the other.
    """

    headline: ClassVar[tuple[str, ...]] = ("accepted by analysis", "no miss in the simulation", "utilisation")

    tasks: Annotated[
        str, MaxLen(100_000), Doc("rows of name, C, T, D, offset, ECET, EP, times; rows end with a semicolon, cells with a comma")
    ] = EXAMPLE
    unit: Annotated[Literal["ms", "us", "ns"], Labels({"us": "µs"}), Doc("unit of all times in the table")] = "ms"
    policy: Annotated[Literal["rm", "dm", "edf", "taft"], Labels(POLICY), View(), Doc("whose timeline is drawn")] = "rm"

    @classmethod
    def from_json(cls, text: str, name: str = "the text") -> Self:
        """The task set in a file of `labkit schedule`. Raises ValueError, a sentence."""
        data = json_value(text, name)
        listed = data.get("tasks") if isinstance(data, dict) else None
        if not isinstance(listed, list) or not all(isinstance(task, dict) for task in listed):
            raise ValueError(f'{name} is no task set; {{"tasks": [{{"name": "a", "period": 5, "wcet": 2}}]}} is one')
        if len(listed) > MOST_TASKS:
            raise ValueError(f"{name} has {len(listed)} tasks; the table has room for {MOST_TASKS}, labkit schedule for all")
        if (unit := data.get("unit", "ms")) not in HZ:
            raise ValueError(f"{name} has the unit {shown(unit)}; there are {', '.join(HZ)}")
        unknown = next((field for task in listed for field in task if field not in FIELDS.values()), None)
        if unknown is not None:
            raise ValueError(f"{name} has a task with a field {shown(unknown)}; there are {', '.join(FIELDS.values())}")
        return cls(tasks=text_of([_cell(task.get(field)) for field in FIELDS.values()] for task in listed), unit=unit)

    @classmethod
    def read(cls, path: str) -> Self:
        """The task set in a file of `labkit schedule`. Raises ValueError, a sentence, or OSError."""
        return cls.from_json(read_text(path), path)

    def data(self) -> dict[str, Any]:
        """The set as `labkit.scheduler.schedule` and the command line take it. Raises ValueError if a cell is no whole number."""
        return {"unit": self.unit, "tasks": [entry(row) for row in cells(self.tasks)]}

    def to_json(self) -> str:
        """The same as the text of a file."""
        return json.dumps(self.data(), indent=1, ensure_ascii=False) + "\n"

    def run(self) -> Judged:
        rows = cells(self.tasks)
        entries: list[dict[str, Any]] = []
        wrong: list[str] = []
        unfit: dict[str, str] = {}  # policy -> what it lacks
        for row in rows:
            complaints: dict[str, str] = {}
            try:
                entries.append(entry(row))
                if [each["name"] for each in entries].count(row[0]) > 1:
                    raise ValueError("another task has this name")
                complaints = _lacking(entries[-1])
                wrong.append("; ".join(f"not under {who}: {why}" for who, why in complaints.items()))
                unfit |= {p: f"task {row[0]!r}: {why}" for p in POLICIES if (why := complaints.get(_kind(p)))}
            except ValueError as error:
                wrong.append(complaint(error))
                unfit |= dict.fromkeys(POLICIES, "a row has to be mended first")
        if not rows or len(rows) > MOST_TASKS:
            why = f"{len(rows)} tasks; there have to be 1 to {MOST_TASKS}"
            return Judged(rows, wrong, 0, 0, dict.fromkeys(POLICIES, why))
        until = 0 if len(unfit) == len(POLICIES) else horizon(entries)
        ruled = {p: unfit[p] if p in unfit else rule(entries, p, until, HZ[self.unit]) for p in POLICIES}
        shown_until = PERIODS_SHOWN * max(task.get("period", 1) for task in entries) if until else 0
        return Judged(rows, wrong, until, min(until, shown_until), ruled)

    def figure(self, result: Judged) -> dict[str, Any]:
        found = result.ruled[self.policy]
        now = found if isinstance(found, Ruled) else None
        names = list(dict.fromkeys(row[0] or "?" for row in result.rows[:MOST_TASKS])) or ["no task"]
        ms = 1000 / HZ[self.unit]
        bounds = [ms * (now.bound.get(name) or 0) if now else 0.0 for name in names]
        longest = [ms * now.longest[name] if now else None for name in names]
        most = max([*bounds, *(each or 0 for each in longest)])
        history = now.history if now else History(Trace.from_rows((), (), 1000, end=0))
        end = held(ms * result.shown) if now else 10.0
        rows = gantt(
            history, names, 0, end, pairs=True, x=axis("time [ms]", range=[0, end]), width=3.0, title=POLICY[self.policy]
        )
        x = axis("longest response [ms]", range=[0, held(1.4 * most)])
        bars = lengths(longest, bounds, BLUE, x, "ms", title="Simulated, and its bound", left=30)
        table = {"rows": result.rows, "wrong": result.wrong, **_told(result)}
        meta = {"says": self._says(result), "table": table}
        return stack([rows, bars], height=170 + 34 * max(len(names), 3), keys=(*KEYS, "bound by analysis"), meta=meta)

    def _says(self, result: Judged) -> str:
        now = result.ruled[self.policy]
        if not isinstance(now, Ruled):
            return f"{self.policy.upper()}: {now}."
        accepted = "accepted" if now.verdict["accepted"] else "not accepted"
        return f"{self.policy.upper()}: {accepted}. {now.verdict['test']}: {now.verdict['why']}."

    def metrics(self, result: Judged) -> list[Metric]:
        ruled = {p: r for p, r in result.ruled.items() if isinstance(r, Ruled)}
        accepted = [p.upper() for p, r in ruled.items() if r.verdict["accepted"]]
        kept = [p.upper() for p, r in ruled.items() if not len(r.history.misses)]
        plain, pairs = ruled.get("rm"), ruled.get("taft")
        sets = {p: read_tasks(self.data(), p) for p in ("rm", "taft") if p in ruled}
        taft = pairs.aborted if pairs else None
        return [
            Metric("accepted by analysis", (", ".join(accepted) or "none") if ruled else None),
            Metric(
                "no miss in the simulation",
                (", ".join(kept) or "none") if ruled else None,
                note=f"simulated from 0 to {result.until} {self.unit}",
            ),
            Metric("utilisation", 100 * float(utilization(sets["rm"].tasks)) if plain else None, "%", note="sum of C / T"),
            Metric(
                "expected utilisation",
                100 * float(taft_utilization(sets["taft"].pairs)) if pairs else None,
                "%",
                note="sum of (ECET + EP) / T",
            ),
            Metric("TAFT aborted", taft, "main parts", note="" if pairs else "no pairs"),
        ]


def _cell(value: Any) -> str:
    return "" if value is None else " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _kind(policy: str) -> str:
    return "TAFT" if policy == "taft" else "RM, DM, EDF"


def _lacking(task: dict[str, Any]) -> dict[str, str]:
    """Kind of policy -> why it cannot schedule a task. Raises ValueError if none can."""
    found = {}
    for policy in ("rm", "taft"):
        try:
            read_tasks({"tasks": [task]}, policy)
        except ValueError as error:
            found[_kind(policy)] = complaint(error)
    if len(set(found.values())) == 1 and len(found) == 2:
        raise ValueError(next(iter(found.values())))
    return found


def horizon(entries: Sequence[Mapping[str, Any]]) -> int:
    """How long to simulate: two hyperperiods after the last first release, but at most `MOST_JOBS` jobs."""
    whole = max(task.get("offset", 0) for task in entries) + 2 * lcm(*(task["period"] for task in entries))
    most = int(MOST_JOBS / sum(1 / task["period"] for task in entries))
    return max(1, min(whole, most))


def rule(entries: Sequence[Mapping[str, Any]], policy: str, until: int, hz: int) -> Ruled | str:
    """Judge and simulate a set under a policy; the sentence of what refuses it."""
    always = [dict(task, times=task.get("times", [task["wcet"]])) if task.get("wcet") else dict(task) for task in entries]
    try:
        tasks = read_tasks({"tasks": always}, policy)
        some: Sequence[PeriodicTask | TaskPair] = tasks.pairs or tasks.tasks
        history = History(simulate(some, policy, until, tasks.times, hz))
    except ValueError as error:
        return complaint(error)
    verdict, found = verdict_of(tasks, policy), jobs(history.trace)
    code = {task.name: history.trace.code(task.name) for task in some}
    return Ruled(
        history,
        verdict,
        _bounds(tasks, policy, bool(verdict["accepted"])),
        {name: int(found.response[found.task == i].max(initial=0)) for name, i in code.items()},
        {name: int(found.missed[found.task == i].sum()) for name, i in code.items()},
        len(history.aborts),
    )


def _bounds(tasks: TaskSet, policy: str, accepted: bool) -> dict[str, int | None]:
    """Worst response time of each task; for TAFT no more is known than that an accepted set keeps its deadlines."""
    if policy == "taft":
        return {pair.name: pair.deadline if accepted else None for pair in tasks.pairs}
    try:
        if policy == "edf":
            return edf_response_times(tasks.tasks)
        return response_times((rate_monotonic if policy == "rm" else deadline_monotonic)(tasks.tasks))
    except UndecidedError:
        return {task.name: None for task in tasks.tasks}


def _told(result: Judged) -> dict[str, Any]:
    """What stands beside the table: for each policy its verdict, for each row and policy the longest response, and its bound."""
    heads = []
    for policy, now in result.ruled.items():
        good = now.verdict["accepted"] if isinstance(now, Ruled) else None
        head = {"text": policy.upper(), "good": good, "set": {"policy": policy}}
        head["foot"] = {True: "accepted", False: "not accepted", None: "–"}[good]
        heads.append({**head, "why": now.verdict["why"] if isinstance(now, Ruled) else now})
    beside = [[_response(now, row[0]) for now in result.ruled.values()] for row in result.rows]
    return {"columns": list(FIELDS), "heads": heads, "beside": beside}


def _response(now: Ruled | str, name: str) -> dict[str, Any]:
    if isinstance(now, str) or name not in now.longest:
        return {"text": "–", "good": None}
    bound = now.bound.get(name)
    return {"text": f"{now.longest[name] or '–'} / {'–' if bound is None else bound}", "good": not now.missed[name]}
