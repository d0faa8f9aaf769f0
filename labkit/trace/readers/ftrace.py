"""Reader of Linux scheduler recordings as text: the `sched_switch` and `sched_wakeup` events of ftrace.

It takes the kernel's own form (`/sys/kernel/tracing/trace`: `prev_comm=... prev_pid=... ==> next_comm=...`, with or without
thread groups and flags), that of `perf script`, and the short one of `trace-cmd report` (`name:pid [priority] state ==> ...`).

A thread is named `comm-pid`, as ftrace itself writes it; the idle threads (pid 0) are nobody. A job of a thread is what it does
from a wakeup until it blocks: it stays one job while it is preempted (state R). Where no wakeup was recorded, a job begins when
it first runs.
"""

from __future__ import annotations

import re
from array import array

from labkit.trace.readers.report import LogError, Problems, Report, told
from labkit.trace.readers.source import Source
from labkit.trace.readers.stamps import MOST_CORE, US
from labkit.trace.readers.switched import BLOCKED, DELETED, NOBODY, READY, SUSPENDED, Switches, in_order
from labkit.trace.trace import Trace, printable

#: `comm-12 [001] d..2. 1234.567890: event: arguments`, or with core and flags in one: `comm-12 1d..2. 1234.567890: ...`.
_LINE = re.compile(r"(.*?)\s(\d{1,10})\.(\d{9}|\d{6}):\s+(?:sched:)?(\w+):(.*)")
_CORE = re.compile(r".*\[(\d{1,4})\]|.*\s(\d{1,4})[^\s\d]\S{3,5}\s*$")
_SWITCHES = (
    re.compile(
        r" *prev_comm=(.*) prev_pid=(\d{1,9}) prev_prio=-?\d{1,9} prev_state=(\S+) .*?"
        r"next_comm=(.*) next_pid=(\d{1,9}) next_prio=(-?\d{1,9})"
    ),
    re.compile(r" *(.*):(\d{1,9}) \[-?\d{1,9}\] (\S+) ==> (.*):(\d{1,9}) \[(-?\d{1,9})\]"),
)
_WAKEUPS = (
    re.compile(r" *comm=(.*) pid=(\d{1,9}) prio=-?\d{1,9}(?: success=(\d))?.* target_cpu=(\d{1,4})"),
    re.compile(r" *(.*):(\d{1,9}) \[-?\d{1,9}\](?: success=(\d))?.* CPU:(\d{1,4})"),
)
_LOST = re.compile(r"CPU:(\d{1,4}) \[(?:LOST )?(?:\d+ )?EVENTS(?: DROPPED)?\]")
_HEAD = re.compile(r"version = \d+|cpus=\d+|CPU \d+ is empty|-+")

#: A longer line is none of ftrace's.
MOST_IN_LINE = 2000

LATEST = 9 * 10**9  # s: in nanoseconds, later times do not fit 64 bits; it is the year 2255

_SWITCHED, _WOKEN, _GAP, _OTHER = range(4)
_WIDTH = 8


def is_ftrace(lines: list[str]) -> bool:
    """Whether more of these lines have the form of ftrace's events than not, heads apart."""
    some = [line[:MOST_IN_LINE] for line in lines if line.strip() and not _is_head(line.strip())]
    return 2 * sum(bool(_LINE.match(line)) for line in some) > len(some)


def ftrace_of(source: Source) -> tuple[Trace, Report]:
    """The context switches of a recording, in nanoseconds if its times have nine digits, else in microseconds.

    A core is observed from its first event on; the thread that loses it first had it since then. After lost events, and where a
    thread loses a core that another one has, the time since the last switch counts for nobody.

    Raises:
        LogError: no line is a `sched_switch`.
    """
    events = _Events()
    for lines in source.lines():
        for line in lines:
            events.read(line)
    if not events.switches:
        raise LogError(f"{source.title}: {events.others} events of ftrace, none of them sched_switch; record those of sched")
    return events.replayed(source.title)


