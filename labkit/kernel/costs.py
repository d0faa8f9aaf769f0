"""What the kernel's own work takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from labkit.kernel.checks import whole
from labkit.kernel.services import PRICED


@dataclass(frozen=True)
class Costs:
    """What the kernel itself takes, in CPU cycles. It is charged to no task: the trace has it in `overhead` rows.

    Attributes:
        tick: each tick interrupt. If it is not 0 every tick is simulated, else only those at which something can happen.
        switch: each switch to another task, before that task goes on.
        service: each call of a service, before its effect, by a task or in an interrupt; one number for all of them or a
            mapping from their names (take, give, send, receive, notify_give, delay_until, ...), those left out being free.
        isr_entry, isr_exit: each device interrupt, before and after what it does.
    """

    tick: int = 0
    switch: int = 0
    service: int | Mapping[str, int] = 0
    isr_entry: int = 0
    isr_exit: int = 0

    def __post_init__(self) -> None:
        own = {"tick": self.tick, "switch": self.switch, "isr_entry": self.isr_entry, "isr_exit": self.isr_exit}
        for name, cycles in {**own, **self.by_service}.items():
            if name not in own and name not in PRICED:
                raise ValueError(f"no service {name!r} to cost anything; there are {', '.join(PRICED)}")
            whole(cycles, 0, f"the cost of {name} is", " cycles")

    @property
    def by_service(self) -> dict[str, int]:
        """Cycles of each service."""
        return dict(self.service) if isinstance(self.service, Mapping) else dict.fromkeys(PRICED, self.service)
