"""A thread written as a generator, as a table: position -> access, and position and answer -> next position.

Generators cannot be copied. They can be run again: a position is remembered by the answers that led to it, and from there the
thread is replayed. It is done once per position and answer and not once per step of the search; after that a step is a look-up.

Two histories lead to the same position if the thread stands at the same place with the same local variables. So a thread keeps
everything in local variables, of values that can be hashed, and never two accesses in one expression: what Python holds between
them is not seen here. Variables that are not needed any more are best left behind in a function of their own, else they
only multiply the positions.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

from labkit.sink.accesses import DONE, Access, Kind

#: The code of a thread: yields accesses, is sent their answers.
Thread = Generator[Access, Any, Any]


class Node:
    """A position of a thread: the access that comes next, and where each answer leads (filled on demand)."""

    __slots__ = ("a", "access", "b", "claims", "history", "kind", "next", "number", "variable")

    def __init__(self, number: int, access: Access, history: tuple[int | None, ...], place: dict[str, int]) -> None:
        self.number, self.access, self.history = number, access, history
        self.kind = int(access.kind)
        self.variable = place[access.variable] if access.variable else -1
        self.a, self.b, self.claims = access.a, access.b, access.claims
        self.next: dict[int, int] = {}


class Automaton:
    """The table of one thread.

    Args:
        start: begins the thread anew.
        place: index of each shared variable in a state.
        releases: whether waiting for a release is a step.
        merge: whether positions with the same place and variables are one. If not, each history is a position of its own: for
            tests, and for threads that end.
    """

    def __init__(self, start: Callable[[], Thread], place: dict[str, int], releases: bool = True, merge: bool = True) -> None:
        self._start, self._place, self._releases, self._merge = start, place, releases, merge
        self._known: dict[Any, int] = {}
        self.nodes: list[Node] = []
        self._reach(())

    def follow(self, node: Node, answer: int) -> int:
        """Number of the position after `node` if its access gives `answer`."""
        return node.next.setdefault(answer, self._reach((*node.history, answer)))

    def _reach(self, history: tuple[int | None, ...]) -> int:
        access, position = self._replay(history)
        number = self._known.setdefault(position if self._merge else history, len(self.nodes))
        if number == len(self.nodes):
            self.nodes.append(Node(number, access, history, self._place))
        return number

    def _replay(self, history: tuple[int | None, ...]) -> tuple[Access, Any]:
        thread = self._start()
        try:
            access = self._skip(thread, next(thread))
            for answer in history:
                access = self._skip(thread, thread.send(answer))
        except StopIteration:
            return DONE, None
        return access, _position(thread)

    def _skip(self, thread: Thread, access: Access) -> Access:
        while access.kind == Kind.RELEASE and not self._releases:
            access = thread.send(None)
        return access


def _position(thread: Any) -> tuple[Any, ...]:
    """Where a suspended generator stands, and those it delegates to: code, instruction and local variables of each."""
    found = []
    while thread is not None:
        frame = thread.gi_frame
        found.append((frame.f_code, frame.f_lasti, *dict(frame.f_locals).items()))
        thread = thread.gi_yieldfrom
    return tuple(found)
