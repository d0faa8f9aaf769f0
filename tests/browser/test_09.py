"""Notebook 09 in the browser: drift, rate against jump, a dead master, an error that stays, experiment 2."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_global_time(run_notebook):
    nb = run_notebook("09_global_time.ipynb")
    stretches, clocks, dead, starts, drift = (nb.page.locator(".lab-bench").nth(i) for i in range(5))

    nb.figure(0).scroll_into_view_if_needed()
    expect(stretches.locator(".lab-metrics")).to_contain_text("2.596 h")
    stretches.locator(".lab-threshold .noUi-handle").press("ArrowRight")
    expect(stretches.locator(".lab-metrics")).not_to_contain_text("2.596 h")
    nb.screenshot("09_stretches")

    nb.figure(1).scroll_into_view_if_needed()
    expect(clocks.locator(".lab-metrics")).to_contain_text("146.5 us")
    nb.screenshot("09_rate")
    clocks.locator(".lab-correction select").select_option(label="jump to the master's time")
    expect(clocks.locator(".lab-code")).to_contain_text("correction='jump'")
    expect(clocks.locator(".lab-metrics")).not_to_contain_text("0 times")
    nb.screenshot("09_jump")

    nb.figure(2).scroll_into_view_if_needed()
    expect(dead.locator(".lab-metrics")).to_contain_text("1 679 us")
    nb.screenshot("09_dead_master")
    dead.locator(".lab-correction select").select_option(label="rate, with estimated drift")
    expect(dead.locator(".lab-metrics")).not_to_contain_text("1 679 us")

    nb.figure(3).scroll_into_view_if_needed()
    expect(starts.locator(".lab-metrics")).to_contain_text("702.5 us")
    nb.screenshot("09_starts")
    starts.locator(".lab-correction select").select_option(label="by absolute phase")
    expect(starts.locator(".lab-metrics")).to_contain_text("15corrections cut")
    nb.screenshot("09_starts_absolute")

    nb.figure(4).scroll_into_view_if_needed()
    expect(drift.locator(".lab-metrics")).to_contain_text("144.1 us")
    nb.screenshot("09_experiment_2")
    drift.locator(".lab-correction select").select_option(label="none")
    expect(drift.locator(".lab-metrics")).to_contain_text("published 2")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
