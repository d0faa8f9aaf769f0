"""The bench in the page, with an experiment made for it: width, keys, zoom, errors, and what happens when the kernel goes."""

import re

import nbformat
import pytest
from playwright.sync_api import expect

from tests.browser.conftest import IMPATIENT, SHUT_DOWN, TOKEN

pytestmark = pytest.mark.browser

ROLLING = '''
import time
from typing import Annotated, ClassVar
from annotated_types import Interval, MaxLen
from typing_extensions import Doc
from labkit import Experiment, Metric, explore, guesses, predict
from labkit.experiment import View, progress

class Rolling(Experiment[int]):
    """How far?"""
    level: Annotated[int, Interval(ge=1, le=5), Doc("load")] = 1
    note: Annotated[str, MaxLen(5), Doc("remark")] = ""
    first: Annotated[int, Interval(ge=0, le=90), Doc("left edge"), View()] = 0
    last: Annotated[int, Interval(ge=10, le=100), Doc("right edge"), View()] = 100
    step: Annotated[int, Interval(ge=0, le=3), Doc("what plays"), View(play=True)] = 0

    def run(self):
        if self.level == 3:
            raise RuntimeError("the model broke at level 3")
        return self.level

    def figure(self, result):
        line = {"type": "scatter", "x": [0, 100], "y": [0, result], "mode": "lines"}
        axis = {"range": [self.first, self.last], "title": {"text": "time [ms]"}}
        height = {"range": [0, result], "title": {"text": "load"}}
        meta = {"says": f"step {self.step}"} | ({"range": ("first", "last")} if self.level == 1 else {})
        return {"data": [line], "layout": {"xaxis": axis, "yaxis": height, "height": 300, "meta": meta}}

    def metrics(self, result):
        return [Metric("level", result, "<b>bar</b>")]

class Slow(Rolling):
    """How far, slowly?"""
    slow: ClassVar[bool] = True

    def run(self):
        for _ in progress(range(20)):
            time.sleep(0.1)
        return self.level

explore(Rolling)
'''
NAMED = '''
class Named(Rolling):
    """Who is who?"""
    def figure(self, result):
        made = super().figure(result)
        line, key = made["data"][0], {"x": [None], "y": [None], "name": "a key" if result == 1 else "another key"}
        made["data"] = [{**line, "name": "up"}, {**line, "y": [result, 0], "name": "down"}, key]
        made["layout"] |= {"showlegend": True, "legend": {"orientation": "h", "yref": "container", "y": 1, "yanchor": "top"}}
        return made

explore(Named)
'''
WIDTHS = """bench => [bench.querySelector('.lab-plot').clientWidth, bench.querySelector('.main-svg').clientWidth]"""
SIDE_BAR = "() => { window.jupyterapp.commands.execute('application:toggle-left-area') }"
SAVE = "() => { window.jupyterapp.commands.execute('docmanager:save') }"
KERNEL = {"kernelspec": {"name": "python3", "display_name": "Python 3 (ipykernel)", "language": "python"}}
RESTART = "() => { window.jupyterapp.shell.currentWidget.sessionContext.session.kernel.restart() }"
#: As on a busy page: the veil has come before there was a bench around it.
TOGETHER_LATE = """async bench => {
    const plot = bench.querySelector('.lab-plot'), place = plot.parentElement, next = plot.nextSibling;
    const frame = () => new Promise(then => requestAnimationFrame(() => requestAnimationFrame(then)));
    plot.remove();
    bench.classList.remove('lab-veiled');
    await frame();
    place.insertBefore(plot, next);
    await frame();
}"""


@pytest.fixture
def bench_of(open_notebook, tmp_path):
    """Open a notebook that ends with this line; the notebook and its bench."""

    def opener(*more: str, lift: bool = True):
        cells = [nbformat.v4.new_code_cell(code.strip()) for code in (ROLLING, *more)]
        path = tmp_path / "rolling.ipynb"
        nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=KERNEL), path)
        nb = open_notebook(path)
        nb.run_all(lift=lift)
        nb.figure()
        return nb, nb.page.locator(".lab-bench").last

    return opener


def code(bench, text):
    expect(bench.locator(".lab-code")).to_have_text(text)


