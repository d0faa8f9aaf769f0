"""Notebook 12 in the browser: the speed leaves the filter alone, the stamp does not; gate, crossing elements, claims."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def show(bench) -> None:
    bench.evaluate("bench => bench.scrollIntoView({ block: 'start' })")


def test_kalman_fusion(run_notebook):
    nb = run_notebook("12_kalman_fusion.ipynb")
    benches = nb.page.locator(".lab-bench")
    two = benches.nth(0)
    show(two)
    nb.screenshot("12_two_stations")
    expect(two.locator(".lab-metrics")).to_contain_text("8.498 cm")
    handle = two.locator(".lab-speed .noUi-handle")
    handle.focus()
    for _ in range(5):
        handle.press("ArrowRight")
    expect(two.locator(".lab-code")).to_contain_text("speed=1.5")
    expect(two.locator(".lab-metrics")).not_to_contain_text("8.498 cm")
    expect(two.locator(".lab-metrics")).to_contain_text("3.263 cm")
    shown = "plot => plot.data.find(trace => trace.name === 'average now').x[0]"
    before = two.locator(".js-plotly-plot").evaluate(shown)
    handle = two.locator(".lab-period .noUi-handle")
    handle.focus()
    for _ in range(4):
        handle.press("ArrowRight")
    expect(two.locator(".lab-code")).to_contain_text("period=12")
    nb.page.wait_for_timeout(500)
    assert two.locator(".js-plotly-plot").evaluate(shown) != before
    two.locator(".lab-stamp select").select_option(index=1)
    expect(two.locator(".lab-metrics")).not_to_contain_text("3.263 cm")
    nb.screenshot("12_read")

    circle, gate, crossing, claims = (benches.nth(i) for i in range(1, 5))
    show(circle)
    nb.screenshot("12_circle")
    show(gate)
    expect(gate.locator(".lab-metrics")).to_contain_text("32.23 %")
    nb.screenshot("12_gate")
    gate.locator(".lab-rejected select").select_option(index=1)
    expect(gate.locator(".lab-metrics")).to_contain_text("93.59 %")
    show(crossing)
    nb.screenshot("12_crossing")
    crossing.locator(".lab-rule select").select_option(index=1)
    expect(crossing.locator(".lab-metrics")).to_contain_text("25track switches")
    nb.screenshot("12_crossing_source")
    show(claims)
    nb.screenshot("12_claims")
    claims.locator(".lab-filter select").select_option(index=2)
    expect(claims.locator(".lab-metrics")).to_contain_text("53.13 cm")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
