"""Notebook 11 in the browser: step through the stages, make the ball roll, abort a stage, let two robots look."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def show(bench) -> None:
    bench.evaluate("bench => bench.scrollIntoView({ block: 'start' })")


def shown(bench, name: str) -> int:
    """Points of the first trace of that name."""
    find = "(plot, name) => plot.data.find(trace => trace.name === name)?.x.length ?? -1"
    return bench.locator(".js-plotly-plot").evaluate(find, name)


def press(bench, slider: str, key: str, times: int) -> None:
    handle = bench.locator(f".lab-{slider} .noUi-handle")
    handle.focus()
    for _ in range(times):
        handle.press(key)


def test_laser_pipeline(run_notebook):
    nb = run_notebook("11_laser_pipeline.ipynb")
    benches = nb.page.locator(".lab-bench")
    scan, fits, stages, views = (benches.nth(i) for i in range(4))

    show(scan)
    expect(scan.locator(".lab-metrics")).to_contain_text("3robots found")
    assert shown(scan, "straight") <= 1
    for index, name in enumerate(("contours", "objects", "elements"), start=1):
        scan.locator(".lab-stage select").select_option(index=index)
        expect(scan.locator(".lab-code")).to_contain_text(f"stage='{name}'")
        nb.page.wait_for_timeout(600)
        assert shown(scan, "straight") > 10
        nb.screenshot(f"11_{name}")
    expect(scan.locator(".lab-metrics")).to_contain_text("2.191 mm")
    press(scan, "speed", "ArrowRight", 12)
    expect(scan.locator(".lab-code")).to_contain_text("speed=3.0")
    expect(scan.locator(".lab-metrics")).to_contain_text("0balls found")
    nb.screenshot("11_comb")
    scan.locator(".lab-rotations select").select_option(index=0)
    expect(scan.locator(".lab-metrics")).to_contain_text("1balls found")

    show(fits)
    nb.screenshot("11_fits")

    show(stages)
    expect(stages.locator(".lab-metrics")).to_contain_text("0.9")
    nb.screenshot("11_stages")
    press(stages, "edges-time", "ArrowLeft", 4)
    expect(stages.locator(".lab-code")).to_contain_text("edges_time=0.75")
    nb.screenshot("11_aborted")

    show(views)
    expect(views.locator(".js-plotly-plot")).to_contain_text("2 balls")
    nb.screenshot("11_views")
    press(views, "offset", "ArrowLeft", 8)
    expect(views.locator(".lab-code")).to_contain_text("offset=0")
    expect(views.locator(".js-plotly-plot")).not_to_contain_text("2 balls")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
