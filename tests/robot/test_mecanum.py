"""The robot's body: kinematics against the published matrix, motors against their equation, encoders at their ends."""

from math import cos, exp, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.robot import CPU_HZ, Plant, body_velocity, increments, moved, wheel_speeds, wrapped

MATRIX = np.array([[1, 1, 312.5, 1], [1, -1, -312.5, 1], [1, 1, -312.5, -1], [1, -1, 312.5, -1]]) / 50
SPEED = st.floats(-1000, 1000)


@given(SPEED, SPEED, st.floats(-5, 5), SPEED)
def test_wheels_are_the_published_matrix_and_the_way_back_is_its_inverse(vx, vy, omega, slip):
    wheels = wheel_speeds(vx, vy, omega, slip)
    assert np.allclose(wheels, MATRIX @ [vx, vy, omega, slip])
    assert np.allclose(body_velocity(wheels), (vx, vy, omega, slip), atol=1e-9)


def test_forward_left_and_turn():
    assert wheel_speeds(50, 0, 0) == (1, 1, 1, 1)
    assert wheel_speeds(0, 50, 0) == (1, -1, 1, -1)
    assert wheel_speeds(0, 0, 0.16) == (1, -1, -1, 1)


@given(st.floats(-50, 50))
def test_a_heading_stays_the_same_direction_within_its_range(angle):
    found = wrapped(angle)
    assert -pi < found <= pi
    assert cos(found) == pytest.approx(cos(angle), abs=1e-9) and sin(found) == pytest.approx(sin(angle), abs=1e-9)


def test_many_small_steps_make_a_circle():
    pose, steps, radius = (0.0, 0.0, 0.0), 1000, 300.0
    for _ in range(steps):
        pose = moved(pose, 2 * pi * radius / steps, 0.0, 2 * pi / steps)
    assert hypot(pose[0], pose[1]) < 0.01
    half = (0.0, 0.0, 0.0)
    for _ in range(steps // 2):
        half = moved(half, 2 * pi * radius / steps, 0.0, 2 * pi / steps)
    assert half[:2] == (pytest.approx(0, abs=0.01), pytest.approx(2 * radius, abs=0.01))


@given(st.lists(st.integers(1, CPU_HZ // 4), max_size=20))
def test_a_motor_follows_its_equation_however_time_is_cut(cuts):
    plant, now = Plant(CPU_HZ, lag=0.05), 0
    plant.drive(0, (0.5, 0.5, 0.5, 0.5))
    for cut in cuts:
        now += cut
        plant.advance(now)
    t = now / CPU_HZ
    assert plant.speed[0] == pytest.approx(5.5 * (1 - exp(-t / 0.05)))
    assert plant.pose[0] == pytest.approx(50 * 5.5 * (t - 0.05 * (1 - exp(-t / 0.05))), abs=1e-6)
    assert plant.pose[1:] == (pytest.approx(0, abs=1e-9), pytest.approx(0, abs=1e-9))


def test_one_turn_of_a_wheel_is_3072_increments():
    plant = Plant(CPU_HZ, lag=1e-9)
    plant.drive(0, (1 / 11, -1 / 11, 0, 0))  # 1 rad/s
    turn = int(2 * pi * CPU_HZ) + CPU_HZ // 10_000
    assert plant.counters(turn)[:3] == (3072, 65536 - 3073, 0)


@given(st.integers(0, 65535), st.integers(-32768, 32767))
def test_increments_survive_the_end_of_the_counter(old, step):
    assert increments((old + step) % 65536, old, defect=False) == step


def test_the_firmware_is_two_increments_off_where_the_counter_wraps_downwards():
    assert increments(65535, 0, defect=True) == 1  # it turned back by one; the firmware counts one forward
    assert increments(0, 65535, defect=True) == 1
    assert increments(65535, 0, defect=False) == -1


def test_a_motor_needs_a_lag():
    with pytest.raises(ValueError, match="a motor lag of 0 s; more than 0 is allowed"):
        Plant(CPU_HZ, lag=0)
