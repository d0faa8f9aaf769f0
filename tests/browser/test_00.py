"""Notebook 00 as a person meets it: guess, move sliders, name, drop or choose a recording, zoom it; a long one in pieces."""

import math
import shutil

import pytest
from playwright.sync_api import expect

from labkit.data import example
from tests.browser.conftest import BARS, changed

pytestmark = pytest.mark.browser

#: What happens when a file is let go over an element.
DROP = """(element, [name, text]) => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([text], name));
    for (const kind of ['dragover', 'drop']) {
        element.dispatchEvent(new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }));
    }
}"""
#: A drag over a file that shows where it may be let go.
OVER = DROP.replace(", 'drop'", "")
#: A log of `size` bytes, made in the page, chosen in a file field.
CHOOSE = """(field, [name, size]) => {
    const line = (i) => `busy ${i * 10} 1\\nbusy ${i * 10 + 7} 0\\n`;
    const piece = Array.from({ length: 1000 }, (_, i) => line(i)).join('');
    const lines = Array(Math.ceil(size / piece.length)).fill(piece.replace(/^busy/gm, '# a comment: busy'));
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([piece, ...lines], name));
    field.files = dataTransfer.files;
    field.dispatchEvent(new Event('change'));
}"""
RANGE = "figure => figure.layout.xaxis.range"
#: Counts how often plotly draws, from now on.
COUNT = "figure => { figure.drawn = 0; figure.on('plotly_afterplot', () => { figure.drawn += 1 }) }"
#: Where the marks of the picture are; noted when a mouse has just been let go, too.
PLACE = "figure => figure.querySelector('.overplot > g').getAttribute('transform')"
LET_GO = f"figure => {{ window.addEventListener('mouseup', () => {{ figure.left = ({PLACE})(figure) }}, {{ once: true }}) }}"
#: How often since it was last asked, when nothing has come for half a second.
DRAWN = """async figure => {
    const rest = () => new Promise((resolve) => setTimeout(resolve, 500));
    let before = -1;
    while (before !== figure.drawn) { before = figure.drawn; await rest(); }
    figure.drawn = 0;
    return before;
}"""


def test_a_recording_of_ones_own(run_notebook, lab):
    nb = run_notebook("00_start_here.ipynb")
    bench, figure = nb.page.locator(".lab-bench").nth(1), nb.figure(1)
    strip, line, says = bench.locator(".lab-drop"), bench.locator(".lab-code"), bench.locator(".lab-says")
    bench.scroll_into_view_if_needed()
    expect(strip).to_contain_text("at most 256 MiB")
    nb.screenshot("00_own_recording")

    shutil.copy(example("board.log"), lab.root / "board.log")
    field = bench.locator(".lab-file input")
    field.fill("board.log")
    field.press("Enter")
    expect(bench).to_contain_text("board.log, read as log: 161 lines")
    expect(bench.locator(".lab-metrics")).to_contain_text("196.2 ms")
    field.fill("no_such.log")
    field.press("Enter")
    expect(bench.get_by_role("alert")).to_contain_text("no_such.log: cannot be read")
    expect(bench.locator(".lab-metrics")).to_contain_text("196.2 ms")

    btf = example("board.btf").read_text()
    figure.evaluate(OVER, ["board.btf", btf])
    expect(strip).to_contain_class("lab-drop-here")
    nb.screenshot("00_over")
    figure.evaluate(DROP, ["board.btf", btf])  # onto the picture
    expect(line).to_have_text("OwnRecording(file='dropped/board.btf')")
    expect(strip).not_to_contain_class("lab-drop-here")
    expect(strip).to_contain_text("kept as dropped/board.btf")
    expect(says).to_contain_text("board.btf, read as BTF")
    expect(figure).to_contain_text("logger")
    bench.locator("summary", has_text="all of it").click()
    expect(bench.locator(".lab-told")).to_contain_text("percentiles are observed values")
    bench.scroll_into_view_if_needed()
    nb.screenshot("00_dropped")

    figure.evaluate(COUNT)
    box = figure.locator(".nsewdrag").first.bounding_box()
    nb.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    nb.page.mouse.down()
    nb.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20, steps=5)
    nb.page.mouse.up()
    expect(line).to_contain_text("start=")
    low, high = figure.evaluate(RANGE)
    assert low == pytest.approx(50, abs=2) and high == pytest.approx(100, abs=2)
    assert figure.evaluate(DRAWN) == 1, "a gesture is drawn once"
    axis = figure.locator(".ewdrag").first.bounding_box()
    nb.page.mouse.move(axis["x"] + 0.5 * axis["width"], axis["y"] + 5)
    nb.page.mouse.down()
    nb.page.mouse.move(axis["x"] + 0.25 * axis["width"], axis["y"] + 5, steps=5)
    figure.evaluate(LET_GO)
    nb.page.mouse.up()
    nb.page.wait_for_function("low => document.querySelectorAll('.js-plotly-plot')[1].layout.xaxis.range[0] > low + 5", arg=low)
    assert figure.evaluate(RANGE)[1] - figure.evaluate(RANGE)[0] == pytest.approx(high - low, abs=0.01)
    assert figure.evaluate(DRAWN) == 1
    left, rest = figure.evaluate("figure => figure.left"), figure.evaluate(PLACE)
    assert left != rest, "until it is drawn anew, a picture stays where it was dragged to, as its axis does"
    low, high = figure.evaluate(RANGE)
    nb.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    nb.page.mouse.wheel(0, -100)  # scrolls the page
    assert figure.evaluate(DRAWN) == 0
    bench.scroll_into_view_if_needed()
    box = figure.locator(".nsewdrag").first.bounding_box()
    nb.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    nb.page.keyboard.down("Control")
    nb.page.mouse.wheel(0, -100)
    nb.page.keyboard.up("Control")
    assert figure.evaluate(DRAWN) == 1
    closer = figure.evaluate(RANGE)
    assert closer[1] - closer[0] == pytest.approx(math.exp(-1 / 3) * (high - low), abs=0.02)
    assert closer[0] - low == pytest.approx((high - closer[1]) / 3, abs=0.1), "what is under the mouse stays there"
    figure.locator(".nsewdrag").first.dblclick(position={"x": 300, "y": 20})
    expect(line).to_have_text("OwnRecording(file='dropped/board.btf')")
    assert figure.evaluate(DRAWN) == 1

    figure.evaluate(DROP, ["picture.png", "\\u0089PNG"])
    expect(bench.locator(".lab-error")).to_contain_text("picture.png")
    strip.locator("input").set_input_files(example("board.log"))
    expect(line).to_contain_text("dropped/board.log")
    expect(bench.locator(".lab-error")).to_have_count(0)

    strip.locator("input").evaluate(CHOOSE, ["long.log", 52 << 20])
    expect(line).to_contain_text("dropped/long.log", timeout=120_000)
    expect(says).to_contain_text("long.log, read as log")
    expect(bench.locator(".lab-bar .lab-metric").nth(1)).to_contain_text("1\u202f000")  # runs


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
