"""The robot under micro-ROS: against the published counts, and against an independent throw-away simulation of the same rules.

The numbers called `simulated` are that simulation's (round trip + exponential jitter; runs of 5 to 10 s, good to about 10 Hz; no
cost for switches, ticks and interrupts; callbacks of 95 and 70 us, a pass of 65 us). The runs here are shorter.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from labkit.kernel import Costs, Kernel
from labkit.robot import MESSAGES, TICK, Host, MicroRos, Work, robot, simulate
from labkit.robot.microros_network import Agent, Message, go_along, install_network
from labkit.trace import statistics

US = 216
WORK = Work(95 * US, 70 * US, 4 * US, 56 * US, 65 * US, 18 * US, 28 * US, 130 * US, 23 * US // 2, 741)


@cache
def rate(round_trip, jitter=100, loss=0.0, pose=20, seconds=2, **more):
    host = Host(round_trip, jitter, loss=loss)
    return simulate(MicroRos(1, pose, WORK, costs=Costs(), host=host, **more), seconds).rate


# Against the other simulation


@pytest.mark.parametrize(("round_trip", "simulated"), [(150, 997), (300, 989), (500, 920), (800, 920), (1200, 869)])
def test_rate_over_the_round_trip(round_trip, simulated):
    assert rate(round_trip) == pytest.approx(simulated, abs=22)


@pytest.mark.parametrize(("jitter", "simulated"), [(20, 1000), (100, 987), (300, 917)])
def test_rate_over_the_jitter(jitter, simulated):
    assert rate(300, jitter) == pytest.approx(simulated, abs=12)


@pytest.mark.parametrize(("loss", "simulated"), [(0.01, 986), (0.05, 948), (1.0, 525)])
def test_rate_over_the_loss(loss, simulated):
    assert rate(200, loss=loss) == pytest.approx(simulated, abs=15)


def test_timer_rule_of_humble_loses_less():
    assert rate(400) == pytest.approx(959, abs=15)
    assert rate(400, timer_rule="humble") == pytest.approx(993, abs=10)


@pytest.mark.parametrize("round_trip", [150, 300, 500, 800, 1200])
def test_one_executor_reaches_1000_hz(round_trip):
    assert rate(round_trip, seconds=1, executors="one") == 1000


@pytest.mark.parametrize("round_trip", [150, 300, 500, 800, 1200])
def test_all_timers_at_1000_hz_reach_it_too(round_trip):
    assert rate(round_trip, seconds=1, pose=1) >= 998


@pytest.mark.parametrize(
    ("wheel", "loss", "round_trip"), [(10, 0.0, 300), (10, 0.0, 3000), (10, 1.0, 300), (5, 0.0, 400), (2, 0.0, 400)]
)
def test_lower_rates_lose_nothing(wheel, loss, round_trip):
    run = simulate(MicroRos(wheel, 20, WORK, costs=Costs(), host=Host(round_trip, 100, loss=loss)), 2)
    assert len(run.calls) == 2000 / wheel
    assert run.dropped["w_ctrl"] == 0


def test_single_intervals_at_100_hz_vary_all_the_same():
    """Simulated: 8.9 to 11.1 ms."""
    run = simulate(MicroRos(10, 20, WORK, costs=Costs(), host=Host(300, 100)), 5)
    assert 8.5 < run.intervals.min() < 9.3
    assert 10.7 < run.intervals.max() < 11.5


# The default of the bench: 910 to 980 Hz as a consequence


def test_published_rates_follow_from_a_round_trip_that_wanders():
    run = simulate(robot(1, 20, host=Host(250, 100, 200, seed=7)), 3)
    assert 905 <= run.windows().min() < run.windows().max() <= 985
    assert run.windows().max() - run.windows().min() > 40


def test_the_guide_holds_with_the_ticks_counted():
    """2 R = a R + K: of the three waits of a round one does not block; the others end by data or by a tick."""
    for host in (Host(250, 100), Host(500, 100), Host(250, 100, loss=0.2), Host(loss=1.0)):
        run = simulate(robot(1, 20, host=host), 1)
        assert run.guide(run.ended(TICK)) == pytest.approx(run.rate, rel=0.05)


def test_without_data_the_guide_is_half_of_1000_hz():
    run = simulate(robot(1, 20, host=Host(loss=1.0)), 1)
    assert run.paid == 0
    assert run.guide() == 500


# Against the published recordings


@pytest.mark.parametrize(
    ("wheel", "pose", "caches", "stretches"),
    [(20, 30, True, 1007), (10, 20, True, 1030), (20, 30, False, 898), (10, 20, False, 876)],
)
def test_stretches_of_uros_are_one_per_tick_and_one_per_frame(wheel, pose, caches, stretches):
    """The tables' own number: stretches per second minus received frames. Nothing of it is fitted."""
    run = simulate(robot(wheel, pose, caches, tracing=True), 2)
    found = statistics(run.trace)
    length = run.trace.end / run.trace.hz
    frames = found.at["EthIf", "count"] / length
    assert frames == pytest.approx(1000 / wheel + 2000 / pose, rel=0.03)
    assert found.at["uros", "count"] / length - frames == pytest.approx(stretches, rel=0.09)


