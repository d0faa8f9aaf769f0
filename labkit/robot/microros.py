"""The robot's software under micro-ROS: one task `uros` that spins three executors in turn, above XRCE-DDS over UDP (S8).

The same control functions as in `firmware`, as callbacks. All data between them travels to the agent on the host and back:
encoder data from the wheel controller to the odometry, the pose to the pose controller, set points to the wheel controller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np

from labkit.data import published_table
from labkit.kernel import Costs, Kernel
from labkit.robot.firmware import COSTS
from labkit.robot.microros_executor import Callback, Client, Executor, Requests, Subscription, Timer, TimerRule, WaitRule, spin
from labkit.robot.microros_network import (
    ACKNOWLEDGED,
    ASKED,
    ENCODER_DATA,
    MISSING,
    ODOMETRY,
    WHEEL_VEL,
    Agent,
    Host,
    Message,
    go_along,
    install_network,
)
from labkit.robot.rates import CPU_HZ
from labkit.robot.trace_path import Sink, TracePath, install, with_hook
from labkit.trace import Trace

#: Priorities and free stack words as published, in the order of the task numbers; IDLE is the kernel's own.
TASKS = {
    "tsink": (32, 475),
    "profile": (24, 892),
    "uros": (24, 2548),
    "Tmr Svc": (2, 223),
    "tcpip_thread": (24, 180),
    "EthIf": (48, 17),
    "EthLink": (16, 193),
}
PARTS = 20  # of a run, per second
ANSWERS = {ACKNOWLEDGED: True, MISSING: False}
CALLBACKS = ("w_ctrl", "p_ctrl", "odom")
LINK_EVERY, LINK_PHASE = 100, 7  # ms between two questions of EthLink to the network chip; when it begins (an assumption)
#: Of a spin pass the part before the wait; the source tells the whole only, the split is an assumption.
BEFORE = 35 / 65
#: A published mean of a callback lasts from its begin stamp to its end stamp, whoever ran in between. Without caches `EthIf` and
#: `tcpip_thread` do, with the frame that the wheel controller has just sent round: us of it per call, by wheel rate, chosen such
#: that the model's means come out as published. (It makes the odd factor 4.3 of `p_ctrl` between caches off and on a usual 3.)
INTERRUPTED = {50: {"w_ctrl": 14.0, "p_ctrl": 82.0}, 100: {"w_ctrl": 25.0, "p_ctrl": 92.0}}
#: The timer that publishes the odometry is not traced; it is taken to cost this share of `p_ctrl`, which publishes as little.
ODOMETRY_TIMER = 0.8


@dataclass(frozen=True)
class Work:
    """Cycles of everything on the board.

    Attributes:
        w_ctrl, p_ctrl, odom, odometry_timer: a callback, publishing included.
        spin: a pass of an executor without its callbacks. eth_if, tcpip: a frame. link: a question of EthLink.
        stamp: printing one stamp. look: a look of `tsink` at its ring.
    """

    w_ctrl: int
    p_ctrl: int
    odom: int
    odometry_timer: int
    spin: int
    eth_if: int
    tcpip: int
    link: int
    stamp: int
    look: int


@cache
def recorded(wheel_hz: int, caches: bool) -> dict[str, tuple[float, int]]:
    """Name -> (mean, sum) in us of the recording under micro-ROS at 50|30 or 100|50 Hz (source 1, tables 2 to 5)."""
    table = published_table("xu2025_runtime_stats.csv")
    rows = table[
        (table["platform"] == "micro-ROS") & (table["wheel_hz"] == wheel_hz) & (table["caches"] == ("on" if caches else "off"))
    ]
    if rows.empty:
        raise ValueError(f"no recording under micro-ROS at {wheel_hz} Hz; there are those at 50 and 100 Hz")
    return dict(zip(rows["name"], zip(rows["mean_us"].tolist(), rows["sum_us"].tolist(), strict=True), strict=True))


@cache
def work(wheel_hz: int = 100, caches: bool = True) -> Work:
    """Execution times from a published recording: means where they are told, sums shared out where they are not.

    A stretch of `uros` lasts from one wait to the next, so what is left of it without callbacks is one spin pass. Every stretch
    of a task has two stamps for `profile` to print; callbacks write their own.
    """
    rows = recorded(wheel_hz, caches)
    mean = {name: m for name, (m, _) in rows.items()}
    total = {name: float(s) for name, (_, s) in rows.items()}
    calls = {name: total[name] / mean[name] for name in rows}
    for name, others in ({} if caches else INTERRUPTED[wheel_hz]).items():
        mean[name] -= others
        total[name] -= others * calls[name]
    seconds = calls["w_ctrl"] / wheel_hz  # by the recording's own clock
    publishing = ODOMETRY_TIMER * mean["p_ctrl"]
    inside = sum(total[name] for name in CALLBACKS) + publishing * calls["p_ctrl"]
    stretches = sum(calls[name] for name in rows if name not in CALLBACKS)
    us = {
        "w_ctrl": mean["w_ctrl"],
        "p_ctrl": mean["p_ctrl"],
        "odom": mean["odom"],
        "odometry_timer": publishing,
        "spin": (total["uros"] - inside) / calls["uros"],
        "eth_if": mean["EthIf"],
        "tcpip": total["tcpip_thread"] / calls["EthIf"],  # a frame; its mean is of pieces
        "link": total["EthLink"] / seconds * LINK_EVERY / 1000,
        "stamp": total["profile"] / (2 * stretches),
        "look": mean["tsink"],
    }
    return Work(**{name: round(value * CPU_HZ / 1e6) for name, value in us.items()})


@dataclass(frozen=True)
class MicroRos:
    """What runs on the board, and what it talks to.

    Attributes:
        wheel, pose: periods of the timers in ms, which are ticks; the odometry is published with the pose period.
        work: execution times.
        executors: three in turn as in the firmware, or one for everything.
        timer_rule, wait_rule: see `microros_executor`.
        limit: of a spin, in ms.
        reliable: a publish stays inside the callback until the agent has acknowledged; the firmware's are best effort.
        phase: tick at which the timers of the executors are created. `profile` starts at tick 0 and works every 10 ms, so this
            decides whether it and the callbacks meet. Not published; on the board it is when the agent has answered.
        trace_path: the sink and who feeds it; None leaves `tsink` and `profile` out.
        host: agent, host and cable. costs: what the kernel takes.
    """

    wheel: int
    pose: int
    work: Work
    executors: Literal["three", "one"] = "three"
    timer_rule: TimerRule = "jazzy"
    wait_rule: WaitRule = "poll"
    limit: int = 1
    reliable: bool = False
    phase: int = 5
    trace_path: TracePath | None = None
    host: Host = field(default_factory=Host)
    costs: Costs = COSTS

    def __post_init__(self) -> None:
        if self.executors not in ("three", "one"):
            raise ValueError(f"{self.executors!r} executors; there are three, as in the firmware, or one")
        if self.limit < 0:
            raise ValueError(f"a spin limit of {self.limit} ms; 0 or more is allowed")
        if self.phase < 0:
            raise ValueError(f"timers created at tick {self.phase}; 0 or later is allowed")


def robot(wheel: int = 10, pose: int = 20, caches: bool = True, tracing: bool = False, **changes: Any) -> MicroRos:
    """The robot with periods in ms, and the execution times of the nearer recording; `changes` to any other attribute."""
    cycles = work(50 if wheel >= 20 else 100, caches)
    path = TracePath(stamp=cycles.stamp, look=cycles.look, batch=8) if tracing else None
    return replace(MicroRos(wheel, pose, cycles, trace_path=path), **changes)


@dataclass(frozen=True)
class Recording:
    """What a run leaves behind.

    Attributes:
        trace: of the kernel, with the callbacks as scopes. setup: what ran.
        waits: rows of the executors' waits, see `Client`. encoder: the number of the encoder data among the topics.
        dropped: periods that each timer jumped over. unconfirmed: reliable publishes given up after a second.
        sink: what became of the stamps.
    """

    trace: Trace
    setup: MicroRos
    waits: np.ndarray
    encoder: int
    dropped: dict[str, int]
    unconfirmed: int
    sink: Sink | None

    @property
    def begin(self) -> float:
        """When the first call of the wheel controller is due, in s; what is told per second counts from here."""
        return (self.setup.phase + self.setup.wheel) / 1000

    @property
    def seconds(self) -> float:
        """Length without that."""
        return self.trace.end / self.trace.hz - self.begin

    def passes(self, callback: str) -> np.ndarray:
        """Begin and end of each call of a callback in cycles, shape (n, 2); one that the end of the run cuts ends there."""
        of = self.trace.task == (self.trace.code(callback) if callback in self.trace.names else -1)
        begins, ends = self.trace.time[self.trace.of("begin") & of], self.trace.time[self.trace.of("end") & of]
        return np.stack([begins, np.append(ends, self.trace.end)[: len(begins)]], axis=1)

    @cached_property
    def calls(self) -> np.ndarray:
        """When the wheel controller was called, in s."""
        return self.passes("w_ctrl")[:, 0] / self.trace.hz

    @property
    def rate(self) -> float:
        """Calls of the wheel controller per second."""
        return len(self.calls) / self.seconds

    def windows(self, length: float = 1.0) -> np.ndarray:
        """Its rate in each whole window of so many seconds, at least one."""
        count = max(int(self.seconds / length + 1e-9), 1)
        return np.histogram(self.calls, count, (self.begin, self.begin + count * length))[0] / length

    @cached_property
    def intervals(self) -> np.ndarray:
        """Between two calls of the wheel controller, in ms."""
        return np.diff(self.calls) * 1e3

    def ended(self, how: int) -> float:
        """Waits per second that could block and ended so: by DATA (D of the guide) or by a TICK (K)."""
        some = (self.waits[:, 0] > 0) & (self.waits[:, 1] == how) & (self.waits[:, 2] >= self.begin * self.trace.hz)
        return float(some.sum()) / self.seconds

    @property
    def paid(self) -> float | None:
        """a of the guide: encoder data that end a blocking wait, per call of the wheel controller; None if there was no call."""
        ended = (self.waits[:, 0] > 0) & (self.waits[:, 3] == self.encoder)
        return float(ended.sum()) / len(self.calls) if len(self.calls) else None

    def guide(self, ticks: float = 1000) -> float | None:
        """R = K / (2 - a), for so many waits per second that a tick ends, at most 1000.

        Of the three waits of a round the wheel executor's does not block, each of the others ends by data or by a tick. What the
        pose adds cancels out: each of its two timers saves a wait, each of its two messages ends one.
        """
        return ticks / (2 - self.paid) if self.paid is not None and self.paid < 2 else None


#: Sends a message, from inside a callback.
Publish = Callable[[Any, Message], Requests]


def _publishes(name: str, cycles: int, message: Message | None, publish: Publish) -> Callback:
    """A callback that computes, then sends: serialising and the UDP send are part of its cycles, in the context of `uros`."""

    def callback(os: Any, _: Any) -> Any:
        yield os.begin(name)
        yield cycles
        if message is not None:
            yield from publish(os, message)
        yield os.end(name)

    return callback


def _keeps(os: Any, message: Any) -> Any:
    """A callback that only remembers what it got; its time is in the spin pass."""
    yield 0


def executors(setup: MicroRos, publish: Publish) -> list[Executor]:
    """The executors of the firmware, or the one in their place: their handles in order, semantics and triggers."""
    cycles, how = setup.work, (setup.timer_rule, setup.phase)
    before = round(cycles.spin * BEFORE)
    each: dict[str, Any] = {"limit": setup.limit, "before": before, "after": cycles.spin - before}
    wheel = Timer(setup.wheel, _publishes("w_ctrl", cycles.w_ctrl, ENCODER_DATA, publish), *how)
    odometry = Timer(setup.pose, _publishes("odometry", cycles.odometry_timer, ODOMETRY, publish), *how)
    pose = Timer(setup.pose, _publishes("p_ctrl", cycles.p_ctrl, WHEEL_VEL, publish), *how)
    encoder = Subscription("encoder_data", _publishes("odom", cycles.odom, None, publish))
    if setup.executors == "one":
        inputs = [Subscription(topic, _keeps) for topic in ("wheel_vel", "cmd_vel", "odometry")]
        return [Executor("all", [inputs[0], wheel, encoder, odometry, *inputs[1:], pose], **each)]
    wheel_vel, located = (Subscription(topic, _keeps, always=True) for topic in ("wheel_vel", "odometry"))
    cmd_vel = Subscription("cmd_vel", _keeps)
    return [
        Executor("wheel", [wheel_vel, wheel], "let", trigger=1, **each),
        Executor("odometry", [encoder, odometry], **each),
        Executor("pose", [cmd_vel, located, pose], "let", trigger=2, **each),
    ]


def simulate(setup: MicroRos, seconds: float, steps: Callable[[Iterable[int]], Iterable[int]] = iter) -> Recording:
    """Board and host from power-on to so many seconds after the wheel controller is first due.

    `steps` goes round the parts of the run, for whoever wants to see how far it is.
    """
    k = Kernel(CPU_HZ, 1000, priorities=56, costs=with_hook(setup.costs, setup.trace_path))
    outbox: list[tuple[Message, int]] = []

    def publish(os: Any, message: Message) -> Requests:
        outbox.append((message, os.now))
        if setup.reliable:
            yield from client.confirm(os, ANSWERS.get, lambda data: outbox.append((message if data else ASKED, os.now)))

    spun = executors(setup, publish)
    handles = [handle for executor in spun for handle in executor.handles]
    sink, tracers, _ = install(k, setup.trace_path) if setup.trace_path else (None, {}, None)
    mailbox, interface, stack, deliver = install_network(k, setup.work.eth_if, setup.work.tcpip)
    client = Client(
        mailbox,
        [h for h in handles if isinstance(h, Subscription)],
        lambda message: None if message in ANSWERS else message.topic,
        rule=setup.wait_rule,
    )

    def link(os: Any) -> Any:
        yield os.delay(LINK_PHASE)
        while True:
            yield setup.work.link
            yield os.delay(LINK_EVERY)

    def timers(os: Any) -> Any:
        yield os.suspend()

    bodies = {
        **tracers,
        "uros": lambda os: spin(os, spun, client),
        "Tmr Svc": timers,
        "tcpip_thread": stack,
        "EthIf": interface,
        "EthLink": link,
    }
    for name, (priority, stack_free) in TASKS.items():
        if name in bodies:
            k.task(name, bodies[name], priority, stack_free=stack_free)
    agent, parts = Agent(setup.host, CPU_HZ, deliver, setup.reliable), max(1, round(PARTS * seconds))
    first = (setup.phase + setup.wheel) * k.tick
    for part in steps(range(1, parts + 1)):
        go_along(k, agent, outbox, first + round(seconds * CPU_HZ * part / parts))
    waits = np.frombuffer(client.waits, dtype=np.int64).reshape(-1, 4)
    names = iter(("w_ctrl", "odometry", "p_ctrl"))
    dropped = {next(names): handle.dropped for handle in handles if isinstance(handle, Timer)}
    return Recording(k.trace, setup, waits, list(client.subscriptions).index("encoder_data"), dropped, client.unconfirmed, sink)
