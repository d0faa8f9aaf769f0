"""The robot of source 1 at its rates: twenty seconds simulated, and what a picture of them and a slider cost.

Goals of the lab: 20 s at 100|50 Hz in 3 s, at 10000|5000 Hz in 60 s and 1 GB; a step of a zoom in 100 ms; the 100 ms behind a
slider in 30 ms of CPU time. Ratios to raw SimPy timeouts of the same process, since this machine is not the reader's.
"""

import statistics
import time
import tracemalloc

import pytest

from labkit.experiments.tick_rates import MS, LongRun, TickRates, read, traced
from labkit.robot import OnBlocks, build
from tests.bench.conftest import best_rate, timeouts

LINK = 12_500_000


def simulated(rates: str, seconds: int):
    """A recording of so many seconds, as `LongRun` makes it."""
    board = build(traced(rates, True, baud=LINK), OnBlocks())
    for second in range(1, seconds + 1):
        board.advance(second * 1000 * MS)
    return read(board)


@pytest.fixture(scope="module")
def long_run():
    """Twenty seconds at 10000|5000 Hz: made once, drawn often."""
    return simulated("10000|5000", 20)


def milliseconds(work, repeats: int = 5) -> float:
    """Median CPU time of some calls in ms."""
    taken = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        taken.append(1e3 * (time.process_time() - begin))
    return statistics.median(taken)


@pytest.mark.parametrize("rates", ["100|50", "10000|5000"])
def test_twenty_seconds(benchmark, rates):
    """`timeouts per event`: how many raw timeouts of SimPy one event of the trace is worth."""
    begin = time.process_time()
    found = benchmark.pedantic(simulated, (rates, 20), rounds=1)
    taken = time.process_time() - begin
    events = len(found.history.trace)
    simpy = best_rate(timeouts, 50_000)
    benchmark.extra_info |= {
        "CPU seconds": round(taken, 1),
        "million events": round(events / 1e6, 2),
        "timeouts per event": round(taken * simpy / events, 2),
    }
    print(
        f"\n20 s at {rates} Hz: {taken:.1f} CPU s, {events / 1e6:.2f} million events, {taken * simpy / events:.2f} timeouts each"
    )


def test_memory_of_twenty_seconds(benchmark):
    """Two seconds of them, since the tracer of Python's memory is slow; the trace is what grows."""
    tracemalloc.start()
    found = simulated("10000|5000", 2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    benchmark.extra_info["MB for 20 s"] = round(10 * peak / 1e6)
    print(f"\n{10 * peak / 1e6:.0f} MB for 20 s at 10000|5000 Hz, {len(found.history.trace) / 1e5:.1f} million events")
    benchmark.pedantic(timeouts, (1000,))


def test_pictures_of_twenty_seconds(benchmark, long_run):
    """The first overview folds the trace; from then on each picture is as dear as its window is wide."""
    experiment = LongRun(rates="10000|5000", seconds=20)
    began = time.process_time()
    experiment.figure(long_run)
    found = {"first overview": 1e3 * (time.process_time() - began)}
    for name, (low, high) in {"overview": (0, 20_000), "a second": (7000, 8000), "20 ms": (7000, 7020)}.items():
        found[name] = milliseconds(lambda low=low, high=high: experiment.replace(start=low, end=high).figure(long_run))
    for name, taken in found.items():
        benchmark.extra_info[f"CPU ms, {name}"] = round(taken)
        print(f"\n{name}: {taken:.0f} CPU ms", end="")
    print(f"; {len(long_run.history.occupancy.start):,} slices")
    benchmark.pedantic(experiment.figure, (long_run,), rounds=3)


@pytest.mark.parametrize("rates", ["100|50", "1000", "10000|5000"])
def test_the_window_behind_a_slider(benchmark, rates):
    """100 ms recomputed, folded and drawn."""
    experiment = TickRates(rates=rates, baud=LINK)
    result = experiment.run()
    run = milliseconds(experiment.run, 9)
    draw = milliseconds(lambda: (experiment.figure(result), experiment.metrics(result)), 9)
    unit = 1e3 * 10_000 / best_rate(timeouts, 50_000)
    benchmark.extra_info |= {
        "CPU ms, run": round(run, 1),
        "CPU ms, figure": round(draw, 1),
        "run, in 10,000 timeouts": round(run / unit, 2),
    }
    print(f"\n{rates} Hz: run {run:.1f}, figure and metrics {draw:.1f} CPU ms; the run is worth {1e4 * run / unit:,.0f} timeouts")
    benchmark.pedantic(experiment.run, rounds=3)
