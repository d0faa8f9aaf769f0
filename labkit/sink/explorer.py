"""Every interleaving of a machine's threads, breadth first, so that the first failure is a shortest one.

What a single step can do wrong is seen at once. What never happens is seen when all states are known: a state from which the
work cannot be finished, whatever comes, is a trap. Nothing is assumed of a schedule but that it may do what it may do; so
spinning is no failure as long as the one who is waited for can still run.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from labkit.sink.machine import Machine, State

#: What a search can find out. "undecided": the budget was spent first, which is no verdict.
VERDICTS = ("ok", "stale", "torn", "lost", "overwritten", "deadlock", "livelock", "assert", "undecided")

#: States after which a search stops, if nothing else is said: about 200 MB and 10 s at most.
BUDGET = 500_000

#: Goes round the states of a search, given them and the budget; `labkit.experiment.progress` fits, and may raise to end it.
Watch = Callable[[Iterable[State], int], Iterable[State]]

#: The largest budget: with the largest rings some 3 GB.
MOST_BUDGET = 2_000_000


@dataclass(frozen=True)
class Search:
    """What was found.

    Attributes:
        verdict: one of `VERDICTS`.
        states: different states seen.
        schedule: which thread takes each step of the shortest way to the failure; empty without one.
        loop: for a livelock, the step from which on the way repeats for ever; its last step leads back there.
    """

    verdict: str
    states: int
    schedule: tuple[int, ...] = ()
    loop: int | None = None


@dataclass
class _Graph:
    """The states in the order in which they were found, how each was reached first, and all steps between them."""

    states: list[State]
    parent: array[int] = field(default_factory=lambda: array("q", [0]))
    mover: array[int] = field(default_factory=lambda: array("b", [-1]))
    begin: array[int] = field(default_factory=lambda: array("q", [0]))  # of each expanded state's steps in the next two
    target: array[int] = field(default_factory=lambda: array("q"))
    thread: array[int] = field(default_factory=lambda: array("b"))

    def way(self, state: int) -> list[int]:
        """The threads that step from the first state to this one."""
        steps = []
        while state:
            steps.append(self.mover[state])
            state = self.parent[state]
        return steps[::-1]


def search(machine: Machine, budget: int = BUDGET, watch: Watch = lambda states, budget: states) -> Search:
    """Looks at all interleavings, or at `budget` different states at most; `watch` sees each state as it is taken up."""
    graph = _Graph([machine.initial])
    number = {machine.initial: 0}
    states, parent, mover, target, thread_of = graph.states, graph.parent, graph.mover, graph.target, graph.thread
    can_step, step = machine.can_step, machine.step
    for here, state in enumerate(watch(states, budget)):  # they grow while they are walked
        for thread in can_step(state):
            after, wrong = step(state, thread)
            if wrong:
                return Search(wrong, len(states), (*graph.way(here), thread))
            there = number.setdefault(after, len(states))
            if there == len(states):
                if there == budget:
                    return Search("undecided", there)
                states.append(after)
                parent.append(here)
                mover.append(thread)
            target.append(there)
            thread_of.append(thread)
        graph.begin.append(len(target))
    return _trap(machine, graph) or Search("ok", len(states))


def _trap(machine: Machine, graph: _Graph) -> Search | None:
    """The first state in which nobody gets on for ever, if any.

    Those who are caught either all wait, asleep or blocked, and look again after each tick in vain: a deadlock; or, if all
    producers are through, what they wrote is lost. Or someone goes round in a circle without a tick: a livelock.
    """
    caught = _caught(machine, graph)
    if not caught:
        return None
    count, running = len(graph.states), {}
    for state in sorted(caught):
        each = range(graph.begin[state], graph.begin[state + 1])
        running[state] = [i for i in each if not machine.asleep(graph.states[state], graph.thread[i])]
        if not running[state]:
            verdict = "lost" if machine.written(graph.states[state]) else "deadlock"
            return Search(verdict, count, tuple(graph.way(state)))
    state, steps, passed = min(caught), list[int](), dict[int, int]()
    while state not in passed:  # somebody runs in each of them: somewhere this comes around
        passed[state] = len(steps)
        steps.append(running[state][0])
        state = graph.target[steps[-1]]
    entry = graph.way(min(caught))
    return Search("livelock", count, (*entry, *(graph.thread[i] for i in steps)), len(entry) + passed[state])


def _caught(machine: Machine, graph: _Graph) -> list[int]:
    """States from which no finished one can be reached."""
    count = len(graph.states)
    begin, target = np.frombuffer(graph.begin, np.int64), np.frombuffer(graph.target, np.int64)
    before = np.repeat(np.arange(count), np.diff(begin))[np.argsort(target, kind="stable")]  # whence one gets to each, in turn
    first = np.concatenate([[0], np.cumsum(np.bincount(target, minlength=count))])
    free = np.fromiter(map(machine.finished, graph.states), bool, count)
    todo = np.flatnonzero(free)
    while len(todo):
        many = first[todo + 1] - first[todo]
        some = before[np.repeat(first[todo] - np.cumsum(many) + many, many) + np.arange(many.sum())]
        todo = np.unique(some[~free[some]])
        free[todo] = True
    return np.flatnonzero(~free).tolist()