def test_the_picture_fills_its_bench_whatever_changes_its_size(bench_of):
    nb, bench = bench_of()

    def fills():
        nb.page.wait_for_timeout(600)
        room, width = bench.evaluate(WIDTHS)
        assert abs(room - width) <= 2
        return width

    before = fills()
    nb.page.evaluate(SIDE_BAR)
    assert fills() > before + 100
    bench.locator(".lab-lecture-switch").click()
    nb.page.keyboard.press("Escape")
    nb.page.evaluate(SIDE_BAR)
    assert abs(fills() - before) <= 2


def test_lecture_mode_fills_the_window_and_escape_leaves_it(bench_of):
    nb, bench = bench_of("explore(Rolling, level=2)")
    other = nb.page.locator(".lab-bench").first
    look = """bench => {
        const box = e => { const { x, y, width, height } = e.getBoundingClientRect(); return [x, y, width, height] };
        return [box(bench), box(bench.querySelector('.xtitle'))[3], box(bench.querySelector('.main-svg'))] }"""
    bench.locator(".lab-lecture-switch").focus()
    before, still = bench.evaluate(look), other.evaluate(look)
    bench.locator(".lab-lecture-switch").press("Enter")  # the key belongs to the button, not to the notebook
    nb.page.wait_for_timeout(600)
    window, letters, picture = bench.evaluate(look)
    assert window == [0, 0, 1600, 900] and letters > 1.25 * before[1]
    assert picture[2] > 1500 and picture[3] > 500 and picture[1] + picture[3] <= 900
    assert other.evaluate(look) == still
    expect(bench.locator(".lab-lecture-switch")).to_have_attribute("aria-pressed", "true")
    nb.page.set_viewport_size({"width": 1366, "height": 768})
    nb.page.wait_for_timeout(600)
    assert bench.evaluate(look)[0] == [0, 0, 1366, 768]
    nb.page.set_viewport_size({"width": 1600, "height": 900})
    nb.slider(".lab-bench.lab-lecture .lab-level", "ArrowLeft")
    code(bench, "Rolling()")
    nb.page.keyboard.press("Escape")
    nb.page.wait_for_timeout(600)
    assert bench.evaluate(look)[0][2:] == before[0][2:]
    assert not nb.page.locator(".lab-lecture").count()


def test_a_pinned_result_stays_behind_the_live_one(bench_of):
    nb, bench = bench_of()
    lines = "figure => figure.data.map(trace => [trace.opacity ?? 1, Array.from(trace.y)])"
    bench.locator(".lab-pin").click()
    nb.slider(".lab-level", "ArrowRight")
    code(bench, "Rolling(level=2)")
    nb.page.wait_for_function("document.querySelector('.lab-picture').dataset.drawn === 'Rolling(level=2)'")
    assert nb.figure().evaluate(lines) == [[0.3, [0, 1]], [1, [0, 2]]]
    expect(bench.locator(".lab-news")).to_have_text("load now from 0 to 2")
    expect(bench.locator(".lab-metric").first).to_contain_text("2 <b>bar</b>level · was 1 <b>bar</b>")
    expect(bench.locator(".lab-pinned-code")).to_have_text("pinned: Rolling()")
    bench.locator(".lab-pin").click()
    expect(bench.locator(".lab-pinned-code")).to_be_hidden()
    nb.page.wait_for_function("document.querySelector('.js-plotly-plot').data.length === 1")
    expect(bench.locator(".lab-metric").first).to_have_text("2 <b>bar</b>level")


