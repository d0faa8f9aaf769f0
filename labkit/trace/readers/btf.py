"""Reader of BTF, the Best Trace Format (version 2.2) of simulators, debuggers and tracers for embedded systems.

A line is `time,source,source instance,type,target,target instance,event,note`. Read are the events of tasks (type T) and of
interrupt service routines (I): `activate` releases a job and `terminate` completes it; `start`, `resume` and `poll_parking` give
a core; `preempt`, `wait`, `park` and `terminate` take it away; `poll` and `run` change nothing: active waiting takes time, too.
Other entities (runnables, signals, stimuli, schedulers, ...) are counted as skipped.
"""

from __future__ import annotations

import re
from array import array

from labkit.checks import UNBOUNDED
from labkit.trace.readers.report import LogError, Problems, Report, told
from labkit.trace.readers.source import Source
from labkit.trace.readers.stamps import MOST_CORE, MOST_NAMES
from labkit.trace.readers.switched import BLOCKED, READY, UNKNOWN, Switches, in_order
from labkit.trace.trace import Trace, printable

#: Time units of `#timeScale`, in units per second.
SCALES = {"ps": 10**12, "ns": 10**9, "us": 10**6, "ms": 10**3, "s": 1}

#: A longer line is none of BTF's.
MOST_IN_LINE = 2000

#: Latest time that is read, in its own unit.
LATEST = UNBOUNDED // 2

_EVENTS = (
    *("activate", "start", "resume", "poll_parking", "preempt", "park", "wait", "terminate"),
    *("release", "release_parking", "poll", "run", "mtalimitexceeded", "interrupt_suspended"),
)
_CODE = {event: code for code, event in enumerate(_EVENTS)}
_ENTER = {_CODE[event] for event in ("start", "resume", "poll_parking")}
_LEAVE = {_CODE[event]: READY if event == "preempt" else BLOCKED for event in ("preempt", "park", "wait", "terminate")}
_TYPES = {"T", "I", "ISR", "R", "C", "STI", "SIG", "SEM", "SCHED", "EVENT", "SYS", "MC", "OS", "SIM"}
_WIDTH = 5


def is_btf(lines: list[str]) -> bool:
    """Whether it begins with BTF's parameters, or more of these lines are its events than not."""
    some = [line[:MOST_IN_LINE] for line in lines if line.strip()]
    if any(re.match(r"#time[sS]cale ", line) for line in some[:100]):
        return True
    some = [line for line in some if not line.startswith("#")]
    return 2 * sum(_fields(line) is not None for line in some) > len(some)


def btf_of(source: Source) -> tuple[Trace, Report]:
    """The tasks and interrupts of a recording, in its own time unit.

    Cores are the sources of the events that give and take a core, or those declared by events of type C, if there are any; their
    numbers are those at the end of their names, if these differ, else they are counted from 0.

    Raises:
        LogError: no line is an event of a task.
    """
    events = _Events(source.title)
    for lines in source.lines():
        for line in lines:
            events.read(line)
    if not len(events.columns):
        raise LogError(f"{source.title}: {events.skipped} events of BTF, none of them of a task (type T) or interrupt (I)")
    return events.replayed()


