"""Notebook 08 as a person meets it: shorten the period until nothing fits, click a broken promise, move the expected time."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_taft_phases(run_notebook):
    nb = run_notebook("08_taft_phases.ipynb")
    windows, designs, timeliness = (nb.page.locator(".lab-bench").nth(i) for i in range(3))
    expect(windows.locator(".lab-metrics")).to_contain_text("3.9 ms")
    for phase in (
        "Input",
        "ContourFilter",
        "Communication",
        "ContourFusion",
        "ObjectFilter",
        "ElementFilter",
        "ElementFusion",
        "Output",
    ):
        assert nb.figure(0).locator(".bartext", has_text=phase).count() == 2, phase
    windows.scroll_into_view_if_needed()
    nb.screenshot("08-windows")
    for _ in range(4):
        nb.page.locator(".lab-bench").nth(0).locator(".lab-period .noUi-handle").press("ArrowLeft")
    expect(windows.locator(".lab-metrics")).to_contain_text("-0.1 ms")

    expect(designs.locator(".lab-metrics")).to_contain_text("broken in 8")
    figure = nb.figure(1)
    figure.scroll_into_view_if_needed()
    cell = figure.locator(".subplot.xy .scatterlayer .trace").first.locator(".points path").nth(4 * 1 + 2)  # taft thread, G3
    box = cell.bounding_box()
    nb.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(designs.locator(".lab-code")).to_contain_text("design='taft thread'")
    nb.screenshot("08-designs")

    nb.figure(2).scroll_into_view_if_needed()
    expect(timeliness.locator(".lab-metrics")).to_contain_text("84 periods")
    nb.screenshot("08-timeliness-start")
    timeliness.locator(".lab-arcs-ecet .noUi-handle").press("ArrowLeft")
    expect(timeliness.locator(".lab-metrics")).not_to_contain_text("84 periods")
    nb.screenshot("08-timeliness")
