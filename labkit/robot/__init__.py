"""The mecanum robot of source 1: its body, its controllers, and its software under FreeRTOS."""

from labkit.robot.drive import COURSES, Course, Drive, drive, motors
from labkit.robot.firmware import CHANNELS, COSTS, CREATED, PRIORITIES, Board, Channel, Firmware, build, published
from labkit.robot.mecanum import TOP_RIM, body_velocity, moved, wheel_speeds, wrapped
from labkit.robot.plant import Bench, Plant, angles, increments
from labkit.robot.rates import CPU_HZ, PERIODIC, PUBLISHED_NAMES, RATES, Rates, execution, rates, stamp_line
from labkit.robot.trace_path import Sink, TracePath

__all__ = [
    "CHANNELS",
    "COSTS",
    "COURSES",
    "CPU_HZ",
    "CREATED",
    "PERIODIC",
    "PRIORITIES",
    "PUBLISHED_NAMES",
    "RATES",
    "TOP_RIM",
    "Bench",
    "Board",
    "Channel",
    "Course",
    "Drive",
    "Firmware",
    "Plant",
    "Rates",
    "Sink",
    "TracePath",
    "angles",
    "body_velocity",
    "build",
    "drive",
    "execution",
    "increments",
    "motors",
    "moved",
    "published",
    "rates",
    "stamp_line",
    "wheel_speeds",
    "wrapped",
]
