"""What surrounds the board: four motors, the body they move, and the encoders that see it.

Between two changes of the PWM the motors are a closed form, so the plant has no steps and no events of its own: whoever touches
it first brings it up to date. That is why tasks and recorders advance it and no SimPy process does.
"""

from __future__ import annotations

from math import exp, floor, tau

from labkit.robot.mecanum import COUNTS, TOP_SPEED, Pose, Wheels, body_velocity, moved

COUNTER = 1 << 16  # encoder counters have 16 bits
PER_RADIAN = COUNTS / tau
Counters = tuple[int, int, int, int]


class Plant:
    """The robot's body.

    Args:
        cpu_hz: times are in CPU cycles.
        lag: time constant of the motors in s. Not published; 50 ms is what small geared motors have.
        gains: speed of each wheel relative to what its duty asks for; motors are not equal.

    Attributes:
        pose: where it really is. way: how far its middle has come, in mm.
        angle, speed: of each wheel, rad and rad/s. target: speeds the duties lead to.
    """

    def __init__(self, cpu_hz: int, lag: float = 0.05, gains: Wheels = (1.0, 1.0, 1.0, 1.0)):
        if lag <= 0:
            raise ValueError(f"a motor lag of {lag} s; more than 0 is allowed")
        self._per_cycle, self.lag, self.gains = 1 / cpu_hz, lag, gains
        self.pose: Pose = (0.0, 0.0, 0.0)
        self.way = 0.0
        self.angle = self.speed = self.target = (0.0, 0.0, 0.0, 0.0)
        self._at = 0

    def advance(self, now: int) -> None:
        """Bring it up to cycle `now`; nothing happens if it is there already."""
        if now <= self._at:
            return
        time = (now - self._at) * self._per_cycle
        self._at = now
        decay = exp(-time / self.lag)
        catch = self.lag * (1 - decay)
        a0, a1, a2, a3 = self.angle
        s0, s1, s2, s3 = self.speed
        t0, t1, t2, t3 = self.target
        # the speed approaches its target exponentially; these are its integrals over the time
        d0, d1 = t0 * time + (s0 - t0) * catch, t1 * time + (s1 - t1) * catch
        d2, d3 = t2 * time + (s2 - t2) * catch, t3 * time + (s3 - t3) * catch
        self.angle = (a0 + d0, a1 + d1, a2 + d2, a3 + d3)
        self.speed = (t0 + (s0 - t0) * decay, t1 + (s1 - t1) * decay, t2 + (s2 - t2) * decay, t3 + (s3 - t3) * decay)
        dx, dy, turn, _ = body_velocity((d0, d1, d2, d3))
        self.pose = moved(self.pose, dx, dy, turn)
        self.way += (dx * dx + dy * dy) ** 0.5

    def drive(self, now: int, duties: Wheels) -> None:
        """From cycle `now` on the motors get these shares of full PWM, -1 to 1."""
        self.advance(now)
        a, b, c, d = duties
        p, q, r, s = self.gains
        self.target = (TOP_SPEED * a * p, TOP_SPEED * b * q, TOP_SPEED * c * r, TOP_SPEED * d * s)

    def counters(self, now: int) -> Counters:
        """What the encoder counters show at cycle `now`, 0 to 65535."""
        self.advance(now)
        a, b, c, d = self.angle
        return (
            floor(a * PER_RADIAN) % COUNTER,
            floor(b * PER_RADIAN) % COUNTER,
            floor(c * PER_RADIAN) % COUNTER,
            floor(d * PER_RADIAN) % COUNTER,
        )


class OnBlocks:
    """A robot on blocks, its motors off: for schedules in which nobody looks at the way."""

    pose: Pose = (0.0, 0.0, 0.0)
    way = 0.0

    def advance(self, now: int) -> None:
        pass

    def drive(self, now: int, duties: Wheels) -> None:
        pass

    def counters(self, now: int) -> Counters:
        return (0, 0, 0, 0)


Body = Plant | OnBlocks


def angles(new: Counters, old: Counters, defect: bool) -> Wheels:
    """Angles in rad that the wheels have turned between two readings; `defect`: see `increments`."""
    if new == old:
        return (0.0, 0.0, 0.0, 0.0)
    (a, b, c, d), (p, q, r, s) = new, old
    return (
        increments(a, p, defect) / PER_RADIAN,
        increments(b, q, defect) / PER_RADIAN,
        increments(c, r, defect) / PER_RADIAN,
        increments(d, s, defect) / PER_RADIAN,
    )


def added(first: Wheels, second: Wheels, factor: int = 1) -> Wheels:
    """first + factor * second."""
    (a, b, c, d), (p, q, r, s) = first, second
    return a + factor * p, b + factor * q, c + factor * r, d + factor * s


def increments(new: int, old: int, defect: bool) -> int:
    """Increments between two readings of a counter that may have passed its end.

    With `defect` as the firmware does it: right upwards, two too many downwards (65534 for 65536).
    """
    step = new - old
    if step < -COUNTER // 2:
        return step + COUNTER
    if step >= COUNTER // 2:
        return step - (COUNTER - 2 if defect else COUNTER)
    return step
