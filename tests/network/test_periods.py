"""Period synchronisation: starts, what becomes of errors, and whether the shifts fit into Deadline_C."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.network import Clock, Plan, centred, largest_shift, period_starts, start_at
from labkit.phases import Part, windows
from labkit.trace import jobs, slices
from tests.network.many import many

US, MS, S = 1_000, 1_000_000, 1_000_000_000
P = 500 * MS
QUIET = np.zeros((40, 2), np.int64)


def test_a_start_is_the_next_multiple_of_the_period_on_both_clocks():
    assert start_at(1_234 * MS, 10 * S, P) == (1_500 * MS, 10 * S + 266 * MS)


def test_now_on_a_multiple_of_the_period_starts_one_period_ahead():
    """(5.2) as it stands: never `now`."""
    assert start_at(1_500 * MS, 77, P) == (2_000 * MS, 77 + P)
    assert start_at(1_500 * MS - 1, 77, P) == (1_500 * MS, 78)


@given(st.integers(0, 10**15), st.integers(-(10**15), 10**15), st.integers(1, 10**10))
def test_every_start_is_a_multiple_after_now_and_at_most_one_period_away(now, local, period):
    begin, there = start_at(now, local, period)
    assert begin % period == 0 and 0 < begin - now <= period and begin - now == there - local


def test_starts_agree_with_a_clock_that_is_asked():
    """The arithmetic on arrays against `Clock.when`."""
    plan, clock = Plan(P), Clock(-37.123)
    run = period_starts(plan, "none", np.array([-37_123]), QUIET[:, :1])
    assert np.all(np.abs(run.true[:, 0] - [clock.when(int(local)) for local in run.local[:, 0]]) <= 1)


def test_uncoordinated_stations_part_by_the_drift_of_a_period_in_every_period():
    run = period_starts(Plan(P), "none", np.array([0, 2140]), np.zeros((2200, 2), np.int64))
    assert np.abs(run.difference()).max() == pytest.approx(2.35 * MS, rel=0.01)
    assert run.difference()[-1] == pytest.approx(-2201 * 0.5 * 2140, abs=2 + 2140 * 0.01)


@pytest.mark.parametrize("correction", ["differences", "absolute"])
def test_corrected_stations_keep_to_the_drift_of_a_period(correction):
    run = period_starts(Plan(P), correction, np.array([0, 2140]), np.zeros((2200, 2), np.int64))
    assert np.abs(run.difference()).max() <= 3 * 1070


def drawn_errors(size, seed=1, most=50 * US):
    return np.random.default_rng(seed).integers(-most, most, size, endpoint=True)


def test_reading_errors_telescope():
    """By differences the phase after correction i shows the first and the last reading only; by absolute phase the last one."""
    errors = drawn_errors((200, 1))
    first, last = errors[0, 0], errors[1:, 0]
    by_differences, by_phase = (period_starts(Plan(P), way, np.array([0]), errors) for way in ("differences", "absolute"))
    assert np.array_equal(by_differences.phase()[2:, 0], first - last)
    assert np.array_equal(by_phase.phase()[1:, 0], -errors[:, 0])


def test_an_error_at_the_begin_stays_with_differences_and_goes_with_absolute_phase():
    initial = np.array([0, 300 * US])
    kept, gone = (period_starts(Plan(P), way, np.array([0, 0]), QUIET, initial) for way in ("differences", "absolute"))
    assert np.all(kept.difference() == 300 * US)
    assert gone.difference()[0] == 300 * US and np.all(gone.difference()[1:] == 0)


def test_a_shift_that_is_too_far_is_cut_and_made_up_for_by_absolute_phase_only():
    late = np.array([0, 5 * MS])
    plan = Plan(P, wcet_ns=100 * US, shift_ns=1900 * US)
    run = period_starts(plan, "absolute", np.array([0, 0]), QUIET, late)
    assert run.difference()[:5].tolist() == [5 * MS, 3100 * US, 1200 * US, 0, 0]
    narrow = Plan(P, shift_ns=20 * US)  # 100 ppm gain 50 us in a period: every shift of a slow clock is cut
    slow = period_starts(narrow, "differences", np.array([0, -100_000]), QUIET)
    assert slow.difference()[-1] == pytest.approx(30 * US * 39, rel=0.1)


def test_a_shift_lost_stays_with_differences_and_a_reading_that_was_not_made_does_not():
    here = np.zeros(QUIET.shape, bool)
    here[10, 1] = True
    rates = np.array([0, 100_000])
    after = {}
    for way in ("differences", "absolute"):
        for event in ("unread", "lost"):
            after[way, event] = period_starts(Plan(P), way, rates, QUIET, **{event: here}).difference()[20:]
    drift = 50 * US
    usual = period_starts(Plan(P), "differences", rates, QUIET).difference()[20:]
    assert np.all(np.abs(after["differences", "lost"] - usual + drift) < 100)
    assert np.all(np.abs(after["differences", "unread"] - usual) < 100)
    assert np.array_equal(after["absolute", "lost"], after["absolute", "unread"])
    assert np.all(np.abs(after["absolute", "lost"]) < 100 * US)


def test_corrections_begin_with_the_second_reading_of_each_station_by_itself():
    """The first one has no pair before it; a later one goes back to the last pair that was read."""
    silent = np.zeros(QUIET.shape, bool)
    silent[1:3, 0], silent[:2, 1] = True, True
    run = period_starts(Plan(P), "differences", np.array([100_000, 100_000]), QUIET, unread=silent)
    gained = np.rint(run.wanted[:5] / (50 * US)).astype(int)
    assert gained.tolist() == [[0, 0], [0, 0], [0, 0], [3, 1], [1, 1]]


CHAIN = [Part("scan", "scan", 4 * MS, MS), Part("filter", "filter", 30 * MS, MS), Part("fusion", "fusion", 10 * MS, MS)]


def scene(rng):
    """A plan that reserves what `largest_shift` says, and a run under it."""
    period, reading, unread = rng.randint(60, 1000) * MS, rng.choice([0, rng.randint(0, 200 * US), 200 * US]), rng.randint(0, 3)
    ppb = np.array([rng.choice([-200_000, rng.randint(-200_000, 200_000), 200_000]) for _ in range(rng.randint(2, 3))])
    way = rng.choice(["differences", "absolute"])
    plan = Plan(period, rng.choice([0, rng.randint(0, MS), MS]), largest_shift(way, period, 200_000, reading, unread))
    numbers = np.random.default_rng(rng.getrandbits(32))
    errors = numbers.integers(-1, 1, (12, len(ppb)), endpoint=True) * reading  # always as wrong as they can be
    gaps = numbers.random((13, len(ppb))) < 0.5
    if unread:
        gaps[:: unread + 1] = False  # never more in a row
    return plan, period_starts(plan, way, ppb, errors, unread=gaps[:12] if unread else None)


@many(scene)
def test_forward_shifts_fit_into_the_window_of_the_correction(plan, run):
    """On the trace: no window is late, and no two overlap, the first of the next period included (5.6 to 5.8)."""
    assert np.all(-run.wanted <= plan.shift_ns)
    made = [(w.phase, w.release_ns, w.deadline_ns) for w in windows(CHAIN, plan.period_ns, plan.reserve_ns)]
    trace = run.trace(run.true.shape[1] - 1, made)
    assert not jobs(trace).missed.any()
    ran = slices(trace)
    assert np.all(ran.start[1:] >= ran.end[:-1])


def test_the_trace_shows_a_shift_that_does_not_fit():
    """The check above can fail: a start before the thread is through."""
    run = period_starts(Plan(P), "none", np.array([0]), QUIET[:, :1])
    run.local[5:] -= 1950 * US
    late = jobs(run.trace(0, [("all", 0, P - 2 * MS)]))
    assert late.missed.sum() == 1


@pytest.mark.parametrize("way", ["differences", "absolute"])
def test_the_reserve_is_no_larger_than_it_must_be(way):
    reading, worst = 100 * US, 200_000
    needed = largest_shift(way, P, worst, reading)
    errors = np.array([[-reading], [reading]] * 6) if way == "differences" else np.full((12, 1), reading)
    initial = 0 if way == "differences" else reading  # (5.3) was read wrong, too
    run = period_starts(Plan(P, shift_ns=needed), way, np.array([-worst]), errors, initial)
    assert 0.995 * needed < -run.wanted.min() <= needed
    assert largest_shift("none", P, worst, reading) == 0


@given(st.integers(-(10**12), 10**12), st.integers(2, 10**10))
def test_centred_is_the_distance_to_the_nearest_multiple(time, period):
    off = int(centred(np.array([time]), period)[0])
    assert (time - off) % period == 0 and -period / 2 - 1 < off <= period / 2


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Plan(0), "period in ns is 0"),
        (lambda: Plan(P, shift_ns=300 * MS), "at most half the period"),
        (lambda: Plan(P, wcet_ns=-1), "WCET in ns is -1"),
        (lambda: start_at(5, 5, 0), "period in ns is 0"),
        (lambda: period_starts(Plan(P), "guess", np.array([0, 0]), QUIET), "corrected by 'guess'"),
        (lambda: period_starts(Plan(P), "none", np.array([0]), QUIET), "must fit"),
        (lambda: period_starts(Plan(P), "none", np.array([0, 2_000_000]), QUIET), "off by 2000.0 ppm"),
        (lambda: period_starts(Plan(1000 * S), "none", np.array([0, 10**6]), np.zeros((9000, 2))), "fewer are allowed"),
    ],
)
def test_what_is_no_plan_is_refused_by_name(make, word):
    with pytest.raises(ValueError, match=word):
        make()
