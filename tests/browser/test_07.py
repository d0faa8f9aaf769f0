"""Notebook 07 in the browser: move the task set, starve a pair, start a slow run and overtake it, edit a table."""

import json

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

#: The panels with crosses; the first is that of RM.
MISSES = "figure => figure.data.filter(t => t.marker?.symbol === 'x' && t.x[0] !== null).map(t => t.yaxis ?? 'y')"
#: What Ctrl+V does with a text.
PASTE = """(field, text) => {
    const clipboardData = new DataTransfer();
    clipboardData.setData('text', text);
    field.dispatchEvent(new ClipboardEvent('paste', { clipboardData, bubbles: true, cancelable: true }));
}"""
HEIGHTS = "figure => figure.data[4].y.slice(0, 20).join()"  # the curve of TAFT's safe test


def test_sliders_move_schedules_and_curves(run_notebook):
    nb = run_notebook("07_schedulability.ipynb")

    schedules, figure = nb.page.locator(".lab-bench").nth(0), nb.figure(0)
    expect(figure).to_contain_text("task 2 misses its deadline at 7 ms")
    assert figure.evaluate(MISSES) == ["y"]
    for _ in range(2):
        nb.slider(":nth-match(.lab-bench, 1) .lab-C2", "ArrowLeft")
    expect(schedules.locator(".lab-code")).to_have_text("Schedules(C2=2)")
    expect(figure).not_to_contain_text("misses its deadline")
    schedules.locator(".lab-work select").select_option(label="random, 90 % below 0.36 C")
    expect(schedules.locator(".lab-bar .lab-metric").last).to_contain_text("RM, EDF, TAFT")
    schedules.locator(".lab-forward").click()
    expect(schedules.locator(".lab-says")).to_contain_text("At 1 ms.")
    schedules.scroll_into_view_if_needed()
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

    edit_the_table(nb)


def edit_the_table(nb):
    """Type a wrong number and mend it, paste rows of a spreadsheet, look at another policy, save and load."""
    own, figure = nb.page.locator(".lab-bench").nth(5), nb.figure(5)
    own.scroll_into_view_if_needed()
    table = own.locator(".lab-table")
    row = table.locator("tbody tr").nth(2)  # the brake: late under RM
    expect(row.locator(".lab-result").first).to_have_text("3 / 3")
    expect(table.locator("tfoot .lab-result")).to_have_text(["not accepted", "accepted", "accepted", "accepted"])
    nb.screenshot("07_own_set")
    row.get_by_label("C", exact=True).fill("one")
    expect(row.locator(".lab-wrong")).to_contain_text("C is 'one'; whole numbers only")
    assert row.bounding_box()["height"] < 40  # the sentence has the place of the results
    nb.screenshot("07_own_set_wrong")
    row.get_by_label("D", exact=True).fill("8")
    row.get_by_label("C", exact=True).fill("1")
    expect(table.locator("tfoot .lab-result").first).to_have_text("accepted")
    expect(row.locator(".lab-wrong")).to_have_text("")
    table.get_by_role("button", name="TAFT").click()
    expect(figure).to_contain_text("TAFT")
    expect(own.locator(".lab-code")).to_contain_text("policy='taft'")

    with nb.page.expect_download() as saved:
        table.get_by_role("button", name="Save JSON").click()
    file = saved.value.path()
    assert [task["name"] for task in json.loads(file.read_text())["tasks"]] == ["lidar", "planner", "brake"]
    table.locator("tbody input").first.evaluate(PASTE, "task\tT\tC\nx\t5\t2\ny\t7\t4\n")
    expect(table.locator("tbody tr")).to_have_count(3)  # two and an empty one
    expect(table.locator("tfoot .lab-result")).to_have_text(["not accepted", "not accepted", "accepted", "–"])
    expect(table.locator("tbody tr").nth(1).get_by_label("T", exact=True)).to_have_value("7")
    table.locator("input[type=file]").set_input_files(
        {"name": "t.json", "mimeType": "application/json", "buffer": file.read_bytes()}
    )
    expect(table.locator("tbody tr")).to_have_count(4)
    expect(table).to_contain_text("loaded t.json")
    table.locator(".lab-row-away").first.click()
    expect(table.locator("tbody tr")).to_have_count(3)
    expect(own.locator(".lab-bar .lab-metric").last).to_contain_text("45.83 %")
    own.locator(".lab-lecture-switch").click()
    nb.screenshot("07_own_set_lecture")
    nb.page.keyboard.press("Escape")
