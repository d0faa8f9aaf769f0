"""Notebook 13 in the browser: choose levels by a click, make the team wrong, split a ball, lose coherence, lose messages."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def show(bench) -> None:
    bench.evaluate("bench => bench.scrollIntoView({ block: 'start' })")


def press(bench, slider: str, key: str, times: int) -> None:
    handle = bench.locator(f".lab-{slider} .noUi-handle")
    handle.focus()
    for _ in range(times):
        handle.press(key)


def crosses(bench) -> int:
    """Ghosts that are drawn."""
    find = "plot => plot.data.find(trace => trace.name === 'ghost').x.length"
    return bench.locator(".js-plotly-plot").evaluate(find)


def test_distributed_fusion(run_notebook):
    nb = run_notebook("13_distributed_fusion.ipynb")
    benches = nb.page.locator(".lab-bench")
    levels, wrong, fast, apart, chain = (benches.nth(i) for i in range(5))

    show(levels)
    nb.screenshot("13_levels")
    levels.locator(".lab-level select").select_option(index=3)
    expect(levels.locator(".lab-metrics")).to_contain_text("2ghosts")
    nb.page.wait_for_timeout(700)
    assert crosses(levels) == 2
    nb.screenshot("13_ghost")
    press(levels, "stations", "ArrowRight", 2)
    expect(levels.locator(".lab-code")).to_contain_text("stations=4")
    nb.screenshot("13_four")

    show(wrong)
    nb.screenshot("13_pose_error")

    show(fast)
    expect(fast.locator(".js-plotly-plot")).to_contain_text("2 balls")
    nb.screenshot("13_figure_42")
    press(fast, "offset", "Home", 1)
    expect(fast.locator(".lab-code")).to_contain_text("offset=0", timeout=20_000)
    expect(fast.locator(".js-plotly-plot")).not_to_contain_text("2 balls", timeout=20_000)

    show(apart)
    expect(apart.locator(".lab-metrics")).to_contain_text("0 %coherent fusions")
    nb.screenshot("13_apart")

    show(chain)
    expect(chain.locator(".lab-metrics")).to_contain_text("100 %coherent fusions")
    nb.screenshot("13_chain")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