@pytest.mark.parametrize(("wheel", "pose"), [(20, 30), (10, 20)])
@pytest.mark.parametrize("caches", [True, False])
def test_callbacks_last_as_published(wheel, pose, caches):
    from labkit.robot import recorded

    found = statistics(simulate(robot(wheel, pose, caches, tracing=True), 2).trace)
    for name, (mean, _) in recorded(1000 // wheel, caches).items():
        if name in ("w_ctrl", "p_ctrl"):
            assert found.at[name, "mean"] == pytest.approx(mean, rel=0.05)


def test_callbacks_run_inside_uros():
    trace = simulate(robot(10, 20), 0.5).trace
    found = statistics(trace)
    runs = found.loc[
        [n for n in ("uros", "IDLE", "EthIf", "EthLink", "tcpip_thread", "Tmr Svc") if n in found.index], "sum"
    ].sum()
    assert runs == pytest.approx(trace.end / trace.hz * 1e6, rel=0.01)  # the whole, without them


# Sizes and ways


@pytest.mark.parametrize(
    ("topic", "cdr", "payload", "frame", "us"),
    [("encoder_data", 128, 140, 186, 16.5), ("odometry", 24, 36, 82, 8.2), ("wheel_vel", 48, 60, 106, 10.1)],
)
def test_sizes_of_messages(topic, cdr, payload, frame, us):
    m = MESSAGES[topic]
    assert (m.cdr, m.payload, m.frame) == (cdr, payload, frame)
    assert m.wire(10**9) / 1000 == pytest.approx(us, abs=0.06)


def test_a_frame_comes_back_after_round_trip_interface_and_stack():
    k = Kernel(216_000_000)
    mailbox, interface, stack, deliver = install_network(k, 1000, 500)
    agent = Agent(Host(300, 0), 216_000_000, deliver)
    got = []

    def uros(os):
        while True:
            yield 10
            outbox.append((MESSAGES["odometry"], os.now))
            got.append((os.now, (yield os.receive(mailbox)), os.now))

    outbox = []
    for name, body, priority in (("EthIf", interface, 4), ("tcpip", stack, 3), ("uros", uros, 3)):
        k.task(name, body, priority)
    go_along(k, agent, outbox, 200_000)
    sent, message, back = got[0]
    assert message.topic == "odometry"
    assert back - sent == 300 * US + 1000 + 500


def test_a_full_mailbox_drops():
    k = Kernel(216_000_000)
    mailbox, interface, stack, deliver = install_network(k, 10, 10)
    k.task("EthIf", interface, 2)
    k.task("tcpip", stack, 1)
    k.advance(100)
    for _ in range(8):
        deliver(MESSAGES["odometry"])
        k.advance(k.now + 1000)
    assert len(mailbox.items) == 6


def test_host_is_asked_as_often_as_anything_can_happen():
    """The steps of board and host together do not show: steps of 10 us make the same trace as those as long as may be."""

    def trace(most):
        setup = robot(1, 2, host=Host(200, 100, 100, 0.05, operator_hz=50))
        import labkit.robot.microros as module

        original = module.Agent

        class Cautious(original):
            def __init__(self, *args):
                super().__init__(*args)
                self.shortest = min(self.shortest, most)

        module.Agent = Cautious
        try:
            return simulate(setup, 0.2).trace
        finally:
            module.Agent = original

    one, other = trace(10 * US), trace(10**9)
    for column in ("time", "kind", "task", "other", "value", "extra"):
        assert np.array_equal(getattr(one, column), getattr(other, column)), column


def test_progress_does_not_show_either():
    setup = robot(1, 20)
    seen = []

    def steps(parts):
        for part in parts:
            seen.append(part)
            yield part

    assert simulate(setup, 0.3, steps).calls.tolist() == simulate(setup, 0.3).calls.tolist()
    assert len(seen) == 6


def test_commands_of_an_operator_arrive():
    quiet, busy = (simulate(robot(10, 20, host=Host(operator_hz=hz)), 1).trace for hz in (0, 50))
    frames = [statistics(t).at["EthIf", "count"] for t in (quiet, busy)]
    assert frames[1] - frames[0] == pytest.approx(50, abs=2)


@pytest.mark.parametrize("change", [{"executors": "two"}, {"limit": -1}, {"phase": -1}, {"timer_rule": "iron"}, {"wheel": 0}])
def test_mistakes_of_a_setup(change):
    with pytest.raises(ValueError, match=r"two|limit|tick|iron"):
        simulate(replace(robot(), **change), 0.01)


@pytest.mark.parametrize("change", [{"loss": 1.5}, {"jitter": -1}, {"operator_hz": -5}, {"round_trip": float("nan")}])
def test_mistakes_of_a_host(change):
    with pytest.raises(ValueError, match="is not allowed; allowed is"):
        Host(**change)


def test_no_recording_at_another_rate():
    from labkit.robot import recorded

    with pytest.raises(ValueError, match="50 and 100"):
        recorded(1000, True)


def test_a_message_knows_its_frame():
    assert Message("x", 10).frame == 10 + 12 + 28 + 18


# Reliable publishing


def inside(run, callback="w_ctrl"):
    """Length of each call of a callback in us."""
    begin, end = run.passes(callback)[:-1].T  # the last may be cut by the end of the run
    return (end - begin) / US


@cache
def reliable(wheel, loss=0.0, seconds=2, **host):
    return simulate(MicroRos(wheel, 20, WORK, costs=Costs(), reliable=True, host=Host(300, 100, loss=loss, **host)), seconds)


@pytest.mark.parametrize("acknowledged", [100.0, 150.0, 400.0])
def test_a_reliable_publish_stays_in_the_callback_for_the_way_to_the_agent_and_back(acknowledged):
    run = reliable(10, acknowledged=acknowledged)
    took = inside(run)
    board = 18 + 28  # EthIf and tcpip_thread with the frame of the answer
    assert took.min() == pytest.approx(95 + acknowledged + board, abs=1)
    assert took.max() < 95 + acknowledged + 4 * board + 30  # other frames, in front of it
    assert run.unconfirmed == 0 and run.dropped["w_ctrl"] == 0


def test_data_that_come_during_a_reliable_publish_are_kept():
    run = reliable(10, acknowledged=2000.0)
    assert len(run.passes("odom")) >= len(run.calls) - 1


def test_what_is_lost_is_sent_again_after_the_heartbeat():
    took = inside(reliable(10, loss=0.02, seconds=5))
    late = took[took > 1000]
    assert len(late) > 0
    whole = late / 100_000  # heartbeats
    assert (whole % 1 < 0.01).all() and whole.min() < 1.01


def test_one_percent_lost_halves_the_rate_of_1000_hz():
    """Each loss costs 100 ms, and there are eleven exchanges in 10 ms: best effort loses the message alone."""
    assert reliable(1, loss=0.01).rate < 0.65 * rate(300, loss=0.01)


def test_an_agent_that_is_gone_takes_a_second_for_each_publish():
    run = reliable(10, loss=1.0, seconds=4)
    assert run.unconfirmed >= 3 and len(run.calls) <= 3
    assert inside(run) == pytest.approx([1e6 + 95] * (len(run.calls) - 1), abs=1000)


def test_an_answer_takes_no_less_than_the_cable():
    took = inside(simulate(MicroRos(10, 20, WORK, costs=Costs(), reliable=True, host=Host(300, 0, acknowledged=0.0)), 1))
    assert took.min() > 95 + 18 + 28 + 12


def test_an_acknowledgement_has_its_bounds():
    with pytest.raises(ValueError, match="host: acknowledged = -1 is not allowed; allowed is 0 to 10 million"):
        Host(acknowledged=-1)
