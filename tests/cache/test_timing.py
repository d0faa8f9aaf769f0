"""From counts to cycles and microseconds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.cache import Cache, Geometry, Memory, count, patterns, replay, stm32f767
from labkit.cache.timing import Timing, Work, data_cycles, run_cost, speed_up, wait_states

MHZ = 1_000_000


@pytest.mark.parametrize(
    ("mhz", "millivolts", "states"),
    [
        (216, 3300, 7),
        (216, 2700, 7),
        (216, 2699, 8),
        (216, 2400, 8),
        (216, 2399, 9),
        (216, 2100, 9),
        (180, 2099, 8),
        (180, 1800, 8),
        (210, 3300, 6),
        (30, 3300, 0),
        (31, 3300, 1),
        (20, 1800, 0),
        (22, 2100, 0),
        (24, 2400, 0),
        (16, 3300, 0),
    ],
)
def test_wait_states_of_rm0410(mhz, millivolts, states):
    assert wait_states(mhz * MHZ, millivolts) == states


WORK = Work(instructions=1000, fetches=480, data=300, code_fills=10, data_fills=20, insensitive=50)
PRICES = Timing(overhead=2, uncached_data=6, data_fill=12)


def test_the_model_is_its_two_equations():
    off = run_cost(WORK, PRICES, icache=False, dcache=False)
    on = run_cost(WORK, PRICES)
    assert off.total == 1000 + 480 * (1 + 7 + 2) + 300 * 6 + 50
    assert on.total == 1000 + 10 * (1 + 7 + 2 + 3) + 20 * 12 + 50
    assert speed_up(WORK, PRICES) == off.total / on.total
    assert off.microseconds == pytest.approx(off.total / 216)
    assert run_cost(WORK, PRICES, dcache=False).code == on.code
    assert run_cost(WORK, PRICES, icache=False).data == on.data


def test_over_itcm_the_art_accelerator_replaces_the_instruction_cache():
    assert run_cost(WORK, PRICES, path="itcm").code == run_cost(WORK, PRICES, path="itcm", icache=False).code == 480 * 8
    assert run_cost(WORK, Timing(art_hits=1.0), path="itcm").code == 480
    assert run_cost(WORK, Timing(art_hits=0.5), path="itcm").code == 480 * 4.5


@given(st.integers(0, 10_000), st.integers(0, 10_000), st.integers(0, 7))
def test_without_cache_time_is_linear_in_the_wait_states_with_the_fetches_as_slope(instructions, fetches, states):
    work = Work(instructions, fetches, data=7, insensitive=3)
    slow, fast = (run_cost(work, Timing(hz=hz), icache=False, dcache=False).total for hz in ((states + 1) * 27 * MHZ, 27 * MHZ))
    assert slow - fast == fetches * wait_states((states + 1) * 27 * MHZ)


def test_a_log_and_its_counts_cost_the_same():
    trace = patterns.random(3000, 4096, start=0, op="modify", seed=3)
    geometry = Geometry(1024, 4, 32)
    memory = Memory.flat(1 << 16)
    prices = Timing(data_fill=11, write_back=5, store=3)
    work = Work.of_counts(count(trace, geometry), instructions=0, fetches=0)
    assert work.write_backs > 0
    assert data_cycles(replay(trace, Cache(memory, geometry)), memory, prices) == run_cost(work, prices).data


def test_tcm_costs_nothing_and_a_peripheral_its_bus():
    cache = Cache(stm32f767())
    cache.read(0x2000_0000, 4)
    cache.read(0x4000_0000, 4)
    cache.write(0x2002_0000, b"1234")
    cache.clean()
    assert data_cycles(cache.log, cache.memory, Timing(uncached_data=9, data_fill=20, write_back=4)) == 9 + 20 + 4


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: wait_states(217 * MHZ), "clock of 217000000 Hz at 3300 mV; allowed is 1 Hz to 216 MHz"),
        (lambda: wait_states(181 * MHZ, 1800), "clock of 181000000 Hz at 1800 mV; allowed is 1 Hz to 180 MHz"),
        (lambda: wait_states(0), "clock of 0 Hz at 3300 mV; allowed is 1 Hz to 216 MHz"),
        (lambda: wait_states(16 * MHZ, 1700), "supply of 1700 mV; the STM32F767 runs on 1800 to 3600 mV"),
        (lambda: Timing(data_fill=-1), "data_fill is -1 cycles; it cannot be below 0"),
        (lambda: Timing(art_hits=1.5), "art_hits is 1.5; it is a share from 0 to 1"),
        (lambda: Work(-1, 0), "instructions is -1; it cannot be below 0"),
        (lambda: run_cost(WORK, path="ahb"), "no path 'ahb' to the flash; there are axi, itcm"),
        (lambda: speed_up(Work(0, 0)), "work that takes 0 cycles with caches has no speed-up; give it instructions"),
    ],
)
def test_bad_input_gets_one_clear_sentence(call, says):
    with pytest.raises(ValueError) as error:
        call()
    assert str(error.value) == says