def test_a_legend_is_drawn_when_it_changes_and_hides_what_it_names(bench_of):
    nb, bench = bench_of(NAMED)
    legend, figure = bench.locator(".lab-legend"), bench.locator(".js-plotly-plot")
    entries = legend.locator("text")
    seen = "figure => figure.data.filter(trace => trace.visible !== 'legendonly').map(trace => trace.name)"
    expect(entries).to_have_text(["up", "down", "a key"])
    legend.evaluate("legend => { legend.dataset.known = 'yes' }")
    bench.locator(".lab-forward").click()
    nb.page.wait_for_function("[...document.querySelectorAll('.lab-picture')].at(-1).dataset.drawn === 'Named(step=1)'")
    assert legend.get_attribute("data-known") == "yes", "drawn again though it is the same"
    expect(bench.locator(".infolayer .legend")).to_have_count(0)

    toggles = legend.locator(".legendtoggle")
    assert toggles.count() == 2, "what is only an entry of the legend cannot be hidden"
    toggles.first.click()
    expect(legend).not_to_have_attribute("data-known", "yes")
    assert figure.evaluate(seen) == ["down", "a key"]
    handle = bench.locator(".lab-level .noUi-handle")
    handle.focus()
    handle.press("ArrowRight")
    expect(entries).to_have_text(["up", "down", "another key"])
    assert figure.evaluate(seen) == ["down", "another key"], "what a reader has hidden stays hidden"
    toggles.first.click()
    expect(legend.locator(".traces").first).to_have_css("opacity", "1")
    assert figure.evaluate(seen) == ["up", "down", "another key"]

    bench.locator(".lab-forward").click()
    nb.page.wait_for_function("[...document.querySelectorAll('.lab-picture')].at(-1).dataset.drawn === 'Named(level=2, step=2)'")
    nb.page.evaluate("() => { window.labkitPlotly.lib.downloadImage = picture => { window.saved = picture } }")
    bench.locator(".lab-save").click()
    saved = nb.page.evaluate("() => [window.saved.data.map(trace => trace.name), window.saved.layout.showlegend]")
    assert saved == [["up", "down", "another key"], True]


def test_play_goes_to_the_end_and_steps_go_back_and_forth(bench_of):
    _, bench = bench_of()
    expect(bench.locator(".lab-says")).to_have_text("step 0")
    bench.locator(".lab-play").click()
    code(bench, "Rolling(step=3)")
    expect(bench.locator(".lab-says")).to_have_text("step 3")
    expect(bench.locator(".lab-play")).to_have_text("▶")
    bench.locator(".lab-back").click()
    code(bench, "Rolling(step=2)")
    bench.locator(".lab-forward").click()
    code(bench, "Rolling(step=3)")
    bench.locator(".lab-play").click()  # once more, from the beginning
    code(bench, "Rolling(step=1)")


def test_a_question_veils_its_bench_until_it_is_decided(bench_of):
    ask = 'predict("Which level?", Rolling(level=2), "level")'
    nb, bench = bench_of(ask, "explore(Rolling, level=2)", "guesses()", lift=False)
    expect(bench.locator(".lab-veil")).to_be_visible()
    expect(bench.locator(".main-svg").first).not_to_be_visible()
    bench.evaluate(TOGETHER_LATE)
    expect(bench.locator(".lab-picture")).not_to_be_visible()
    nb.run_all(lift=False)
    bench = nb.page.locator(".lab-bench").last
    expect(bench.locator(".lab-veil")).to_be_visible()
    guess = nb.page.locator(".lab-predict input")
    guess.fill("minus one")
    guess.press("Enter")
    expect(nb.page.locator(".lab-predict")).to_contain_text("is no number that can be compared")
    expect(bench.locator(".lab-veil")).to_be_visible()
    guess.fill("2")
    guess.press("Enter")
    expect(nb.page.locator(".lab-predict")).to_contain_text("You said 2 <b>bar</b>: right.")
    expect(bench.locator(".lab-veil")).to_be_hidden()
    expect(nb.page.locator(".lab-guesses")).to_contain_text("right")
    nb.run_all(lift=False)  # what was decided stays decided
    expect(nb.page.locator(".lab-bench").last.locator(".lab-veil")).to_be_hidden()


def test_an_error_is_shown_beside_a_stale_picture_and_goes_when_it_is_mended(bench_of):
    nb, bench = bench_of()
    expect(bench.locator(".lab-metric")).to_have_text("1 <b>bar</b>level")  # as text
    nb.slider(".lab-level", "ArrowRight")
    code(bench, "Rolling(level=2)")
    nb.slider(".lab-level", "ArrowRight")
    expect(bench.get_by_role("alert")).to_contain_text("RuntimeError: the model broke at level 3")
    expect(bench.locator(".lab-plot")).to_have_class(re.compile("lab-stale"))
    code(bench, "Rolling(level=2)")
    field = bench.locator(".lab-note input")
    field.fill("too long")
    field.press("Enter")
    nb.slider(".lab-level", "ArrowRight")
    expect(bench.get_by_role("alert")).to_contain_text(
        "note = 'too long' is not allowed; allowed is text of at most 5 characters"
    )
    expect(field).to_have_value("too long")
    bench.locator(".lab-reset").click()
    expect(bench.get_by_role("alert")).to_have_count(0)
    code(bench, "Rolling()")
    expect(field).to_have_value("")


