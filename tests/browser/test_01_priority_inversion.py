"""Notebooks 00 and 01 as a person meets them: run all, move sliders, guess, make it large, break it."""

import re
import shutil

import nbformat
import pytest
from playwright.sync_api import expect

from labkit.data import example

pytestmark = pytest.mark.browser

#: What the picture shows of a bar chart: where its bars are.
BARS = "figure => figure.data.filter(t => t.type === 'bar' && t.base).map(t => [Array.from(t.base), Array.from(t.x)])"
WIDTHS = "f => [f.getBoundingClientRect().width, f.parentElement.getBoundingClientRect().width]"

BROKEN = '''
from typing import Annotated
from annotated_types import Interval
from typing_extensions import Doc
from labkit import Experiment, Metric, explore

class Fragile(Experiment):
    """Works up to 2."""
    level: Annotated[int, Interval(ge=1, le=5), Doc("load")] = 1

    def run(self):
        if self.level > 2:
            raise RuntimeError("the model broke at level %d" % self.level)
        return self.level

    def figure(self, result):
        return {"data": [{"type": "scatter", "x": [0, 1], "y": [0, result]}], "layout": {}}

    def metrics(self, result):
        return [Metric("level", result)]

explore(Fragile)
'''


def changed(nb, figure, before):
    """Wait until the bars differ from `before`; returns them."""
    for _ in range(600):
        now = figure.evaluate(BARS)
        if now != before:
            return now
        nb.page.wait_for_timeout(50)
    raise AssertionError("the figure did not change within 30 s")


def test_start_here(open_notebook):
    nb = open_notebook("00_start_here.ipynb")
    nb.run_all(lift=False)
    bench = nb.page.locator(".lab-bench").nth(0)
    expect(bench.locator(".lab-veil")).to_be_visible()
    nb.page.locator(".lab-predict input").fill("20 ms")
    nb.page.locator(".lab-predict-reveal").click()
    expect(nb.page.locator(".lab-predict")).to_contain_text("The model says 20 ms")
    expect(bench.locator(".lab-veil")).to_be_hidden()
    expect(nb.page.locator(".lab-guesses")).to_contain_text("right")

    figure = nb.figure()
    before = figure.evaluate(BARS)
    nb.slider(".lab-wheel-work", "ArrowRight")
    changed(nb, figure, before)
    expect(bench.locator(".lab-code")).to_have_text("ThreeTasks(wheel_work=3.5)")
    expect(bench.locator(".lab-metrics")).to_contain_text("29.5 ms")
    nb.slider(".lab-at", "ArrowRight")
    expect(bench).to_contain_text("At 0.5 ms: wheel_ctrl runs; odometry is ready; pose_ctrl is ready.")
    nb.screenshot("00")


def test_a_recording_of_ones_own(open_notebook, lab):
    nb = open_notebook("00_start_here.ipynb")
    nb.run_all()
    shutil.copy(example("board.log"), lab.root / "board.log")
    bench = nb.page.locator(".lab-bench").nth(1)
    field = bench.locator(".lab-file input")
    field.fill("board.log")
    field.press("Enter")
    expect(bench).to_contain_text("board.log, read as log: 161 lines")
    expect(bench.locator(".lab-metrics")).to_contain_text("196.2 ms")
    field.fill("no_such.log")
    field.press("Enter")
    expect(bench.get_by_role("alert")).to_contain_text("no_such.log: cannot be read")
    expect(bench.locator(".lab-metrics")).to_contain_text("196.2 ms")


def test_priority_inversion(open_notebook):
    nb = open_notebook("01_priority_inversion.ipynb")
    nb.run_all(120_000)
    bench = nb.page.locator(".lab-bench").nth(0)
    figure = nb.figure(0)
    expect(bench).to_contain_text("13 ms")
    before = figure.evaluate(BARS)
    nb.slider(".lab-hold", "ArrowRight")
    after = changed(nb, figure, before)
    expect(bench.locator(".lab-metrics")).to_contain_text("14 ms")

    bench.locator(".lab-protocol select").select_option("immediate ceiling")
    changed(nb, figure, after)
    expect(bench.locator(".lab-code")).to_have_text("PriorityInversion(hold=7, protocol='ceiling')")

    bench.locator(".lab-reset").click()
    expect(bench.locator(".lab-code")).to_have_text("PriorityInversion()")
    assert changed(nb, figure, after) is not None

    width, room = figure.evaluate(WIDTHS)
    assert width > 0.95 * room, "the figure does not fill the bench"


@pytest.mark.parametrize("notebook", ["00_start_here", "01_priority_inversion"])
def test_pictures_of_every_bench(open_notebook, notebook):
    """For the eye, in the folder LAB_SHOTS: each bench as it is, and as a hall sees it in the middle of its story."""
    nb = open_notebook(f"{notebook}.ipynb")
    nb.run_all(120_000)
    benches = nb.page.locator(".lab-bench")
    for i in range(benches.count()):
        bench = benches.nth(i)
        bench.evaluate("bench => bench.scrollIntoView({ block: 'start' })")
        for _ in range(16 if bench.locator(".lab-at").count() else 0):
            bench.locator(".lab-at .noUi-handle").press("ArrowRight")
        nb.page.wait_for_timeout(700)
        assert nb.screenshot(f"{notebook[:2]}_{i}").stat().st_size > 20_000
        bench.locator(".lab-lecture-switch").click()
        nb.page.wait_for_timeout(700)
        expect(bench).to_have_class(re.compile("lab-lecture"))
        assert nb.screenshot(f"{notebook[:2]}_{i}_lecture").stat().st_size > 20_000
        nb.page.keyboard.press("Escape")
    expect(nb.page.locator(".lab-error")).to_have_count(0)


def test_an_error_in_a_callback_is_shown_beside_the_controls(open_notebook, tmp_path):
    cell = nbformat.v4.new_code_cell(BROKEN.strip())
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3 (ipykernel)", "language": "python"}}
    nbformat.write(nbformat.v4.new_notebook(cells=[cell], metadata=metadata), tmp_path / "broken.ipynb")
    nb = open_notebook(tmp_path / "broken.ipynb")
    nb.run_all()
    nb.slider(".lab-level", "ArrowRight")
    expect(nb.page.locator(".lab-code")).to_have_text("Fragile(level=2)")
    assert nb.page.locator(".lab-error").count() == 0
    nb.slider(".lab-level", "ArrowRight")
    expect(nb.page.get_by_role("alert")).to_contain_text("RuntimeError: the model broke at level 3")
    nb.slider(".lab-level", "ArrowLeft")
    expect(nb.page.get_by_role("alert")).to_have_count(0)
