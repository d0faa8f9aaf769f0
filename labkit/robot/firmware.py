"""The robot's software under FreeRTOS: tasks, priorities and queues of source 1 (tables `xu2025_tasks`, `xu2025_channels`).

Five tasks of equal priority share the processor with the two of the trace path; who runs first among equals follows from the
kernel's lists, as on the board. What the tasks compute is the firmware's, on a plant that goes along with the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from labkit.kernel import Costs, Kernel
from labkit.robot.button import Button
from labkit.robot.control import PoseController, Smoother, Velocity, WheelController, duties
from labkit.robot.mecanum import Pose, Wheels, body_velocity, moved, wheel_speeds
from labkit.robot.plant import Body, Plant, added, angles
from labkit.robot.rates import CPU_HZ, PERIODIC, RATES, Rates, execution, stamp_line
from labkit.robot.reception import VelocityLine
from labkit.robot.trace_path import Sink, TracePath, install, with_hook

#: Priorities as published; IDLE is the kernel's own.
PRIORITIES = {
    "tsink": 32,
    "hal_fetch": 24,
    "recv_vel": 24,
    "pose_ctrl": 24,
    "wheel_ctrl": 24,
    "odometry": 24,
    "profile": 24,
    "Tmr Svc": 2,
}
#: The order of creation, from the published task numbers, and the free stack in words.
CREATED = {
    "tsink": 483,
    "hal_fetch": 443,
    "recv_vel": 441,
    "pose_ctrl": 410,
    "wheel_ctrl": 420,
    "odometry": 416,
    "profile": 900,
    "Tmr Svc": 223,
}
#: What the kernel takes in cycles. Not published: a switch is about the gap between two stamps of listings 37 and 38 (0.8 us).
COSTS = Costs(tick=200, switch=150)
STILL: Wheels = (0.0, 0.0, 0.0, 0.0)

Channel = Literal["overwrite", "accumulate", "positions", "queue"]
CHANNELS: dict[str, str] = {
    "overwrite": "overwrite deltas (published)",
    "accumulate": "accumulate in the fetch task",
    "positions": "send positions, not deltas",
    "queue": "queue of 16, drained to the end",
}
ROOM = 16  # items in each FIFO


@dataclass(frozen=True)
class Firmware:
    """What runs on the board.

    Attributes:
        rates: the tick and the periods.
        work: cycles of one job of each task; made by `published` from the source's tables.
        channel: how encoder readings get to the odometry. "overwrite" is the published one.
        wheel_control, pose_control: the controllers; both are off in the branch that was measured.
        wheel_gain, pose_gain: factors on the gains of the firmware.
        buffers: for velocity frames; 1 is the published one, see `VelocityLine`.
        wrap_defect: the encoder's end subtracts 65534 downwards.
        trace_path: the sink and who feeds it; None leaves `tsink` and `profile` out.
        debounce: of the button that starts and stops the recording, in ms; 100 in the text of source 1, 50 in its public branch.
            None: there is no button, and all is recorded from the start.
        costs: what the kernel takes.
        order: the order in which the tasks are created, which decides who goes first among equals.
        time_slicing: whether tasks of equal priority take turns at the tick.
        priorities: of all tasks; the published ones have `profile` among the control tasks.
    """

    rates: Rates
    work: Mapping[str, int]
    channel: Channel = "overwrite"
    wheel_control: bool = False
    pose_control: bool = False
    wheel_gain: float = 1.0
    pose_gain: float = 1.0
    buffers: int = 1
    wrap_defect: bool = True
    trace_path: TracePath | None = None
    debounce: int | None = None
    costs: Costs = COSTS
    order: tuple[str, ...] = tuple(CREATED)
    time_slicing: bool = True
    priorities: Mapping[str, int] = field(default_factory=PRIORITIES.copy)

    def __post_init__(self) -> None:
        if self.channel not in CHANNELS:
            raise ValueError(f"channel {self.channel!r}; there are {', '.join(CHANNELS)}")
        if set(self.order) != set(CREATED):
            raise ValueError(f"the order names {', '.join(self.order)}; it must have each of {', '.join(CREATED)} once")
        for what, known in (("work", {*PERIODIC, "recv_vel"}), ("priorities", CREATED)):
            if missing := set(known) - set(getattr(self, what)):
                raise ValueError(
                    f"{what} has nothing for {', '.join(sorted(missing))}; it needs each of {', '.join(sorted(known))}"
                )


def published(rates: str = "50|30", caches: bool = True, tracing: bool = True, **changes: Any) -> Firmware:
    """The firmware of source 1 at one of its `RATES`, with its mean execution times; `changes` to any other attribute."""
    if rates not in RATES:
        raise ValueError(f"no rates {rates!r} in source 1; there are {', '.join(RATES)}")
    recording = rates if rates in ("50|30", "100|50") else "100|50"
    work = execution(caches, recording)
    path = TracePath(stamp=stamp_line(caches, recording), look=work["tsink"]) if tracing else None
    return replace(Firmware(RATES[rates], work, trace_path=path), **changes)


@dataclass
class Board:
    """A built system: the kernel and what is around it.

    Attributes:
        pose: what the odometry tells. seen: the way it has seen, in mm.
        sink: what became of the stamps; None without a trace path.
        late: calls of delay_until that found their next period already over, by task.
        line: on which velocity frames come.
        button: that starts and stops the recording; None if all is recorded.
    """

    kernel: Kernel
    plant: Body
    firmware: Firmware
    sink: Sink | None = None
    pose: Pose = (0.0, 0.0, 0.0)
    seen: float = 0.0
    late: dict[str, int] = field(default_factory=lambda: dict.fromkeys(PERIODIC, 0))
    line: VelocityLine = field(default_factory=lambda: VelocityLine(CPU_HZ))
    receiver: Any = None
    button: Button | None = None

    def advance(self, until: int) -> None:
        """Kernel and plant, up to cycle `until`."""
        self.kernel.advance(until)
        self.plant.advance(until)

    def command(self, velocity: Velocity) -> None:
        """A velocity frame comes to the line now; at its last byte there is an interrupt."""
        complete = self.line.send(self.kernel.now, velocity)
        self.kernel.interrupt(complete, lambda isr: isr.notify_give(self.receiver))

    def press(self, bounces: Sequence[int] = (0,)) -> None:
        """The button is pressed; its contact closes so many cycles from now, each time with an interrupt."""
        button = self.button
        if button is None:
            raise ValueError("there is no button; a firmware with a debounce time has one")
        for after in bounces:
            self.kernel.interrupt(self.kernel.now + after, lambda isr: button.edge(isr.now))


def build(firmware: Firmware, plant: Body | None = None) -> Board:
    """Tasks, queues and interrupts in a kernel that has not started. Raises ValueError for what the kernel refuses."""
    rates, path = firmware.rates, firmware.trace_path
    costs = with_hook(firmware.costs, path)
    k = Kernel(CPU_HZ, rates.tick_hz, priorities=56, costs=costs, time_slicing=firmware.time_slicing)
    board = Board(k, plant or Plant(CPU_HZ), firmware, line=VelocityLine(CPU_HZ, buffers=firmware.buffers))
    bodies = {**control_tasks(board), "Tmr Svc": idle_timers}
    if firmware.debounce is not None:
        board.button = Button(CPU_HZ, firmware.debounce)
    if path is not None:
        board.sink, tracers, scoped = install(k, path, board.button)
        bodies |= {name: scoped(name, rates.period(name), bodies[name]) for name in PERIODIC} | tracers
    for name in firmware.order:
        if name in bodies:
            deadline = rates.period(name) * k.tick if name in PERIODIC else None
            k.task(name, bodies[name], firmware.priorities[name], deadline, CREATED[name])
    board.receiver = next(task for task in k.tasks if task.name == "recv_vel")
    return board


def idle_timers(os: Any) -> Any:
    """The timer service: nobody uses a timer while the robot drives."""
    yield os.notify_take()


def control_tasks(board: Board) -> dict[str, Callable[[Any], Any]]:
    """The bodies of the five tasks between encoders and motors."""
    k, plant, firmware = board.kernel, board.plant, board.firmware
    channel, work, late = firmware.channel, firmware.work, board.late
    period = {name: firmware.rates.period(name) for name in PERIODIC}
    seconds = {name: firmware.rates.seconds(name) for name in PERIODIC}
    enc_odom = k.queue("enc_delta_odom_queue", ROOM if channel == "queue" else 1)
    enc_wheel = k.queue("enc_delta_wheel_ctrl_queue", ROOM)
    set_points, poses = k.queue("vel_sp_queue", ROOM), k.queue("odom_queue", 1)
    wheels = k.queue("vel_wheel_queue", 1)

    def hal_fetch(os: Any) -> Any:
        cycles, defect, pause = work["hal_fetch"], firmware.wrap_defect, os.delay_until(period["hal_fetch"])
        take_back = os.receive(enc_odom, 0)
        old, total = (0, 0, 0, 0), STILL
        while True:
            new = plant.counters(os.now)
            delta = angles(new, old, defect)
            old = new
            yield cycles
            yield os.send(enc_wheel, delta, 0)
            if channel == "overwrite":
                yield os.overwrite(enc_odom, delta)
            elif channel == "queue":
                yield os.send(enc_odom, delta, 0)
            elif channel == "positions":
                total = added(total, delta)
                yield os.overwrite(enc_odom, total)
            else:  # what nobody has read is taken back and made part of the new one
                unread = yield take_back
                yield os.overwrite(enc_odom, delta if unread is None else added(unread, delta))
            if not (yield pause):
                late["hal_fetch"] += 1

    def odometry(os: Any) -> Any:
        cycles, fetch, pause = work["odometry"], os.receive(enc_odom, 0), os.delay_until(period["odometry"])
        last = STILL
        while True:
            got = yield fetch
            if channel == "overwrite":  # none there: the value of before once more
                turned = last = last if got is None else got
            elif channel == "positions":
                turned = STILL if got is None else added(got, last, -1)
                last = last if got is None else got
            else:
                turned = STILL if got is None else got
                while channel == "queue" and got is not None:
                    got = yield fetch
                    turned = turned if got is None else added(turned, got)
            if turned != STILL:
                dx, dy, turn, _ = body_velocity(turned)
                board.pose = moved(board.pose, dx, dy, turn)
                board.seen += (dx * dx + dy * dy) ** 0.5
            yield cycles
            yield os.overwrite(poses, board.pose)
            if not (yield pause):
                late["odometry"] += 1

    def pose_ctrl(os: Any) -> Any:
        smoother = Smoother()
        controller = PoseController(seconds["pose_ctrl"], firmware.pose_control, firmware.pose_gain)
        cycles, pause = work["pose_ctrl"], os.delay_until(period["pose_ctrl"])
        set_point, locate = os.receive(set_points, 0), os.receive(poses, 0)
        wanted, pose = (0.0, 0.0, 0.0), board.pose
        asked, speeds = wanted, STILL
        while True:
            wanted = (yield set_point) or wanted
            pose = (yield locate) or pose
            velocity = controller.command(smoother.step(wanted), pose)
            if velocity != asked:  # at 10 kHz it mostly is the same
                asked, speeds = velocity, wheel_speeds(*velocity)
            yield cycles
            yield os.overwrite(wheels, speeds)
            if not (yield pause):
                late["pose_ctrl"] += 1

    def wheel_ctrl(os: Any) -> Any:
        controller = WheelController(seconds["wheel_ctrl"], firmware.wheel_control, firmware.wheel_gain)
        cycles, pause = work["wheel_ctrl"], os.delay_until(period["wheel_ctrl"])
        fetch, set_point = os.receive(enc_wheel, 0), os.receive(wheels, 0)
        turned = wanted = asked = STILL
        duty = duties(STILL)
        while True:
            turned = (yield fetch) or turned
            wanted = (yield set_point) or wanted
            yield cycles
            command = controller.command(wanted, turned)
            if command != asked:
                asked, duty = command, duties(command)
            plant.drive(os.now, duty)
            if not (yield pause):
                late["wheel_ctrl"] += 1

    def recv_vel(os: Any) -> Any:
        while True:
            yield os.notify_take()
            velocity = board.line.read(os.now)
            yield work["recv_vel"]
            if velocity is not None:
                yield os.send(set_points, velocity, 0)

    return {f.__name__: f for f in (hal_fetch, odometry, pose_ctrl, wheel_ctrl, recv_vel)}
