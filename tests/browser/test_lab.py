"""That the browser tests can see: a slider moves a figure, an error shows, a request to the outside is caught."""

from pathlib import Path

import nbformat
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

FIGURE = """
import ipywidgets as w
import numpy as np
import plotly.graph_objects as go

x = np.linspace(0, 10, 500)
figure = go.FigureWidget(go.Scatter(x=x, y=np.sin(x)), layout={"title": {"text": "k=1"}, "height": 350})
k = w.IntSlider(value=1, min=1, max=20, description="k")
k.add_class("lab-k")

def move(change):
    with figure.batch_update():
        figure.data[0].y = np.sin(change["new"] * x)
        figure.layout.title.text = f"k={change['new']}"

k.observe(move, names="value")
w.VBox([k, figure])
"""
DIVIDE = """
n = w.IntSlider(value=1, min=0, max=9)
n.add_class("lab-n")
w.interact(lambda n: 12 // n, n=n);
"""
TITLED = "text => document.querySelector('.js-plotly-plot').layout?.title?.text === text"
DRAWN = "figure => [figure.layout.title.text, figure.querySelector('.scatterlayer path.js-line').getAttribute('d')]"


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    cells = [nbformat.v4.new_markdown_cell("# Sample")] + [nbformat.v4.new_code_cell(code.strip()) for code in (FIGURE, DIVIDE)]
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3 (ipykernel)", "language": "python"}}  # else Lab asks
    path = tmp_path / "sample.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=metadata), path)
    return path


def test_slider_moves_the_figure_and_an_error_shows(open_notebook, sample):
    nb = open_notebook(sample)
    nb.run_all()
    nb.figure()
    nb.page.wait_for_function(TITLED, arg="k=1")
    nb.page.wait_for_timeout(1000)  # this widget of plotly's loses what comes while it tells its kernel how it was drawn
    _, line = nb.figure().evaluate(DRAWN)
    nb.slider(".lab-k", "ArrowRight")
    handle = nb.slider(".lab-k", "ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "3.0")
    nb.page.wait_for_function(TITLED, arg="k=3")
    assert nb.figure().evaluate(DRAWN)[1] != line
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
