"""What a micro-ROS message costs on its way: sizes, the board's network tasks, and the agent on the other side of the cable.

Sizes are those of little-endian CDR in XRCE-DDS over UDP, computed from the message definitions. The agent, the host behind it
and an operator are SimPy processes: they go by their own clock, know nothing of the kernel's ticks, and several messages are on
their way at once. The board's own part (interrupt, `EthIf`, `tcpip_thread`) competes for its processor, so it is tasks of the
kernel. `go_along` advances both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import simpy

from labkit.kernel import Kernel

#: Bytes around a message. XRCE header (session 128 and above, so without client key), submessage header, request and object id.
XRCE = 4 + 4 + 4
UDP_IP = 8 + 20
ETHERNET = 14 + 4  # header and checksum
PREAMBLE_GAP = 8 + 12
HEARTBEAT = 4 + 4 + 5  # XRCE header, submessage header, payload; an acknowledgement has the same size
LINK = 100_000_000  # bit/s

Body = Callable[[Any], Any]


@dataclass(frozen=True)
class Message:
    """A kind of message: its topic and its size in CDR, in bytes."""

    topic: str
    cdr: int

    @property
    def payload(self) -> int:
        """Bytes in UDP."""
        return self.cdr + XRCE

    @property
    def frame(self) -> int:
        """Bytes on the cable, with the Ethernet checksum."""
        return self.payload + UDP_IP + ETHERNET

    def wire(self, hz: int) -> int:
        """Time on the cable with preamble and gap, in units of 1/hz s."""
        return -(-(self.frame + PREAMBLE_GAP) * 8 * hz // LINK)


DOUBLE = 8
TWIST, POSE2D = 6 * DOUBLE, 3 * DOUBLE


def wheel_state(frame_id: int) -> int:
    """Bytes in CDR of the wheel state: a header whose frame id has so many characters, four doubles, a Twist.

    Of the header: stamp (seconds, nanoseconds), length of the text, the text with its terminator; a double stands at a multiple
    of 8.
    """
    header = 4 + 4 + 4 + frame_id + 1
    return -(-header // DOUBLE) * DOUBLE + 4 * DOUBLE + TWIST


ENCODER_DATA = Message("encoder_data", wheel_state(29))
ODOMETRY = Message("odometry", POSE2D)
WHEEL_VEL = Message("wheel_vel", TWIST)
CMD_VEL = Message("cmd_vel", TWIST)
MESSAGES = {m.topic: m for m in (ENCODER_DATA, ODOMETRY, WHEEL_VEL, CMD_VEL)}

#: What a reliable stream sends beside the data: the board asks, the agent says that it has got the message, or that it has not.
ASKED, ACKNOWLEDGED, MISSING = (Message(what, HEARTBEAT - XRCE) for what in ("heartbeat", "acknowledged", "missing"))


@dataclass(frozen=True)
class Host:
    """The agent, the host behind it, and the cable.

    Attributes:
        round_trip: us from the end of a publish until the frame is back at the board's Ethernet controller, both ways on the
            cable included; no less than those take.
        jitter: mean in us of an exponential time that is added, each message its own.
        wander: every second the round trip is longer by a random part of this, in us.
        loss: share of the messages that never come back; of a reliable stream each exchange with the agent, by itself.
        acknowledged: us from the end of a reliable publish until the agent's acknowledgement is back at the Ethernet controller,
            without jitter. Which part of the round trip is the agent's is not known; this is half the default.
        operator_hz: velocity commands per second that a host program publishes.
        seed: of all these random numbers.
    """

    round_trip: float = 300.0
    jitter: float = 100.0
    wander: float = 0.0
    loss: float = 0.0
    acknowledged: float = 150.0
    operator_hz: int = 0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("round_trip", "jitter", "wander", "acknowledged", "operator_hz"):
            if not 0 <= getattr(self, name) < 1e7:
                raise ValueError(f"host: {name} = {getattr(self, name)} is not allowed; allowed is 0 to 10 million")
        if not 0 <= self.loss <= 1:
            raise ValueError(f"host: loss = {self.loss} is not allowed; allowed is 0 to 1")


class Agent:
    """Host and cable as SimPy processes, one for each message under way, one for the operator; times in cycles of the board.

    Args:
        deliver: called with a message when its frame is at the board.
        reliable: whether the agent acknowledges what it gets: at once, and when it is asked.

    Attributes:
        shortest: cycles that no message can undercut, from the end of its publish until it is back.
    """

    def __init__(self, host: Host, hz: int, deliver: Callable[[Message], None], reliable: bool = False):
        self.host, self.hz, self.deliver, self.reliable = host, hz, deliver, reliable
        self.env = simpy.Environment()
        self._rng = np.random.default_rng(host.seed)
        self._down = simpy.Resource(self.env)  # the cable towards the board: a frame at a time
        self._us = hz / 1e6
        self._longer = np.random.default_rng([host.seed, 2]).uniform(0, host.wander, 256)  # by the second
        self._wire = {m: m.wire(hz) for m in (*MESSAGES.values(), ASKED, ACKNOWLEDGED, MISSING)}
        self._got = True  # what the board waits for at present
        back = min(host.round_trip, host.acknowledged) if reliable else host.round_trip
        self.shortest = max(2 * min(self._wire.values()), int(back * self._us))
        if host.operator_hz:
            self.env.process(self._operator(hz // host.operator_hz))

    def publish(self, message: Message, at: int) -> None:
        """A message that the board has finished sending at cycle `at`, no earlier than the last event here."""
        self.env.process(self._asked(at) if message is ASKED else self._way(message, at))

    def _way(self, message: Message, at: int) -> Any:
        """There and back again."""
        wire = self._wire[message]
        trip = self.host.round_trip + self._longer[at // self.hz % len(self._longer)]
        late = self._rng.exponential(self.host.jitter) if self.host.jitter else 0.0
        self._got = not self._lost()
        if not self._got:
            return
        if self.reliable:
            self.env.process(self._answer(message, at))
        yield self.env.timeout(at - self.env.now + wire + max(0, round((trip + late) * self._us) - 2 * wire))
        yield from self._arrival(message)

    def _asked(self, at: int) -> Any:
        """A heartbeat comes, or does not."""
        if not self._lost():
            yield from self._answer(ASKED, at)

    def _answer(self, message: Message, at: int) -> Any:
        """The agent says whether it has got what the board waits for."""
        answer = ACKNOWLEDGED if self._got else MISSING
        on_cable = self._wire[message] + self._wire[answer]
        yield self.env.timeout(
            at - self.env.now + self._wire[message] + max(0, round(self.host.acknowledged * self._us) - on_cable)
        )
        yield from self._arrival(answer)

    def _lost(self) -> bool:
        return bool(self._rng.random() < self.host.loss)

    def _arrival(self, message: Message) -> Any:
        with self._down.request() as turn:
            yield turn
            yield self.env.timeout(self._wire[message])
        self.deliver(message)

    def _operator(self, period: int) -> Any:
        while True:
            yield self.env.timeout(period)
            self.env.process(self._arrival(CMD_VEL))


def go_along(kernel: Kernel, agent: Agent, outbox: list[tuple[Message, int]], until: int) -> None:
    """Advance board and host to cycle `until`, each step as far as neither can surprise the other.

    What the board does next, it does at `peek` or later, so an answer to it cannot come before `peek` plus the shortest way;
    up to there, or to the host's own next event, the kernel runs alone. `outbox` takes what the board has sent, and when.
    """
    env = agent.env
    while kernel.now < until:
        kernel.advance(int(min(kernel.peek() + agent.shortest, env.peek(), until)))
        for message, at in outbox:
            agent.publish(message, at)
        outbox.clear()
        while env.peek() <= kernel.now:
            env.step()


def install_network(k: Kernel, eth_if: int, tcpip: int) -> tuple[Any, Body, Body, Callable[[Message], None]]:
    """The receive path of a board: interrupt, `EthIf`, `tcpip_thread`, and the mailbox of the UDP socket.

    `eth_if` and `tcpip` are cycles per frame. Returns the mailbox (6 datagrams as in lwIP), the bodies of both tasks, and what to
    call when a frame is there.
    """
    received, unpacked, mailbox = k.queue("frames", 8), k.queue("tcpip_mbox", 6), k.queue("udp_mbox", 6)

    def forwards(source: Any, cycles: int, target: Any) -> Body:
        def body(os: Any) -> Any:
            frame, send = os.receive(source), os.send
            while True:
                message = yield frame
                yield cycles
                yield send(target, message, 0)

        return body

    def deliver(message: Message) -> None:
        k.interrupt(k.now, lambda isr: isr.send(received, message))

    return mailbox, forwards(received, eth_if, unpacked), forwards(unpacked, tcpip, mailbox), deliver
