"""The robot's software: tasks and channels as published, what the odometry sees, rates, overload."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.data import published_table
from labkit.kernel import Costs
from labkit.robot import (
    CHANNELS,
    CPU_HZ,
    PERIODIC,
    RATES,
    OnBlocks,
    Rates,
    build,
    drive,
    execution,
    motors,
    published,
    rates,
    stamp_line,
)
from labkit.trace import jobs, runs

MS = CPU_HZ // 1000


def board_of(name="100|50", milliseconds=50, **changes):
    board = build(published(name, **changes), OnBlocks())
    board.advance(milliseconds * MS)
    return board


def recorded(name, caches):
    """A published FreeRTOS recording by task."""
    table = published_table("xu2025_runtime_stats.csv").query("platform == 'FreeRTOS'")
    same = (table["wheel_hz"] == int(name.split("|")[0])) & (table["caches"] == ("on" if caches else "off"))
    return table[same].set_index("name")


def test_tasks_priorities_numbers_and_stacks_are_the_published_ones():
    told = published_table("xu2025_tasks.csv").query("platform == 'FreeRTOS' and task != 'IDLE'").set_index("task")
    made = {task.name: task for task in board_of().kernel.tasks if task.name != "IDLE"}
    assert set(made) == set(told.index)
    order = sorted(made, key=lambda name: made[name].number)
    assert order == sorted(told.index, key=lambda name: told["number"][name])
    for name, task in made.items():
        assert (task.created, task.stack_free) == (told["priority"][name], told["stack_free_words"][name])


def test_channels_are_the_published_ones():
    told = published_table("xu2025_channels.csv")
    board = build(published("50|30"), OnBlocks())
    board.command((100.0, 0.0, 0.0))
    board.advance(200 * MS)
    trace = board.kernel.trace
    found = {}
    for kind, way in (("send", "send"), ("overwrite", "overwrite")):
        rows = trace.rows(kind)
        for task, queue in {(row[2], row[3]) for row in rows.tolist()}:
            found[trace.names[queue]] = (trace.names[task], way)
    readers = {trace.names[row[3]]: trace.names[row[2]] for row in trace.rows("recv").tolist()}
    short = {"wheel speed control": "wheel_ctrl", "pose control": "pose_ctrl", "odometry": "odometry"}
    for row in told.itertuples():
        sender = row.sender.split("(")[1].rstrip(")") if "(" in row.sender else short[row.sender]
        assert found[row.queue][0] == sender
        assert readers[row.queue] == short[row.receiver]
        if "overwrite" in row.mode:
            assert found[row.queue][1] == "overwrite"
        if "without blocking" in row.mode:
            assert found[row.queue][1] == "send"


@pytest.mark.parametrize(("name", "share"), [("50|30", 20 / 33), ("100|50", 10 / 20)])
def test_the_odometry_of_the_published_channel_sees_61_and_50_percent_of_the_way(name, share):
    found = drive(published(name, tracing=False), "straight", 8)
    assert found.share_seen() == pytest.approx(share, abs=0.006)
    gone = np.hypot(*(found.real[-1] - found.real[0])[:2])
    assert found.odometry_error()[-1] == pytest.approx((1 - share) * gone, rel=0.02)


@pytest.mark.parametrize("channel", [c for c in CHANNELS if c != "overwrite"])
@pytest.mark.parametrize("name", ["50|30", "100|50", "1000"])
def test_each_cure_sees_the_whole_way(name, channel):
    found = drive(published(name, tracing=False, channel=channel), "straight", 4, gains=motors(0.05))
    assert found.odometry_error().max() < 17  # 53 ms at 300 mm/s may be on the way between encoder and odometry
    assert found.odometry_error()[-1] < 4  # it stands


def test_a_faster_odometry_counts_every_delta_more_than_once():
    firmware = replace(published("100|50", tracing=False), rates=Rates(1000, 20, 10))
    assert drive(firmware, "straight", 4).share_seen() == pytest.approx(2, abs=0.03)
    assert drive(replace(firmware, channel="queue"), "straight", 4).share_seen() == pytest.approx(1, abs=0.01)


def test_no_gain_makes_a_loop_over_the_published_channel_follow_the_path():
    def end(channel, gain):
        firmware = published("100|50", tracing=False, channel=channel, pose_control=True, pose_gain=gain)
        return drive(firmware, "straight", 5, gains=motors(0.04)).path_error()[-1]

    assert min(end("overwrite", gain) for gain in (5, 10, 20, 40)) > 5 * end("positions", 20)


def test_the_wheel_controller_lessens_the_error_of_unequal_motors():
    def end(on):
        firmware = published("100|50", tracing=False, wheel_control=on, wheel_gain=10)
        return drive(firmware, "straight", 5, gains=motors(0.1)).path_error()[-1]

    assert end(True) < 0.8 * end(False)


def test_set_points_are_smoothed_per_period_so_a_slow_task_speeds_up_slowly():
    def way(name):
        return drive(published(name, tracing=False), "straight", 1).way

    assert way("50|30") < way("100|50") < way("1000")


def test_overload_runs_and_reports_late_jobs_and_misses():
    firmware = published("1000", tracing=False)
    busy = replace(firmware, work={task: 60 * cycles for task, cycles in firmware.work.items()})
    board = build(busy, OnBlocks())
    board.advance(200 * MS)
    assert sum(board.late.values()) > 50
    assert jobs(board.kernel.trace).missed.sum() > 50
    calm = board_of("1000", 200, tracing=False)
    assert sum(calm.late.values()) == 0 and not jobs(calm.kernel.trace).missed.any()


def test_overload_shows_in_the_path():
    def error(times):
        firmware = published("1000", tracing=False, channel="positions", pose_control=True, pose_gain=20.0)
        busy = replace(firmware, work={task: times * cycles for task, cycles in firmware.work.items()})
        return drive(busy, "circle", 3).path_error().max()

    assert error(1) == pytest.approx(error(20), rel=0.02)
    assert error(50) > 1.5 * error(1)


@pytest.mark.parametrize("fast", [3000, 7, 0, -5])
def test_rates_that_do_not_divide_the_tick_are_refused(fast):
    with pytest.raises(ValueError, match=f"a task at {fast} Hz under a tick of 10000 Hz; allowed are rates that divide the tick"):
        rates(fast, 1000, 10_000)


def test_rates_in_hertz_and_by_name_agree():
    assert rates(5000, 2000, 10_000) == RATES["5000|2000"]
    assert RATES["50|30"].hertz("pose_ctrl") == pytest.approx(30.3, abs=0.01)


@pytest.mark.parametrize("name", ["50|30", "100|50"])
@pytest.mark.parametrize("caches", [True, False])
def test_jobs_take_the_published_means(name, caches):
    rows = recorded(name, caches)["mean_us"]
    board = board_of(name, 200, caches=caches, tracing=False)
    found = jobs(board.kernel.trace)
    for task in PERIODIC:
        told = rows["pose_control" if task == "pose_ctrl" else task]
        mine = found.main[(found.task == board.kernel.trace.code(task)) & (found.completion >= 0)]
        assert mine.min() / 216 == pytest.approx(told, abs=0.003)


def test_the_cost_of_a_line_is_the_same_in_both_recordings():
    """Two numbers nobody printed, from two tables each: that they agree speaks for the two stamps per stretch."""
    for caches, us in ((True, 11.8), (False, 40.1)):
        found = [stamp_line(caches, recording) / 216 for recording in ("50|30", "100|50")]
        assert found[0] == pytest.approx(found[1], rel=0.01) and found[0] == pytest.approx(us, abs=0.15)


@pytest.mark.parametrize("name", ["50|30", "100|50"])
@pytest.mark.parametrize("caches", [True, False])
def test_the_idle_share_of_tables_6_to_9_follows_at_two_megabaud(name, caches):
    told = recorded(name, caches)["share_pct"]["IDLE"]
    board = build(published(name, caches, costs=Costs(tick=200, switch=150)), OnBlocks())
    board.advance(1000 * MS)
    table = runs(board.kernel.trace)
    idle = table[table[:, 0] == board.kernel.trace.code("IDLE")]
    assert 100 * (idle[:, 2] - idle[:, 1]).sum() / board.kernel.trace.end == pytest.approx(told, abs=1.0)


@settings(max_examples=30)
@given(st.sampled_from(list(RATES)), st.booleans(), st.sampled_from(list(CHANNELS)), st.integers(1, 100))
def test_nothing_hangs_and_two_runs_are_the_same(name, caches, channel, times):
    firmware = published(name, caches, channel=channel)
    firmware = replace(firmware, work={task: times * cycles for task, cycles in firmware.work.items()})

    def ends():
        board = build(firmware)
        board.command((300.0, 100.0, 0.5))
        board.advance(20 * MS)
        return board.kernel.trace.rows(), board.plant.pose

    (rows, pose), (again, same) = ends(), ends()
    assert np.array_equal(rows, again) and pose == same


def test_the_body_is_the_same_whoever_looks_at_it_how_often():
    def end(samples):
        board = build(published("100|50", tracing=False))
        board.command((300.0, 0.0, 0.5))
        for sample in range(1, samples + 1):
            board.advance(100 * MS * sample // samples)
        return board.plant.pose

    assert end(1) == pytest.approx(end(100), abs=1e-4)  # the heading turns within a step, so not to the last digit


def test_lost_frames_change_a_drive_and_a_seed_repeats_it():
    firmware = published("100|50", tracing=False)
    whole, thin, again = (drive(firmware, "sideways", 2, loss=loss, seed=3).real for loss in (0.0, 0.7, 0.7))
    assert np.array_equal(thin, again) and not np.array_equal(whole, thin)
    assert not drive(firmware, "sideways", 2, loss=1.0).way


def test_bad_input_is_one_sentence():
    with pytest.raises(ValueError, match=r"no rates '30' in source 1; there are 50\|30"):
        published("30")
    with pytest.raises(ValueError, match="channel 'post'; there are overwrite"):
        published("50|30", channel="post")
    with pytest.raises(ValueError, match="work has nothing for hal_fetch"):
        published("50|30", work={"odometry": 1, "pose_ctrl": 1, "wheel_ctrl": 1, "recv_vel": 1})
    with pytest.raises(ValueError, match="course 'moon'; there are straight"):
        drive(published("50|30"), "moon")
    with pytest.raises(ValueError, match="a drive of 0 s"):
        drive(published("50|30"), "straight", 0)
    assert execution(True)["wheel_ctrl"] == round(10.69 * 216)


def test_the_defect_at_the_end_of_the_encoder_shows_where_a_wheel_turns_back_past_zero():
    """Sideways two wheels turn back from 0, the end of the counter, and a third stands on it."""

    def believed(defect):
        firmware = published("100|50", tracing=False, channel="positions", wrap_defect=defect)
        return drive(firmware, "sideways", 1).believed[-1]

    off = np.abs(believed(True) - believed(False))
    one = 2 * np.pi / 3072 * 50  # mm at the rim
    assert one / 2 < off[:2].max() < 5 * one and off[2] < one / 312.5
