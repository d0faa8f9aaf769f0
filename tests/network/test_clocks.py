"""Local clocks: what they show, when, and how wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.network import MOST_PPM, Clock

S = 1_000_000_000
CLOCKS = st.builds(
    Clock,
    ppm=st.integers(-MOST_PPM * 1000, MOST_PPM * 1000).map(lambda ppb: ppb / 1000),
    offset_ns=st.integers(-10 * S, 10 * S),
    wander_ppm=st.sampled_from([0, 0.01, 1, 100]),
    seed=st.integers(0, 99),
)


def test_a_clock_that_is_two_ppm_fast_gains_two_microseconds_in_a_second():
    clock = Clock(2.14, offset_ns=5)
    assert clock.local(0) == 5
    assert clock.local(S) == 5 + S + 2140
    assert clock.local(1100 * S) - 1100 * S - 5 == 2_354_000


@given(CLOCKS, st.integers(0, 200 * S), st.integers(0, 3 * S))
def test_a_clock_never_goes_back_and_keeps_its_worst_rate(clock, now, on):
    gained = clock.local(now + on) - clock.local(now)
    assert gained >= 0
    assert abs(gained - on) <= on * clock.worst_ppb / S + 2 + on // S


@given(CLOCKS, st.integers(-11 * S, 200 * S))
def test_a_timer_goes_off_at_the_first_instant_that_shows_its_time(clock, local):
    when = clock.when(local)
    assert clock.local(when) >= local
    assert when == 0 or clock.local(when - 1) < local


def test_wander_moves_the_rate_and_stays_within_its_range():
    clock = Clock(10, wander_ppm=1, seed=3)
    rates = {clock.rate_ppb(second * S) for second in range(1000)}
    assert len(rates) > 100 and 9_000 <= min(rates) < 9_300 and 10_700 < max(rates) <= 11_000
    assert clock.worst_ppb == 11_000


def test_readings_err_to_both_sides_and_the_clock_does_not():
    clock = Clock(reading_ns=100, seed=1)
    errors = [clock.stamp(S) - clock.local(S) for _ in range(2000)]
    assert min(errors) == -100 and max(errors) == 100 and abs(sum(errors)) < 20_000


def test_the_same_seed_is_the_same_clock():
    one, two, other = (Clock(1, wander_ppm=1, reading_ns=9, seed=seed) for seed in (5, 5, 6))
    assert [one.stamp(n * S) for n in range(50)] == [two.stamp(n * S) for n in range(50)]
    assert one.local(50 * S) != other.local(50 * S)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"ppm": 1001}, "rate error is 1001"),
        ({"ppm": float("nan")}, "rate error is nan"),
        ({"wander_ppm": -1}, "wander is -1"),
        ({"reading_ns": -1}, "reading error in ns is -1"),
        ({"offset_ns": 0.5}, "offset in ns is 0.5"),
    ],
)
def test_what_is_no_clock_is_refused_by_name(wrong, word):
    with pytest.raises(ValueError, match=word):
        Clock(**wrong)
    with pytest.raises(ValueError, match="true time is -1"):
        Clock().local(-1)
