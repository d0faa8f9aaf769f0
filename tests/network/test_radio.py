"""The broadcast medium and its losses."""

import numpy as np
import pytest
import simpy

from labkit.network import GilbertElliott, Independent, Radio, Scripted, at


def heard(radio, stations):
    """Attach stations that write down what they hear: (instant, station, message, sender)."""
    log = []
    for station in stations:
        radio.attach(station, lambda message, sender, me=station: log.append((radio.env.now, me, message, sender)))
    return log


def test_a_broadcast_reaches_all_others_at_one_instant():
    env = simpy.Environment()
    radio = Radio(env, delay_ns=300, byte_ns=10, frame_ns=50)
    log = heard(radio, range(3))
    assert radio.send(1, "hello", size=5) == 100
    env.run()
    assert log == [(400, 0, "hello", 1), (400, 2, "hello", 1)]


def test_an_echo_reaches_the_sender_without_loss():
    env = simpy.Environment()
    radio = Radio(env, Independent(1.0))
    log = heard(radio, range(3))
    radio.send(1, "hello", echo=True)
    env.run()
    assert log == [(0, 1, "hello", 1)]
    assert (radio.counts.sent, radio.counts.received, radio.counts.lost) == (1, 0, 2)


def test_who_sends_while_the_medium_is_busy_waits():
    env = simpy.Environment()
    radio = Radio(env, byte_ns=10)
    log = heard(radio, range(3))
    radio.send(0, "first", size=10)
    at(env, 40, lambda: radio.send(1, "second", size=10))
    env.run()
    assert [(time, message) for time, me, message, _ in log if me == 2] == [(100, "first"), (200, "second")]
    assert radio.counts.air_ns == 200 and radio.counts.bytes == 20


def test_jitter_differs_between_receivers_and_stays_within_its_bound():
    env = simpy.Environment()
    radio = Radio(env, jitter_ns=1000, seed=4)
    log = heard(radio, range(4))
    for n in range(500):
        at(env, n * 10_000, lambda: radio.send(0, "tick"))
    env.run()
    late = np.array([time % 10_000 for time, *_ in log])
    assert late.min() < 20 and 980 < late.max() <= 1000
    assert len({time for time, *_ in log[:3]}) > 1


def test_one_station_more_changes_nothing_for_the_others():
    def losses(stations):
        env = simpy.Environment()
        radio = Radio(env, Independent(0.5), jitter_ns=50, seed=9)
        log = heard(radio, range(stations))
        for n in range(100):
            at(env, n * 1000, lambda: radio.send(0, "tick"))
        env.run()
        return [(time, me) for time, me, *_ in log if me < 3]

    assert sorted(losses(3)) == sorted(losses(6))


def test_who_is_switched_off_hears_nothing_even_of_what_is_under_way():
    env = simpy.Environment()
    radio = Radio(env, delay_ns=100)
    log = heard(radio, range(2))
    radio.send(0, "hello")
    at(env, 50, lambda: radio.detach(1))
    env.run()
    assert log == []


def runs(model, receptions=200_000):
    """Share of receptions lost, and mean length of a run of losses."""
    channel = model.channel(0, 1, np.random.default_rng(1))
    lost = np.array([channel() for _ in range(receptions)])
    begins = np.sum(lost[1:] & ~lost[:-1]) + lost[0]
    return lost.mean(), lost.sum() / max(1, begins)


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.6])
def test_independent_loss(loss):
    share, run = runs(Independent(loss))
    assert share == pytest.approx(loss, abs=0.005) and run == pytest.approx(1 / (1 - loss), rel=0.03)


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("longer", [1, 4])
def test_bursts_lose_the_same_share_in_longer_runs(loss, longer):
    model = GilbertElliott.bursts(loss, longer)
    share, run = runs(model)
    assert model.loss == pytest.approx(loss)
    assert share == pytest.approx(loss, rel=0.05) and run == pytest.approx(longer / (1 - loss), rel=0.05)


def test_a_bad_state_that_lets_some_through():
    model = GilbertElliott(0.1, 0.3, in_good=0.02, in_bad=0.5)
    assert model.loss == pytest.approx(0.25 * 0.5 + 0.75 * 0.02)
    assert runs(model)[0] == pytest.approx(model.loss, abs=0.006)


def test_loss_by_plan_counts_each_pair_for_itself():
    env = simpy.Environment()
    radio = Radio(env, Scripted(lambda sender, receiver, n: (receiver, n) in {(1, 0), (2, 1)}))
    log = heard(radio, range(3))
    for n in range(3):
        at(env, n, lambda: radio.send(0, "tick"))
    env.run()
    assert [(time, me) for time, me, *_ in log] == [(0, 2), (1, 1), (2, 1), (2, 2)]


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Independent(1.5), "the loss is 1.5"),
        (lambda: GilbertElliott(0.5, -1), "to_good is -1"),
        (lambda: GilbertElliott.bursts(0.5, 0.5), "bursts are 0.5 times"),
        (lambda: Radio(simpy.Environment(), delay_ns=-1), "delay in ns is -1"),
        (lambda: Radio(simpy.Environment()).attach(-1, print), "station is -1"),
        (lambda: Radio(simpy.Environment()).send(0, "", -5), "size in bytes is -5"),
    ],
)
def test_what_is_no_radio_is_refused_by_name(make, word):
    with pytest.raises(ValueError, match=word):
        make()
