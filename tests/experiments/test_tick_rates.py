"""Notebook 05: published listings and shares, loss that is never silent, pictures of long recordings, bounds, exercises."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.bench.plot import pack
from labkit.experiments import tick_rates
from labkit.experiments.listings import Listings, begins, check_next_gap, excerpt
from labkit.experiments.robot_path import PathAgainstRate, RobotPath, check_whole_way
from labkit.experiments.tick_bound import TICKS, TickBound, check_tick_bound
from labkit.experiments.tick_rates import LongRun, TickRates, check_no_loss, envelope, window
from labkit.robot import CPU_HZ, PERIODIC, RATES, stamp_line


@pytest.mark.parametrize("rates", ["50|30", "100|50"])
@pytest.mark.parametrize("caches", [True, False])
def test_idle_shares_of_tables_6_to_9(rates, caches):
    experiment = TickRates(rates=rates, caches=caches)
    idle = experiment.metrics(experiment.run())[0]
    assert idle.value == pytest.approx(idle.published, abs=0.3)


def test_nobody_published_an_idle_share_above_100_hertz():
    for rates in ("1000", "5000|2000", "10000|5000"):
        assert TickRates(rates=rates).metrics(TickRates(rates=rates).run())[0].published is None


def test_without_the_tracer_starts_are_as_regular_as_the_order_of_equals_lets_them_be():
    for rates in RATES:
        found = TickRates(rates=rates, tracer=False).run()
        assert found.late == 0 and found.lost() == 0
        assert found.off < 24  # the two slow tasks and their switches


def test_profile_among_the_control_tasks_takes_whole_ticks_from_them():
    among, below = (TickRates(rates="1000", baud=12_500_000, profile_below=below).run() for below in (False, True))
    assert among.late > 0 and among.off > 900
    assert below.late == 0 and below.off < 30


def test_the_temp_buffer_overflows_at_ten_kilohertz_and_not_at_five():
    five, ten = (TickRates(rates=rates, baud=12_500_000).run() for rates in ("5000|2000", "10000|5000"))
    assert five.lost() < 0.02 * five.taken() and ten.lost() > 0.5 * ten.taken()


@settings(max_examples=40)
@given(TickRates.strategy())
def test_loss_is_never_silent(experiment):
    """Whatever has been stamped is taken over, lost and counted, or still fits the temp buffer."""
    found = experiment.run()
    stamped = 2 * int(found.history.trace.of("switch").sum())
    if experiment.tracer:
        sink = found.sink
        _, taken, missed, dropped = sink.table().sum(axis=0).tolist()
        assert taken + missed <= stamped and found.taken() == taken + sink.direct
        waiting = stamped - taken - (found.lost() - dropped - sink.refused)
        assert 0 <= waiting <= experiment.buffer
        assert (sink.direct > 0) == experiment.scopes or sink.refused
    else:
        assert found.lost() == found.taken() == 0
    assert 0 <= found.on_air() <= 1
    assert sum(found.shares.values()) <= 1 + 1e-9


def test_scopes_are_paid_by_the_observed():
    """At 1000 Hz a line each at the begin and the end of a job: 8000 lines of 11.86 us in a second are 9.5 %."""
    without, within = (TickRates(rates="1000", baud=12_500_000, scopes=scopes).run() for scopes in (False, True))
    control = [sum(found.shares[task] for task in PERIODIC) for found in (without, within)]
    assert control[1] - control[0] == pytest.approx(8000 * stamp_line(True) / CPU_HZ, rel=0.01)
    assert within.off > without.off and within.late > without.late


def test_jobs_that_never_began_are_late_too():
    """Over 115 200 baud the tasks sleep for room in the ring: hardly anybody wakes late, since hardly anybody wakes."""
    found = TickRates(rates="1000", baud=115_200, scopes=True).run()
    ended = int((found.history.trace.of("complete")).sum())
    assert ended < 150 and found.late >= 400 - ended - 4
    idle = found.shares["IDLE"]
    assert idle > 0.7  # and nobody works


@settings(max_examples=100)
@given(st.floats(0, 120), st.floats(0, 120))
def test_a_window_is_never_empty_and_never_outside(start, end):
    low, high = window(start, end, 100)
    assert 0 <= low < high <= 100 + 1e-9


def test_an_envelope_keeps_the_extremes():
    time_, value = np.arange(100_000) / 1000, np.random.default_rng(1).integers(0, 1000, 100_000)
    value[[51_234, 77_777]] = (-5, 2000)
    at, found = envelope(time_, value, 0.0, 100.0)
    assert len(at) == len(found) <= 2 * 700 and (found.min(), found.max()) == (-5, 2000)
    at, found = envelope(time_, value, 10.0, 10.01)
    assert at[0] <= 10.0 and np.array_equal(found, value[10_000:10_011])


def test_listing_37_its_intervals_and_the_one_that_does_not_fit():
    told, model = excerpt("xu2025_trace_5000_2000hz.csv"), Listings(listing="37").run().model
    assert np.diff(begins(told, "wheel_ctrl")).tolist() == [217]  # not 200
    assert np.diff(begins(told, "odometry")).tolist() == [499]
    gaps = Listings(listing="37").run().gaps
    assert gaps["wheel_ctrl"][1] == pytest.approx(217, abs=5) and gaps["hal_fetch"][1] == pytest.approx(218, abs=5)
    assert gaps["odometry"][1] == pytest.approx(499, abs=4)
    order = [model.names[task] for task in model.rows("switch")[:, 2].tolist() if task >= 0]
    at = order.index("odometry")
    assert order[at : at + 4] == ["odometry", "pose_ctrl", "hal_fetch", "wheel_ctrl"]


def test_listing_38_its_order_and_intervals():
    found = Listings(listing="38").run()
    order = [found.model.names[task] for task in found.model.rows("switch")[:, 2].tolist()]
    at = order.index("pose_ctrl")
    assert order[at - 1 : at + 4] == ["tsink", "pose_ctrl", "odometry", "hal_fetch", "wheel_ctrl"]
    assert found.gaps["hal_fetch"] == (79, pytest.approx(79, abs=2))
    assert found.gaps["pose_ctrl"] == (196, pytest.approx(196, abs=2))
    told, model = found.gaps["wheel_ctrl"]
    assert told - model == pytest.approx(11, abs=2)  # tsink, which the link called in between


@pytest.mark.parametrize(("rates", "fast", "slow"), [("5000|2000", 200, 500), ("10000|5000", 100, 200)])
def test_intervals_are_200_and_500_then_100_and_200_us_in_the_mean(rates, fast, slow):
    found = TickRates(rates=rates, tracer=False).run()
    assert found.intervals("wheel_ctrl").mean() == pytest.approx(fast, abs=0.5)
    assert found.intervals("odometry").mean() == pytest.approx(slow, abs=0.5)


@pytest.mark.parametrize(
    ("rates", "caches", "counted"), [("50|30", True, 855), ("50|30", False, 915), ("100|50", True, 830), ("100|50", False, 885)]
)
def test_the_looks_of_tsink_in_tables_6_to_9_are_those_of_a_link_of_two_megabaud(rates, caches, counted):
    """Counted: sum / mean / length of the recording. Nothing in the model was fitted to it."""

    def found(baud):
        return LongRun(rates=rates, caches=caches, baud=baud, seconds=2).run().stretches("tsink")

    assert found(2_000_000) == pytest.approx(counted, rel=0.06)
    assert found(1_152_000) < 0.87 * counted and found(12_500_000) > 1.3 * counted


def test_any_window_of_a_long_recording_is_drawn_from_its_parts():
    experiment = LongRun(seconds=2)
    result = experiment.run()
    assert len(result.history.trace) > 100_000
    experiment.figure(result)
    for start, end in ((0, 20_000), (500, 510), (100, 1900), (2000, 2000), (700, 690)):
        begin = time.process_time()
        figure = experiment.replace(start=start, end=end).figure(result)
        assert time.process_time() - begin < 1  # a busy machine; 10 ms on an idle one
        low, high = figure["layout"]["xaxis"]["range"]
        assert 0 <= low < high <= 2000
        assert sum(np.size(trace["x"]) for trace in figure["data"]) < 30_000
    assert figure["layout"]["meta"]["range"] == ("start", "end")


def test_the_bound_of_the_tick_is_what_the_model_reaches():
    experiment = TickBound()
    result = experiment.run()
    for i, hz in enumerate(TICKS):
        assert result.simulated_ticks[i] == pytest.approx(result.ticks[i], abs=0.001)
        spared = 0.003 if hz <= 20_000 else 0.02  # jobs that reach into the next tick save the switch to IDLE and back
        assert -0.003 < min(result.control[i], 1) - result.simulated[i] < spared, hz
    alone, control = experiment.bounds()
    assert alone == CPU_HZ / 200
    assert 20_000 < control < 40_000


@settings(max_examples=25)
@given(TickBound.strategy())
def test_what_is_simulated_never_exceeds_the_analysis(experiment):
    result = experiment.run()
    for simulated, bound in zip(result.simulated, result.control, strict=True):
        assert simulated is None or simulated <= min(bound, 1) + 0.01


def test_faster_is_better_only_as_long_as_the_processor_keeps_up():
    light, heavy = PathAgainstRate(work=1).run(), PathAgainstRate(work=30).run()
    assert light.error[0] > light.error[1] > light.error[2] and light.late == [0] * 5
    assert heavy.error[-1] > 1.3 * min(heavy.error) and heavy.late[-1] > 50 and heavy.late[:2] == [0, 0]


def test_exercises_ask_the_model():
    assert not check_no_loss(TickRates()).solved
    assert not check_no_loss(TickRates(rates="10000|5000")).solved
    assert not check_no_loss(TickRates(rates="10000|5000", baud=115_200, buffer=2048)).solved
    assert not check_no_loss(TickRates(rates="10000|5000", tracer=False)).solved
    assert check_no_loss(TickRates(rates="10000|5000", baud=12_500_000, form="word", buffer=1024)).solved
    assert check_next_gap(183).solved and not check_next_gap(200).solved and not check_next_gap(217).solved
    assert not check_whole_way(RobotPath()).solved
    assert not check_whole_way(RobotPath(rates="1000")).solved
    for channel in ("accumulate", "positions", "queue"):
        assert check_whole_way(RobotPath(channel=channel)).solved
    bound = TickBound(caches=False).bounds()[1]
    assert check_tick_bound(round(bound)).solved
    assert not check_tick_bound(1000).solved and not check_tick_bound(1_080_000).solved


def test_no_window_of_a_long_run_sends_more_than_a_screen_shows(monkeypatch):
    monkeypatch.setattr(tick_rates, "CROSSES", 20)  # a second loses stamps in a hundred places
    run = LongRun(rates="10000|5000", seconds=1)
    found = run.run()
    rounds = found.sink.table()
    lost = rounds[rounds[:, 2] + rounds[:, 3] > 0, 0] * 1e3 / CPU_HZ
    for start, end in ((0, 1000), (250, 750), (400, 500), (400, 403), (400, 400.5)):
        drawn = run.replace(start=float(start), end=float(end)).figure(found)
        buffers: list[memoryview] = []
        pack(drawn, buffers)
        assert sum(each.nbytes for each in buffers) < 320_000  # 1402 corners of eight curves and 300 crosses
        elements = [len(t["x"]) for t in drawn["data"] if t["type"] == "bar" or t["mode"] == "markers"]
        assert sum(elements) <= 2000
        marked = next(t["x"] for t in drawn["data"] if t.get("name") == "stamps lost")
        there = lost[(lost >= start) & (lost <= end)]
        assert len(marked) <= 21
        for each in there:  # somewhere in its twentieth of what is drawn
            assert np.abs(marked - each).min() <= (end - start) * 2 / 20
