"""That the browser tests can see: a slider moves a picture, an error shows, a request to the outside is caught."""

from pathlib import Path

import nbformat
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

BAR = """
import ipywidgets as w

bar = w.HTML()
k = w.IntSlider(value=1, min=1, max=20, description="k")
k.add_class("lab-k")

def draw(*_):
    bar.value = f"<div class='bar' style='width: {40 * k.value}px; height: 20px; background: black'></div>"

k.observe(draw, names="value")
draw()
w.VBox([k, bar])
"""
DIVIDE = """
n = w.IntSlider(value=1, min=0, max=9)
n.add_class("lab-n")
w.interact(lambda n: 12 // n, n=n);
"""


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    cells = [nbformat.v4.new_markdown_cell("# Sample")] + [nbformat.v4.new_code_cell(code.strip()) for code in (BAR, DIVIDE)]
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3 (ipykernel)", "language": "python"}}  # else Lab asks
    path = tmp_path / "sample.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=metadata), path)
    return path


def test_slider_moves_a_picture_and_an_error_shows(open_notebook, sample):
    nb = open_notebook(sample)
    nb.run_all()
    bar = nb.page.locator(".bar")
    expect(bar).to_have_css("width", "40px")
    nb.slider(".lab-k", "ArrowRight")
    handle = nb.slider(".lab-k", "ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "3.0")
    expect(bar).to_have_css("width", "120px")
    assert len(nb.page.screenshot()) > 10_000

    expect(nb.cell(2)).to_contain_text("12")
    nb.slider(".lab-n", "ArrowLeft")
    expect(nb.cell(2)).to_contain_text("ZeroDivisionError")


def test_run_all_reports_the_error_of_a_cell(open_notebook, sample):
    notebook = nbformat.read(sample, as_version=4)
    notebook.cells[1:] = [nbformat.v4.new_code_cell("1 / 0")]
    nbformat.write(notebook, sample)
    nb = open_notebook(sample)
    with pytest.raises(AssertionError, match="ZeroDivisionError: division by zero"):
        nb.run_all()


def test_a_request_to_the_outside_is_refused_and_recorded(open_notebook, sample):
    nb = open_notebook(sample)
    assert nb.external == []
    answer = nb.page.evaluate("() => fetch('https://lab.invalid/font.css').then(() => 'reached', () => 'refused')")
    assert answer == "refused"
    nb.page.evaluate("() => { new WebSocket('wss://lab.invalid/live') }")
    nb.page.wait_for_timeout(200)
    assert nb.external == ["https://lab.invalid/font.css", "wss://lab.invalid/live"]
    nb.external.clear()
