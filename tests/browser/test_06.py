"""Notebook 06 in the browser: one executor in place of three, and the published tables."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_micro_ros(run_notebook):
    nb = run_notebook("06_micro_ros_vs_freertos.ipynb")
    rate = nb.page.locator(".lab-bench").nth(0)
    rate.scroll_into_view_if_needed()
    expect(rate.locator(".lab-metric").first).to_be_visible(timeout=60_000)
    three = rate.locator(".lab-metrics").text_content()
    rate.locator(".lab-executors select").select_option(index=1)
    expect(rate.locator(".lab-code")).to_contain_text("executors='one'", timeout=60_000)
    assert rate.locator(".lab-metrics").text_content() != three
    expect(rate.locator(".lab-metrics")).to_contain_text("1\u202f000 Hz")
    nb.screenshot("06_one")

    rate.locator(".lab-executors select").select_option(index=0)
    rate.locator(".lab-reliable input").check()
    expect(rate.locator(".lab-code")).to_contain_text("reliable=True", timeout=60_000)
    rate.locator(".lab-picture").evaluate("picture => picture.scrollIntoView({ block: 'start' })")
    nb.screenshot("06_reliable")

    handle = rate.locator(".lab-round-trip .noUi-handle")
    handle.press("ArrowRight")
    expect(rate.locator(".lab-code")).to_contain_text("round_trip=", timeout=60_000)
    expect(nb.page.locator(".lab-error")).to_have_count(0)