class _Events:
    """The events of the lines as columns: line, time in ns, core, sort, thread, other thread, priority, state."""

    def __init__(self) -> None:
        self.problems = Problems()
        self.lines = self.empty = self.comments = self.switches = self.wakeups = self.others = 0
        self.columns = array("q")
        self.threads = {"0": NOBODY}  # by pid
        self.comms: list[str] = []
        self.time = 0
        self.fine = False

    def read(self, line: str) -> None:
        self.lines += 1
        stripped = line.strip()
        if not stripped:
            self.empty += 1
        elif lost := _LOST.match(stripped):
            self.add(_GAP, int(lost[1]))
            self.comments += 1
        elif _is_head(stripped):
            self.comments += 1
        elif len(line) <= MOST_IN_LINE and (found := _LINE.match(line)):
            self.event(line, *found.groups())
        else:
            self.problems.rejected(self.lines, f"{told(line)} is no event of ftrace")

    def event(self, line: str, who: str, seconds: str, digits: str, event: str, rest: str) -> None:
        core = _CORE.match(who)
        number = int(core[1] or core[2]) if core else MOST_CORE + 1
        if number > MOST_CORE:
            self.problems.rejected(self.lines, f"{told(line)} does not say on which core, 0 to {MOST_CORE}")
            return
        if int(seconds) >= LATEST:
            self.problems.rejected(self.lines, f"{seconds} s is a time beyond any recording")
            return
        self.time = int(seconds) * 10**9 + int(f"{digits:0<9}")
        self.fine |= len(digits) == 9 and not digits.endswith("000")
        if event == "sched_switch":
            if parts := _SWITCHES[0].match(rest) or _SWITCHES[1].match(rest):
                before, after = self.thread(parts[1], parts[2]), self.thread(parts[4], parts[5])
                self.add(_SWITCHED, number, before, after, int(parts[6]), _state(parts[3]))
                self.switches += 1
                return
            self.problems.rejected(self.lines, f"{told(rest)} does not say who is switched", "left out; see the next switch")
            self.add(_GAP, number)
            return
        if event in ("sched_wakeup", "sched_wakeup_new", "sched_waking"):
            parts = _WAKEUPS[0].match(rest) or _WAKEUPS[1].match(rest)
            if parts and parts[3] != "0":
                self.add(_WOKEN, number, self.thread(parts[1], parts[2]))
                self.wakeups += 1
                return
        self.others += 1
        self.add(_OTHER, number)

    def thread(self, comm: str, pid: str) -> int:
        """A number for the thread; its name is the last that it had, for a new one has that of its parent at first."""
        thread = self.threads.setdefault(pid, len(self.comms))
        if thread == len(self.comms):
            self.comms.append(comm)
        elif thread != NOBODY:
            self.comms[thread] = comm
        return thread

    def add(self, sort: int, core: int, one: int = NOBODY, other: int = NOBODY, priority: int = 0, state: int = 0) -> None:
        self.columns.extend((self.lines, self.time, core, sort, one, other, priority, state))

    def replayed(self, title: str) -> tuple[Trace, Report]:
        table, moved = in_order(self.columns, _WIDTH)
        unit = 1 if self.fine else US
        switches, busy = Switches(self.problems), set[int]()  # with a job: woken, or seen running
        for line, time, core, sort, one, other, priority, state in table.tolist():
            time //= unit
            if sort == _GAP:
                switches.lost(core)
                continue
            switches.seen(time, core)
            if sort == _WOKEN and one not in busy and one != NOBODY:
                busy.add(one)
                switches.release(time, core, one)
            elif sort == _SWITCHED:
                if one != NOBODY and state != READY:
                    switches.complete(time, core, one)
                    busy.discard(one)
                elif one != NOBODY:
                    busy.add(one)
                if other != NOBODY and other not in busy:
                    busy.add(other)
                    switches.release(time, core, other)
                switches.switch(line, time, core, one, state, other, priority)
        names = [f"{printable(comm)}-{pid}" for comm, pid in zip(self.comms, list(self.threads)[1:], strict=True)]
        start, end = (int(table[place, 1]) // unit for place in (0, -1))
        trace, notes = switches.trace(names, 10**9 // unit, start, end)
        if not self.wakeups:
            notes.append("no wakeups in it: a job begins when it first runs, so its response time is without the wait before")
        report = Report.of(
            title,
            len(trace.cores()),
            self.problems,
            "ftrace",
            self.lines,
            comments=self.comments,
            empty=self.empty,
            skipped=self.others,
            moved=moved,
            notes=notes,
        )
        return trace, report


def _is_head(line: str) -> bool:
    return line.startswith("#") or bool(_HEAD.fullmatch(line) or _LOST.match(line))


def _state(text: str) -> int:
    """A thread's state when it is switched out: R and R+ are preempted; old recordings have numbers, with 0 for it."""
    if text.startswith("R") or (text.isascii() and text.isdigit() and int(text[:9]) & 0xFF == 0):
        return READY
    return {"T": SUSPENDED, "t": SUSPENDED, "X": DELETED, "Z": DELETED}.get(text[0], BLOCKED)