class _Events:
    """The events of the lines as columns: line, time, event, source, target; the last two are indices into `entities`."""

    def __init__(self, title: str) -> None:
        self.title, self.problems = title, Problems()
        self.lines = self.empty = self.comments = self.skipped = 0
        self.columns = array("q")
        self.hz: int | None = None
        self.entities: dict[str, int] = {}
        self.aliases: dict[str, dict[str, str]] = {"entityMapping": {}, "typeMapping": {}}
        self.cores: set[int] = set()
        self.interrupts: set[int] = set()

    def read(self, line: str) -> None:
        self.lines += 1
        if not line.strip():
            self.empty += 1
        elif line.startswith("#"):
            self.comments += 1
            self.parameter(line[1:MOST_IN_LINE])
        elif len(line) > MOST_IN_LINE or (fields := _fields(line)) is None:
            self.problems.rejected(self.lines, f"{told(line)} is not <time>,<source>,<n>,<type>,<target>,<n>,<event>")
        else:
            self.event(*fields)

    def parameter(self, text: str) -> None:
        name, _, value = text.partition(" ")
        if name.lower() == "timescale":
            if value.strip() in SCALES and not len(self.columns):
                self.hz = SCALES[value.strip()]
            else:
                self.problems.repaired(
                    self.lines, f"{told(text)} is no time scale of {', '.join(SCALES)} before the events", "ignored"
                )
        elif name in self.aliases:
            number, _, alias = value.partition(" ")
            if len(self.aliases[name]) < MOST_NAMES:
                self.aliases[name][number] = alias.strip()

    def event(self, time: str, source: str, kind: str, target: str, event: str, note: str) -> None:
        kind = self.aliases["typeMapping"].get(kind, kind)
        source, target = (self.aliases["entityMapping"].get(name, name) for name in (source, target))
        if kind == "C":
            self.cores.add(self.entity(target))
        if kind not in ("T", "I", "ISR") or note.startswith("create"):  # a new task that some tracers call preempted
            self.skipped += 1
        elif event not in _CODE:
            self.problems.rejected(self.lines, f"{told(event)} is no event of a task; there are {', '.join(_EVENTS)}")
        elif not (target.isprintable() and source.isprintable()):
            self.problems.rejected(self.lines, f"the name {told(target)} or {told(source)} has control characters in it")
        elif int(time) > LATEST:
            self.problems.rejected(self.lines, f"{time} is a time beyond any recording")
        else:
            if kind != "T":
                self.interrupts.add(self.entity(target))
            self.columns.extend((self.lines, int(time), _CODE[event], self.entity(source), self.entity(target)))

    def entity(self, name: str) -> int:
        if len(self.entities) == MOST_NAMES and name not in self.entities:
            raise LogError(f"{self.title}: {told(name)} is name number {MOST_NAMES + 1}; a recording has at most {MOST_NAMES}")
        return self.entities.setdefault(name, len(self.entities))

    def replayed(self) -> tuple[Trace, Report]:
        table, moved = in_order(self.columns, _WIDTH)
        names, rows = list(self.entities), table.tolist()
        tasks = {entity: code for code, entity in enumerate(sorted({row[4] for row in rows}))}
        moves = {row[3] for row in rows if row[2] in _ENTER or row[2] in _LEAVE}
        cores = _numbers(names, sorted(self.cores or moves - tasks.keys()))
        activated = {row[4] for row in rows if row[2] == _CODE["activate"]}
        switches, refused = Switches(self.problems), 0
        for line, time, event, source, target in rows:
            task = tasks[target]
            if event == _CODE["activate"]:
                switches.release(time, UNKNOWN, task)
            elif event == _CODE["mtalimitexceeded"]:
                refused += 1
            elif event in (_CODE["release"], _CODE["release_parking"]):
                switches.ready(time, cores.get(source, UNKNOWN), task)
            elif event not in _ENTER and event not in _LEAVE:
                continue
            elif (core := cores.get(source, _only(cores, names[source]))) is None:
                self.problems.rejected(line, f"{told(names[source])} is no core of this recording")
            else:
                switches.seen(time, core)
                if event == _CODE["start"] and target not in activated:
                    switches.release(time, core, task)
                if event == _CODE["terminate"]:
                    switches.complete(time, core, task)
                if event in _ENTER:
                    switches.enter(line, time, core, task, target in self.interrupts)
                else:
                    switches.leave(line, time, core, task, _LEAVE[event])
        if self.hz is None:
            self.problems.repaired(1, "there is no #timeScale", "times are taken as nanoseconds")
        made = [names[entity] for entity in tasks]
        trace, notes = switches.trace(made, self.hz or SCALES["ns"], rows[0][1], rows[-1][1])
        if not activated:
            notes.append("no activations in it: response times are not known, or those since the start of a job")
        if refused:
            notes.append(f"{refused} activations were refused, as too many were waiting already")
        if trace.core is not None:
            notes.append("cores: " + ", ".join(f"{printable(names[entity])} is {core}" for entity, core in cores.items()))
        report = Report.of(
            self.title,
            len(trace.cores()),
            self.problems,
            "BTF",
            self.lines,
            comments=self.comments,
            empty=self.empty,
            skipped=self.skipped,
            moved=moved,
            notes=notes,
        )
        return trace, report


def _fields(line: str) -> tuple[str, str, str, str, str, str] | None:
    """Time, source, type, target, event and note of a line; None if it is none of BTF."""
    fields = [field.strip() for field in line.split(",", 7)]
    if len(fields) < 7:
        return None
    time, source, _, kind, target, _, event, *note = fields
    numeric = kind.isascii() and kind.isdigit()
    if not (time.isascii() and time.isdigit() and len(time) <= 40 and source and target and (kind in _TYPES or numeric)):
        return None
    return time, source, kind, target, event, note[0] if note else ""


def _numbers(names: list[str], cores: list[int]) -> dict[int, int]:
    """Entity -> number of the core: the digits at the end of its name, if they tell the cores apart, else counted from 0."""
    ends = [re.search(r"(\d{1,3})$", names[core]) for core in cores]
    numbers = [int(end[1]) for end in ends if end]
    return dict(zip(cores, numbers if len(set(numbers)) == len(cores) else range(MOST_CORE + 1)))


def _only(cores: dict[int, int], source: str) -> int | None:
    """The core of an event whose source is none: the only one there is, or that in a name such as `[1/0004]task`."""
    if len(cores) == 1:
        return next(iter(cores.values()))
    found = re.match(r"\[(\d{1,3})/", source)
    return int(found[1]) if found and int(found[1]) in cores.values() else None
