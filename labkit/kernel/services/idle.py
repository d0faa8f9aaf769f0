"""The idle task: what is left of the time, and of tasks that have ended (rules 56 and 57)."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any

from labkit.kernel.objects import FOREVER, Task
from labkit.kernel.services.memory import give_back_all

if TYPE_CHECKING:
    from labkit.kernel.core import Core


def idle_body(k: Core, should_yield: bool) -> Generator[Any, Any, None]:
    """Its body. It comes round whenever a task has ended, or another one of its priority may be ready."""
    while True:
        while k.ended:
            give_back_all(k, k.idle.code, k.ended.pop(0))
        if should_yield and len(k.ready.rings[0]) > 2:
            yield _give_way, ()
        else:
            yield FOREVER


def _give_way(k: Core, idle: Task) -> None:
    k.reschedule()
