"""The robot's controllers, with the firmware's gains and limits (facts of the public firmware behind source 1, S7)."""

from __future__ import annotations

from math import cos, pi, sin

from labkit.robot.mecanum import LEVER, TOP_RIM, TOP_SPEED, Pose, Wheels, moved, wrapped

WHEEL_P, WHEEL_I, WHEEL_LIMIT = 0.025, 0.015, 10.0
POSE_P, POSE_I, POSE_D = 0.07, 0.001, 0.00001
POSE_LIMIT = (200.0, 200.0, pi)  # of the integrals, mm and rad
SMOOTHING = 0.03  # of the top rim speed, per period of pose control

Velocity = tuple[float, float, float]  # vx, vy in mm/s, omega in rad/s


def limited(value: float, limit: float) -> float:
    return limit if value > limit else -limit if value < -limit else value


def duties(speeds: Wheels) -> Wheels:
    """PWM for wheel speeds in rad/s, clamped to full PWM."""
    a, b, c, d = speeds
    return (limited(a / TOP_SPEED, 1.0), limited(b / TOP_SPEED, 1.0), limited(c / TOP_SPEED, 1.0), limited(d / TOP_SPEED, 1.0))


class WheelController:
    """Set point + P + I for each wheel; switched off, the set point goes through (as in the branch that was measured).

    Args:
        period: in s; the firmware takes the nominal one, however late the task really is.
        gain: factor on both gains; 1 is the firmware's.
    """

    def __init__(self, period: float, on: bool, gain: float = 1.0):
        self.period, self.on, self.gain = period, on, gain
        self.integral = [0.0, 0.0, 0.0, 0.0]

    def command(self, wanted: Wheels, turned: Wheels) -> Wheels:
        """Speeds to command in rad/s, from those wanted and the angles turned since the last fetch."""
        if not self.on:
            return wanted
        made = []
        for i in range(4):
            error = wanted[i] - turned[i] / self.period
            self.integral[i] = limited(self.integral[i] + error * self.period, WHEEL_LIMIT)
            made.append(wanted[i] + self.gain * (WHEEL_P * error + WHEEL_I * self.integral[i]))
        return made[0], made[1], made[2], made[3]


class Smoother:
    """Lets a velocity change by a limited step per call: the slower the task, the slower the robot speeds up."""

    def __init__(self) -> None:
        self.velocity: Velocity = (0.0, 0.0, 0.0)

    def step(self, wanted: Velocity) -> Velocity:
        if wanted == self.velocity:
            return wanted
        most = SMOOTHING * TOP_RIM
        x, y, omega = self.velocity
        self.velocity = (
            x + limited(wanted[0] - x, most),
            y + limited(wanted[1] - y, most),
            omega + limited(wanted[2] - omega, most / LEVER),
        )
        return self.velocity


class PoseController:
    """Velocity + PID on the error of the pose against the integrated set points; switched off, the velocity goes through.

    The gains are taken per second (the facts state no unit).

    Args:
        period: nominal, in s.
        gain: factor on all three gains; 1 is the firmware's.
    """

    def __init__(self, period: float, on: bool, gain: float = 1.0):
        self.period, self.on, self.gain = period, on, gain
        self.wanted: Pose = (0.0, 0.0, 0.0)
        self._integral = [0.0, 0.0, 0.0]
        self._before = (0.0, 0.0, 0.0)

    def command(self, velocity: Velocity, pose: Pose) -> Velocity:
        """Body velocity to command, from the one wanted and the pose that the odometry tells."""
        t = self.period
        if not self.on:
            return velocity
        error = (self.wanted[0] - pose[0], self.wanted[1] - pose[1], wrapped(self.wanted[2] - pose[2]))
        extra = []
        for i, e in enumerate(error):
            self._integral[i] = limited(self._integral[i] + e * t, POSE_LIMIT[i])
            slope = (e - self._before[i]) / t
            extra.append(self.gain * (POSE_P * e + POSE_I * self._integral[i] + POSE_D * slope))
        self._before = error
        self.wanted = moved(self.wanted, velocity[0] * t, velocity[1] * t, velocity[2] * t)
        c, s = cos(pose[2]), sin(pose[2])  # the error is the world's, the command the body's
        return velocity[0] + c * extra[0] + s * extra[1], velocity[1] - s * extra[0] + c * extra[1], velocity[2] + extra[2]
