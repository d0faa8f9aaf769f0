"""How long lower tasks can hold a task up through the locks they share, under each protocol.

The bounds go into response-time analysis as the term B. They count a critical section with its whole length; a section that has
been entered before the blocked job is released has at least begun, so that a simulation stays below them. The rules assume one
processor, a priority of its own for each task, and jobs that suspend themselves only to wait for a lock, without time-out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import add

from labkit.scheduler.analysis.fixed_priority import NO_OVERHEADS, least_window, level_responses
from labkit.scheduler.analysis.verdict import Budget
from labkit.scheduler.tasksets import PeriodicTask, check_names

PROTOCOLS = ("none", "inheritance", "ceiling", "freertos", "non-preemptive")


@dataclass(frozen=True)
class CriticalSection:
    """What one job of `task` executes between taking and giving `lock`.

    Attributes:
        length: execution time from take to give, nested sections included.
        nested: sections inside this one, one after the other.
    """

    task: str
    lock: str
    length: int
    nested: tuple[CriticalSection, ...] = ()

    def __post_init__(self) -> None:
        if self.length < 1:
            raise ValueError(f"task {self.task!r} holds {self.lock!r} for {self.length}; a critical section takes at least 1")
        inner = sum(section.length for section in self.nested)
        if inner > self.length:
            raise ValueError(f"task {self.task!r}: the sections inside {self.lock!r} take {inner}, more than its {self.length}")
        for section in self.nested:
            if section.task != self.task:
                raise ValueError(f"a section of task {section.task!r} cannot stand inside one of task {self.task!r}")
            if any(s.lock == self.lock for s in section.all()):
                raise ValueError(f"task {self.task!r} takes {self.lock!r} while it holds it already")

    def all(self) -> Iterator[CriticalSection]:
        """This section and all inside it, outermost first."""
        yield self
        for section in self.nested:
            yield from section.all()


@dataclass(frozen=True)
class HeldSection:
    """What `task` executes, in one go, with interrupts held (taskENTER_CRITICAL) or the scheduler suspended (vTaskSuspendAll).

    It stands inside or outside of the task's sections with locks, but does not straddle their ends.

    Attributes:
        length: execution time from the first request to the last. Interrupts that run meanwhile are not in it.
    """

    task: str
    length: int

    def __post_init__(self) -> None:
        if self.length < 1:
            raise ValueError(f"task {self.task!r} holds up all others for {self.length}; such a section takes at least 1")


def blocking_bounds(
    tasks: Iterable[PeriodicTask], sections: Iterable[CriticalSection], protocol: str, held: Iterable[HeldSection] = ()
) -> dict[str, int | None]:
    """Longest time for which lower tasks can hold up one job of each task; None where there is no bound, or none is known.

    A lock reaches task i if a task of at least i's priority uses it, or if a lower task takes it inside a section
    of a lock that reaches i (the lower task, on its way to free the outer one, may have to wait for it).

    - "inheritance" (Sha, Rajkumar and Lehoczky 1990): at most one outermost reaching section of each lower task, and at most
      one for each lock: the lesser of the two sums. None if tasks can deadlock over the locks.
    - "ceiling", the immediate ceiling protocol (and the original one): the longest single section of a lower task on a lock whose
      ceiling is at least i's priority.
    - "non-preemptive" sections: the longest single section of any lower task.
    - "freertos" (the kernel's rules 14 to 17): without nesting the same as "inheritance". With nesting a task keeps an
      inherited priority until it has given its *last* mutex, so it blocks for its whole outermost section, even when i waited
      for an inner lock that was given back early; it then runs at i's priority without holding the lock that reached i, so
      that the sum over locks is no bound. What remains is the sum over lower tasks of the longest outermost section
      with a reaching lock anywhere in it. Inheritance does not go along a chain of holders: if such a section takes an
      inner lock that another task below i uses as well, tasks in the middle can come between, and None is returned.
    - "none" (a semaphore): unbounded in general, as tasks in the middle run while the holder waits. A figure is given for the
      classic case, in which one section of i meets sections of one lower task, nothing is nested and no other task above that
      one can wait for a lock: the section plus all jobs that the tasks in the middle can release before it is over. For tasks
      that wait for nobody the figure is the extra interference from higher tasks which, having waited, run late.

    A held section of a lower task blocks everybody, but only if it has been entered when the job is released: while a job
    waits for a lock, only the holder runs below it. So the longest one is added once; not under "ceiling" and "non-preemptive",
    where a job is blocked once in all and the longer counts. With "none" it lengthens the window in which tasks
    in the middle can be released, so a figure is given only without locks.

    Args:
        tasks: in priority order, highest first.
        sections: the outermost sections of each job.
        held: the sections of each job in which interrupts are held or the scheduler is suspended.

    Raises:
        ValueError: unknown protocol, a section of an unknown task, or sections longer than their task's wcet.
        UndecidedError: more than `MAX_STEPS` steps; each task takes 16 for every section.
    """
    tasks, sections, held = check_names(tasks), list(sections), list(held)
    if protocol not in PROTOCOLS:
        raise ValueError(f"no protocol {protocol!r}; there are {', '.join(PROTOCOLS)}")
    _check(tasks, sections)
    longest = _held_below(tasks, held)
    if protocol == "none" and sections:
        return {name: None if held else bound for name, bound in _without_protocol(tasks, sections).items()}
    if protocol == "none":
        return dict(longest)
    combine = max if protocol in ("ceiling", "non-preemptive") else add
    bound = {"inheritance": _inheritance, "freertos": _freertos, "ceiling": _ceiling, "non-preemptive": _non_preemptive}[protocol]
    rank = {task.name: i for i, task in enumerate(tasks)}
    budget, work = Budget("blocking"), sum(1 for top in sections for _ in top.all())
    bounds: dict[str, int | None] = {}
    for i, task in enumerate(tasks):
        budget.spend(16 * work)  # it is looked at again and again
        upper = [s for s in sections if rank[s.task] <= i]
        lower = [s for s in sections if rank[s.task] > i]
        locked = bound(upper, lower)
        bounds[task.name] = None if locked is None else combine(locked, longest[task.name])
    return bounds


def _held_below(tasks: Sequence[PeriodicTask], held: Sequence[HeldSection]) -> dict[str, int]:
    """For each task the longest held section of a lower one."""
    longest = {task.name: 0 for task in tasks}
    for section in held:
        if section.task not in longest:
            raise ValueError(f"a held section belongs to task {section.task!r}; the set has {', '.join(longest)}")
        longest[section.task] = max(longest[section.task], section.length)
    for task in tasks:
        if longest[task.name] > task.wcet:
            raise ValueError(f"task {task.name!r} holds up all others for {longest[task.name]}, longer than its wcet {task.wcet}")
    below, bounds = 0, {}
    for task in reversed(tasks):
        bounds[task.name] = below
        below = max(below, longest[task.name])
    return {task.name: bounds[task.name] for task in tasks}


def deadlock_locks(sections: Iterable[CriticalSection]) -> frozenset[str]:
    """The locks that are taken in a circular order (A inside B and B inside A, or longer); empty if no deadlock is possible."""
    inside: dict[str, set[str]] = {}
    for top in sections:
        for outer in top.all():
            inside.setdefault(outer.lock, set()).update(section.lock for section in outer.nested)
    return frozenset(lock for lock in inside if lock in _reached(lock, inside))


def _reached(lock: str, inside: dict[str, set[str]]) -> set[str]:
    """The locks taken inside this one, or inside one of those, and so on."""
    found: set[str] = set()
    ahead = [lock]
    while ahead:
        new = inside[ahead.pop()] - found
        found |= new
        ahead += new
    return found


def _check(tasks: Sequence[PeriodicTask], sections: Sequence[CriticalSection]) -> None:
    held = {task.name: 0 for task in tasks}
    for section in sections:
        if section.task not in held:
            raise ValueError(f"a critical section belongs to task {section.task!r}; the set has {', '.join(held)}")
        held[section.task] += section.length
    for task in tasks:
        if held[task.name] > task.wcet:
            raise ValueError(f"task {task.name!r} holds locks for {held[task.name]}, longer than its wcet {task.wcet}")


def _reaching(upper: Sequence[CriticalSection], lower: Sequence[CriticalSection]) -> set[str]:
    """The locks through which a section in `lower` can block a task whose own and higher tasks' sections are `upper`."""
    locks = {s.lock for top in upper for s in top.all()}
    while more := {s.lock for top in lower for outer in top.all() if outer.lock in locks for s in outer.all()} - locks:
        locks |= more
    return locks


def _outermost(section: CriticalSection, locks: set[str]) -> Iterator[CriticalSection]:
    """The outermost sections within `section` that are on one of `locks`."""
    if section.lock in locks:
        yield section
    else:
        for inner in section.nested:
            yield from _outermost(inner, locks)


def _longest(sections: Iterable[CriticalSection], key: str) -> dict[str, int]:
    """Length of the longest section for each task or lock."""
    longest: dict[str, int] = {}
    for section in sections:
        group = getattr(section, key)
        longest[group] = max(section.length, longest.get(group, 0))
    return longest


def _inheritance(upper: Sequence[CriticalSection], lower: Sequence[CriticalSection]) -> int | None:
    locks = _reaching(upper, lower)
    if locks & deadlock_locks([*upper, *lower]):
        return None
    blocking = [s for top in lower for s in _outermost(top, locks)]
    return min(sum(_longest(blocking, "task").values()), sum(_longest(blocking, "lock").values()))


def _freertos(upper: Sequence[CriticalSection], lower: Sequence[CriticalSection]) -> int | None:
    if not any(top.nested for top in (*upper, *lower)):
        return _inheritance(upper, lower)
    locks = _reaching(upper, lower)
    if locks & deadlock_locks([*upper, *lower]):
        return None
    blocking = [top for top in lower if any(s.lock in locks for s in top.all())]
    for top in blocking:
        inner = {s.lock for s in list(top.all())[1:]}
        if any(s.lock in inner for other in lower if other.task != top.task for s in other.all()):
            return None
    return sum(_longest(blocking, "task").values())


def _ceiling(upper: Sequence[CriticalSection], lower: Sequence[CriticalSection]) -> int:
    locks = {s.lock for top in upper for s in top.all()}
    return max((s.length for top in lower for s in top.all() if s.lock in locks), default=0)


def _non_preemptive(upper: Sequence[CriticalSection], lower: Sequence[CriticalSection]) -> int:
    return max((top.length for top in lower), default=0)


def _without_protocol(tasks: Sequence[PeriodicTask], sections: Sequence[CriticalSection]) -> dict[str, int | None]:
    """Blocking without any protocol. The window argument for the bounded case:

    Let i wait for a lower task L, and go back to the last instant at which no task above L, i apart, had work. L held
    the lock then, as it has not run since. From that instant until L's give the processor ran only the tasks above L, the part of
    i's job before its take, and L's section, so the window obeys the equation below. None of those tasks waits for a lock, so
    each can be counted by its arrivals.
    """
    budget = Budget("blocking")
    waits = _meetings(tasks, sections, budget)
    nested = any(top.nested for top in sections)
    bounds: dict[str, int | None] = {}
    late: dict[str, int | None] = {}  # for tasks that may wait: how much later than released their work may be done
    for i, task in enumerate(tasks):
        budget.spend(i + 1)
        own = _inversion(tasks, waits, nested, i, budget)
        shifts = [late.get(other.name, 0) for other in tasks[:i]]
        known = [shift for shift in shifts if shift is not None]
        if own is None or len(known) < len(shifts):
            bound = None
        else:
            bound = own + sum(-(-shift // other.period) * other.wcet for shift, other in zip(known, tasks))
        if own != 0:
            responses = level_responses(tasks, i, bound, NO_OVERHEADS, budget)
            if responses is not None and max(responses) <= task.period:
                late[task.name] = max(responses) - task.wcet - task.jitter
            else:
                late[task.name] = bound = None
        bounds[task.name] = bound
    return bounds


#: A section of a task, and one of a lower task on the same lock, with the rank of that one.
Meeting = tuple[CriticalSection, CriticalSection, int]


def _inversion(
    tasks: Sequence[PeriodicTask], waits: Sequence[Sequence[Meeting]], nested: bool, i: int, budget: Budget
) -> int | None:
    """Blocking of task i by a lower one and by those in the middle; 0 if it waits for nobody, None if there is no bound."""
    if not waits[i]:
        return 0
    others = [rank for rank in range(max(rank for _, _, rank in waits[i])) if rank != i]
    takes = {id(own): own for own, _, _ in waits[i]}
    if len(takes) > 1 or nested or any(waits[rank] for rank in others):
        return None
    (own,) = takes.values()
    section = max(theirs.length for _, theirs, _ in waits[i])
    before = tasks[i].wcet - own.length
    window = least_window(before + section, [(tasks[r].wcet, tasks[r].period, tasks[r].jitter) for r in others], budget)
    if window is None:
        return None
    return section + sum(-(-(window + tasks[r].jitter) // tasks[r].period) * tasks[r].wcet for r in others if r > i)


def _meetings(tasks: Sequence[PeriodicTask], sections: Sequence[CriticalSection], budget: Budget) -> list[list[Meeting]]:
    """For each task, by rank, where its sections meet those of lower tasks."""
    rank = {task.name: i for i, task in enumerate(tasks)}
    users: dict[str, list[CriticalSection]] = {}
    for section in (s for top in sections for s in top.all()):
        users.setdefault(section.lock, []).append(section)
    waits: list[list[Meeting]] = [[] for _ in tasks]
    for same in users.values():
        budget.spend(len(same) ** 2)
        for own in same:
            waits[rank[own.task]] += [(own, other, rank[other.task]) for other in same if rank[other.task] > rank[own.task]]
    return waits
