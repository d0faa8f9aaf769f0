"""Notebook 07 in the browser: move the task set, starve a pair, start a slow run and overtake it."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

#: The panels with crosses; the first is that of RM.
MISSES = "figure => figure.data.filter(t => t.marker?.symbol === 'x' && t.x[0] !== null).map(t => t.yaxis ?? 'y')"
HEIGHTS = "figure => figure.data[4].y.slice(0, 20).join()"  # the curve of TAFT's safe test


def test_sliders_move_schedules_and_curves(open_notebook):
    nb = open_notebook("07_schedulability.ipynb")
    nb.run_all(180_000)

    schedules, figure = nb.page.locator(".lab-bench").nth(0), nb.figure(0)
    expect(figure).to_contain_text("task 2 misses its deadline at 7 ms")
    assert figure.evaluate(MISSES) == ["y"]
    for _ in range(2):
        nb.slider(":nth-match(.lab-bench, 1) .lab-C2", "ArrowLeft")
    expect(schedules.locator(".lab-code")).to_have_text("Schedules(C2=2)")
    expect(figure).not_to_contain_text("misses its deadline")
    schedules.locator(".lab-work select").select_option(label="random, 90 % below 0.36 C")
    expect(schedules.locator(".lab-metric").last).to_contain_text("RM, EDF, TAFT")
    nb.screenshot("07_schedules")

    starved = nb.page.locator(".lab-bench").nth(3)
    expect(starved).to_contain_text("6 of 32")
    for _ in range(2):
        nb.slider(":nth-match(.lab-bench, 4) .lab-EP2", "ArrowLeft")
    expect(starved).to_contain_text("0 of 32")
    expect(nb.figure(3)).not_to_contain_text("had 0 of its 1 ms")

    slow, curves = nb.page.locator(".lab-bench").nth(4), nb.figure(4)
    expect(slow.locator(".lab-metric")).to_have_count(7, timeout=30_000)
    before = curves.evaluate(HEIGHTS)
    for _ in range(4):  # each run takes a second: the first three are overtaken
        nb.slider(":nth-match(.lab-bench, 5) .lab-EP", "ArrowRight")
    expect(slow.locator(".lab-code")).to_have_text("AcceptanceCurves(EP=9)", timeout=30_000)
    assert curves.evaluate(HEIGHTS) != before
    nb.screenshot("07_curves")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
