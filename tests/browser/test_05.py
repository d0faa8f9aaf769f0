"""Notebook 05 in the browser: change the rate, zoom to single jobs, mend the odometry."""

import pytest
from playwright.sync_api import expect

from labkit import RobotPath

pytestmark = pytest.mark.browser


def test_tick_rates(run_notebook):
    nb = run_notebook("05_tick_rates.ipynb")
    rates = nb.page.locator(".lab-bench").nth(0)
    rates.locator(".lab-rates select").select_option(index=4)
    expect(rates.locator(".lab-code")).to_contain_text("rates='10000|5000'")
    rates.locator(".lab-picture").evaluate("picture => picture.scrollIntoView({ block: 'start' })")
    nb.page.wait_for_timeout(500)
    area = rates.locator(".nsewdrag").first.bounding_box()
    nb.page.mouse.move(area["x"] + 0.2 * area["width"], area["y"] + 0.5 * area["height"])
    nb.page.mouse.down()
    nb.page.mouse.move(area["x"] + 0.4 * area["width"], area["y"] + 0.5 * area["height"], steps=5)
    nb.page.mouse.up()
    nb.page.wait_for_timeout(800)
    low, high = rates.locator(".js-plotly-plot").evaluate("plot => plot.layout.xaxis.range")
    assert 0 < low < high < 60
    nb.screenshot("05_zoomed")

    before = rates.locator(".lab-metrics").text_content()
    rates.locator(".lab-scopes input").check()
    expect(rates.locator(".lab-code")).to_contain_text("scopes=True")
    expect(rates.locator(".lab-metrics")).not_to_have_text(before)
    nb.screenshot("05_scopes")

    seen = f"{RobotPath().measure('way seen by the odometry'):.4g} %"
    path = nb.page.locator(".lab-bench").filter(has=nb.page.locator(".lab-code", has_text="RobotPath("))
    expect(path.locator(".lab-metrics")).to_contain_text(seen)
    path.locator(".lab-channel select").select_option(index=1)
    expect(path.locator(".lab-metrics")).not_to_contain_text(seen)
    expect(nb.page.locator(".lab-error")).to_have_count(0)
