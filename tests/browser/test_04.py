"""Notebook 04 in the browser: step through a failure, try a cure, damage a frame."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_trace_sink(open_notebook):
    nb = open_notebook("04_trace_sink.ipynb")
    nb.run_all(180_000)
    story = nb.page.locator(".lab-bench").filter(has=nb.page.locator(".lab-code", has_text="SinkStory(")).first
    expect(story.locator(".lab-metric").first).to_be_visible(timeout=60_000)
    expect(story.locator(".lab-metrics")).to_contain_text("stale")
    story.locator(".lab-step .noUi-handle").press("ArrowRight")
    expect(story.locator(".lab-code")).to_contain_text("step=")
    story.locator(".lab-variant select").select_option(index=6)
    expect(story.locator(".lab-metrics")).not_to_contain_text("stale", timeout=60_000)
    nb.screenshot("04_story")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
