"""Notebook 10 in the browser: raise the loss, lose one acknowledgement, step through a disagreement."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_group_communication(run_notebook):
    nb = run_notebook("10_group_communication.ipynb")

    def bench(code: str):
        found = nb.page.locator(".lab-bench").filter(has=nb.page.locator(".lab-code", has_text=code)).first
        found.evaluate("bench => bench.scrollIntoView({ block: 'start' })")
        expect(found.locator(".lab-lift:visible, .lab-metric:visible").first).to_be_visible(timeout=60_000)
        if found.locator(".lab-lift").is_visible():  # it comes into view only now
            found.locator(".lab-lift").click()
        expect(found.locator(".lab-metric").first).to_be_visible()
        return found

    four = bench("GroupCommunication(")
    expect(four.locator(".lab-metrics")).to_contain_text("100 %")
    nb.screenshot("10_four_ways")
    for _ in range(4):
        four.locator(".lab-loss .noUi-handle").press("PageUp")
    expect(four.locator(".lab-code")).to_contain_text("loss=30", timeout=60_000)
    expect(four.locator(".lab-metrics")).not_to_contain_text("100 %")
    disagreements = four.locator(".lab-metric").filter(has_text="disagreements").first
    expect(disagreements).to_contain_text("0")
    nb.screenshot("10_lossy")

    one = bench("OneLoss(")
    expect(one.locator(".lab-says")).to_contain_text("Nothing has happened yet")
    one.locator(".lab-step .noUi-handle").press("ArrowRight")
    expect(one.locator(".lab-says")).to_contain_text("asks S0", timeout=60_000)
    one.locator(".lab-step .noUi-handle").press("End")
    expect(one.locator(".lab-says")).to_contain_text("All have delivered it", timeout=60_000)
    nb.screenshot("10_one_loss")

    patterns = bench("silence is no")
    expect(patterns.locator(".lab-metrics")).to_contain_text("10⁹")
    patterns.locator(".lab-step .noUi-handle").press("End")
    expect(patterns.locator(".lab-says")).to_contain_text("disagree", timeout=60_000)
    nb.screenshot("10_disagreement")
    patterns.locator(".lab-delivery select").select_option(index=0)
    patterns = nb.page.locator(".lab-bench").nth(3)
    expect(patterns.locator(".lab-says")).to_contain_text("who has left knows it", timeout=60_000)
    nb.screenshot("10_agreed")

    degrees = bench("OmissionDegrees(")
    expect(degrees.locator(".lab-metrics")).to_contain_text("260 ms")
    nb.screenshot("10_degrees")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
