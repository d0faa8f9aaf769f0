"""Notebook 02 in a browser: the reveal switch, the step slider, a pattern of one's own and its errors, the timing sliders."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

MAP = "figure => [figure.layout.annotations[0].text, figure.data.find(t => t.name === 'miss').x.length]"
#: Measured points, without the legend's own.
DIAMONDS = """figure => figure.data.filter(t => t.name === 'measured (source 1)').flatMap(t => Array.from(t.x))
    .filter(x => x !== null).length"""


def until(nb, read, wanted):
    """Wait until `read()` is `wanted`."""
    for _ in range(100):
        if (found := read()) == wanted:
            return
        nb.page.wait_for_timeout(50)
    raise AssertionError(f"still {found!r} after 5 s")


def test_cache_speedups(open_notebook):
    nb = open_notebook("02_cache_speedups.ipynb")
    nb.run_all(180_000)
    benches = nb.page.locator(".lab-bench")
    expect(benches).to_have_count(7)

    guess = nb.figure(0)
    assert guess.evaluate(DIAMONDS) == 0
    benches.nth(0).locator(".lab-reveal input").check()
    until(nb, lambda: guess.evaluate(DIAMONDS), 10)
    expect(benches.nth(0).locator(".lab-metrics")).to_contain_text("published")

    bench, figure = benches.nth(2), nb.figure(2)
    nb.slider(".lab-step", "ArrowRight")
    until(nb, lambda: figure.evaluate(MAP)[1], 21)
    assert "miss" in figure.evaluate(MAP)[0]
    expect(bench.locator(".lab-metrics")).to_contain_text("21 of 36")
    bench.locator(".lab-stores input").check()
    until(nb, lambda: "writes it back" in figure.evaluate(MAP)[0], True)
    expect(bench.locator(".lab-code")).to_have_text("CacheMap(step=21, stores=True)")
    nb.screenshot("02_map")

    bench.locator(".lab-pattern select").select_option("my own, as text below")
    until(nb, lambda: figure.evaluate(MAP)[1], 13)  # three lines in two ways, four times, and one more
    own = bench.locator(".lab-own input")
    own.fill("reed 0x20020000")
    own.press("Enter")
    expect(bench.locator(".lab-error")).to_contain_text("line 1: 'reed' is no command")
    own.fill("read 0x20020000 times 9 step 32")
    own.press("Enter")
    until(nb, lambda: figure.evaluate(MAP)[1], 9)
    expect(bench.locator(".lab-error")).to_have_count(0)

    wait_states = benches.nth(5).locator(".lab-metric").first
    expect(wait_states).to_contain_text("7 cycles")
    nb.slider(".lab-clock", "ArrowLeft")
    expect(wait_states).to_contain_text("6 cycles")
