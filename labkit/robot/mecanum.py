"""Kinematics of four mecanum wheels: body velocity to wheel speeds and back, and the odometry made of it.

Wheels in the order front right, front left, back left, back right. Lengths in mm, angles in rad, times in s. Plain numbers, not
arrays: a controller of the robot calls these ten thousand times a simulated second.
"""

from __future__ import annotations

from math import cos, pi, sin, tau

RADIUS = 50.0  # mm, of a wheel
LENGTH, WIDTH = 325.0, 300.0  # mm, between wheels
LEVER = (LENGTH + WIDTH) / 2  # mm, from turning the body to what a wheel sees of it
COUNTS = 48 * 64  # encoder increments per wheel turn: per motor turn x gear
TOP_SPEED = 11.0  # rad/s of a wheel at full PWM, measured
TOP_RIM = TOP_SPEED * RADIUS  # mm/s

Wheels = tuple[float, float, float, float]
Pose = tuple[float, float, float]  # x, y in mm, heading in rad within (-pi, pi]


def wheel_speeds(vx: float, vy: float, omega: float, slip: float = 0.0) -> Wheels:
    """Wheel speeds in rad/s of a body velocity (mm/s forward, mm/s to the left, rad/s) and a slip no body velocity explains."""
    turn = LEVER * omega
    return (
        (vx + vy + turn + slip) / RADIUS,
        (vx - vy - turn + slip) / RADIUS,
        (vx + vy - turn - slip) / RADIUS,
        (vx - vy + turn - slip) / RADIUS,
    )


def body_velocity(wheels: Wheels) -> tuple[float, float, float, float]:
    """The inverse of `wheel_speeds`: (vx, vy, omega, slip). Of angles in place of speeds it makes a displacement."""
    a, b, c, d = wheels
    quarter = RADIUS / 4
    return quarter * (a + b + c + d), quarter * (a - b + c - d), quarter / LEVER * (a - b - c + d), quarter * (a + b - c - d)


def moved(pose: Pose, dx: float, dy: float, turn: float) -> Pose:
    """The pose after a displacement of the body, turned by the mean heading of the step."""
    x, y, heading = pose
    mean = heading + turn / 2
    c, s = cos(mean), sin(mean)
    return x + c * dx - s * dy, y + s * dx + c * dy, wrapped(heading + turn)


def wrapped(angle: float) -> float:
    """The same direction within (-pi, pi]."""
    return pi - (pi - angle) % tau if angle > pi or angle <= -pi else angle
