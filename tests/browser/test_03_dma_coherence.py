"""Notebook 03 in the browser: step through the lanes, switch on the cure, debug the session, forbid nothing."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

CELLS = "figure => figure.data[1].text.slice(3 * 64, 3 * 64 + 32).join('')"  # what the DMA lane of the first bench shows


def test_step_slider_and_switches_move_the_lanes(run_notebook):
    nb = run_notebook("03_dma_coherence.ipynb")
    first, session = ":nth-match(.lab-bench, 1)", ":nth-match(.lab-bench, 4)"
    card = nb.page.locator(f"{first} .lab-metric")
    figure = nb.figure(0)
    expect(card.nth(0)).to_contain_text("–")  # the story has not been told
    assert figure.evaluate(CELLS) == ""

    for _ in range(3):
        handle = nb.slider(f"{first} .lab-step", "ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "3.0")
    expect(figure).to_contain_text("the DMA gets 16 stale bytes: transmit without clean")
    assert figure.evaluate(CELLS) == "0" * 16

    nb.page.locator(f"{first} .lab-before select").select_option(label="clean")
    nb.page.locator(f"{first} .lab-play").click()
    expect(card.nth(0)).to_contain_text("everything", timeout=30_000)
    expect(figure).not_to_contain_text("stale bytes")
    assert figure.evaluate(CELLS) == "hello,agent,here_is_a_new_packet"
    nb.screenshot("03_cured")
    for _ in range(2):
        nb.page.locator(f"{first} .lab-back").click()
    expect(nb.page.locator(f"{first} .lab-says")).to_contain_text("Step ")

    expect(nb.page.locator(f"{session} .lab-metric").nth(0)).to_contain_text("invalid client key")
    nb.page.locator(f"{session} .lab-driver select").select_option(label="clean, size + offset")
    expect(nb.page.locator(f"{session} .lab-metric").nth(0)).to_contain_text("session established")
    expect(nb.page.locator(".lab-error")).to_have_count(0)
