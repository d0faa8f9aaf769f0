"""Notebook 04 in the browser: step through a failure, try a cure, tear a frame and keep it whole."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_trace_sink(run_notebook):
    nb = run_notebook("04_trace_sink.ipynb")

    def bench(name):
        return nb.page.locator(".lab-bench").filter(has=nb.page.locator(".lab-code", has_text=f"{name}(")).first

    story = bench("SinkStory")
    expect(story.locator(".lab-metric").first).to_be_visible(timeout=60_000)
    expect(story.locator(".lab-metrics")).to_contain_text("stale")
    story.scroll_into_view_if_needed()  # a picture is drawn when it comes into sight
    expect(story.locator(".lab-picture")).to_contain_text("index published before the byte is stored", timeout=30_000)
    story.locator(".lab-step .noUi-handle").press("ArrowRight")
    expect(story.locator(".lab-code")).to_contain_text("step=")
    story.locator(".lab-variant select").select_option(index=6)
    expect(story.locator(".lab-metrics")).not_to_contain_text("stale", timeout=60_000)
    expect(story.locator(".lab-picture")).to_contain_text("a sequence number per slot")
    nb.screenshot("04_story")

    torn = bench("TornFrame")
    torn.scroll_into_view_if_needed()
    count = torn.locator(".lab-metric").filter(has_text="torn frames")
    expect(count).to_contain_text("4", timeout=60_000)
    torn.locator(".lab-buffers select").select_option(index=1)
    expect(count).to_contain_text("0", timeout=60_000)
    torn.locator(".lab-buffers select").select_option(index=0)
    torn.locator(".lab-frames .noUi-handle").press("ArrowRight")
    expect(torn.locator(".lab-code")).to_contain_text("frames=120")
    torn.locator(".lab-picture").evaluate("picture => picture.scrollIntoView({ block: 'start' })")
    nb.screenshot("04_torn")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
