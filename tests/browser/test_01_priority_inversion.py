"""Notebook 01 as a person meets it: move sliders, reset, break it."""

import nbformat
import pytest
from playwright.sync_api import expect

from tests.browser.conftest import BARS, changed

pytestmark = pytest.mark.browser

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


def test_priority_inversion(run_notebook):
    nb = run_notebook("01_priority_inversion.ipynb")
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

    box = figure.locator(".trace.bars path[style*='rgb(0, 114, 178)']").first.bounding_box()
    nb.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(figure.locator(".hoverlayer")).to_contain_text("L runs")

    width, room = figure.evaluate(WIDTHS)
    assert width > 0.95 * room, "the figure does not fill the bench"


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