#: anywidget's 2 s for the code of a widget are over at once, as on a page that is busy with others.
NO_PATIENCE = (
    "() => { const real = window.patience = AbortSignal.timeout; AbortSignal.timeout = () => real.call(AbortSignal, 0) }"
)
PATIENCE = "() => { AbortSignal.timeout = window.patience }"


def test_a_page_too_busy_to_load_its_code_in_time_shows_the_bench_and_hears_what_comes(open_notebook, tmp_path):
    path = tmp_path / "busy.ipynb"
    last = "from labkit import OwnTaskSet, task_set_editor\ntask_set_editor(OwnTaskSet)"
    cells = [nbformat.v4.new_code_cell(code.strip()) for code in (ROLLING, last)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=KERNEL), path)
    nb = open_notebook(path)
    nb.page.evaluate(NO_PATIENCE)
    complaints = []
    nb.page.on("pageerror", lambda error: complaints.append(str(error)))
    try:
        nb.run_all()
    finally:
        nb.page.evaluate(PATIENCE)
    rolling, editor = nb.page.locator(".lab-bench").nth(0), nb.page.locator(".lab-bench").nth(1)
    expect(rolling.locator(".lab-code")).to_have_text("Rolling()")
    nb.slider(".lab-level", "ArrowRight")
    expect(rolling.locator(".lab-code")).to_have_text("Rolling(level=2)")
    expect(editor.locator(".lab-table tbody tr")).not_to_have_count(0)
    assert set(complaints) == {IMPATIENT}, "the time was not over, and nothing was tried"


def test_a_zoom_moves_the_parameters_it_stands_for(bench_of):
    nb, bench = bench_of()
    bench.locator(".lab-code").scroll_into_view_if_needed()
    area = bench.locator(".nsewdrag").bounding_box()
    nb.page.mouse.move(area["x"] + 0.25 * area["width"], area["y"] + 50)
    nb.page.mouse.down()
    nb.page.mouse.move(area["x"] + 0.5 * area["width"], area["y"] + 50, steps=5)
    nb.page.mouse.up()
    code(bench, "Rolling(first=25, last=50)")
    expect(bench.locator(".lab-first .widget-readout")).to_have_text("25")


def test_a_slow_run_shows_its_progress_and_a_refused_text_ends_it(bench_of):
    nb, bench = bench_of("explore(Slow)")
    code(bench, "Slow()")
    nb.page.locator(".lab-level .noUi-handle").last.press("ArrowRight")
    expect(bench.locator(".lab-progress")).to_be_visible()
    field = bench.locator(".lab-note input")
    field.fill("too long")
    field.press("Enter")
    expect(bench.get_by_role("alert")).to_contain_text("is not allowed")
    nb.page.wait_for_timeout(3000)  # the run would have ended by now
    expect(bench.get_by_role("alert")).to_contain_text("is not allowed")
    code(bench, "Slow()")


def test_a_bench_whose_kernel_was_restarted_says_so(bench_of):
    nb, bench = bench_of()
    expect(bench.locator(".lab-gone")).to_be_hidden()
    nb.page.evaluate(RESTART)
    expect(bench.locator(".lab-gone")).to_be_visible(timeout=20_000)
    expect(bench.locator(".lab-gone")).to_contain_text("Run its cell again")
    nb.screenshot("gone")


def test_a_bench_comes_back_after_a_reload(bench_of, lab):
    nb, bench = bench_of()
    nb.slider(".lab-level", "ArrowRight")
    code(bench, "Rolling(level=2)")
    nb.page.evaluate(SAVE)
    nb.page.wait_for_timeout(1500)
    again = f"{lab.url}/lab/tree/rolling.ipynb?token={TOKEN}&reset"
    nb.page.goto(again)
    expect(nb.page.locator(".lab-bench .lab-code")).to_have_text("Rolling(level=2)", timeout=30_000)
    nb.figure()
    expect(nb.page.locator(".lab-lost")).to_be_hidden()
    nb.page.evaluate(SHUT_DOWN)
    nb.page.wait_for_timeout(1500)
    nb.page.goto(again)
    expect(nb.page.locator(".lab-lost")).to_be_visible(timeout=30_000)
    nb.screenshot("lost")
