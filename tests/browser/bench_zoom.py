"""From a gesture in a picture of a million slices to the picture painted for it, beside floors measured in the same page.

Goal: <= 100 ms from letting go of the mouse, or a turn of the wheel, to the last paint, where a core is free; and one drawing for
each, which is demanded. Reported: least, median and 95 %. The floors: a number that goes to the kernel and comes back, a
`Plotly.react` that has nothing to do, and one that draws the same picture anew.
"""

from collections.abc import Callable

import nbformat
import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.bench_latency import ECHO, HEAR, NOTHING, WATCH, move, quantiles
from tests.browser.test_bench import KERNEL

pytestmark = pytest.mark.browser

SLICES, TASKS = 1_000_000, 8
STEPS = 24  # of each gesture

CELLS = {
    "OwnRecording": 'explore(OwnRecording, file="million.log")',
    "LongRun": 'explore(LongRun, rates="10000|5000", seconds=10)',
}

#: Notes the time from the last event of a gesture to the painted picture, that part of it which plotly takes, and its drawings.
NOTE = """bench => {
    const figure = bench.querySelector('.js-plotly-plot'), lib = window.labkitPlotly.lib, react = lib.react;
    let from = 0, draws = 0, drawing = 0;
    window.steps = [];
    lib.react = (...of) => {
        const start = performance.now(), made = react(...of);
        drawing += performance.now() - start;
        return made;
    };
    for (const kind of ['mouseup', 'dblclick', 'wheel']) {
        window.addEventListener(kind, (event) => { [from, draws, drawing] = [event.timeStamp, 0, 0] }, true);
    }
    figure.on('plotly_afterplot', () => { draws += 1 });
    new MutationObserver(() => requestAnimationFrame(() => {
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => { if (from) { window.steps.push([performance.now() - from, drawing, draws]); from = 0 } };
        port2.postMessage(0);
    })).observe(bench.querySelector('.lab-picture'), { attributes: true, attributeFilter: ['data-drawn'] });
}"""
#: Milliseconds of a react to other arrays with the same numbers, up to the paint, 20 times.
ANEW = """async figure => {
    const took = [], lib = window.labkitPlotly.lib, frame = () => new Promise(requestAnimationFrame);
    for (let i = 0; i < 20; i++) {
        await frame();
        const start = performance.now();
        const data = figure.data.map((trace) => ({ ...trace, x: trace.x?.slice(), y: trace.y?.slice() }));
        await lib.react(figure, data, { ...figure.layout });
        await frame();
        took.push(performance.now() - start);
    }
    return took;
}"""


def million(path) -> None:
    """A log of that many stretches on the processor, of random lengths and gaps."""
    rng = np.random.default_rng(1)
    who, length, gap = (rng.integers(low, high, SLICES) for low, high in ((0, TASKS), (2, 14), (0, 6)))
    start = np.cumsum(length + gap) - length
    rows = zip(who.tolist(), start.tolist(), (start + length).tolist(), strict=True)
    path.write_text("".join(f"task_{task} {begin} 1\ntask_{task} {end} 0\n" for task, begin, end in rows))


def drag(page: Page, area: Locator, start: float, end: float) -> None:
    """With the mouse over an area, from one share of its width to another."""
    box = area.bounding_box()
    y = box["y"] + min(12, box["height"] / 2)
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=6)
    page.mouse.up()


def steps(page: Page, step: Callable[[int], None]) -> dict[str, tuple]:
    """Make steps, each after the one before has been painted; least, median and 95 % in ms, plotly's share, drawings per step."""
    page.evaluate("() => { window.steps = [] }")
    for n in range(STEPS):
        step(n)
        page.wait_for_function("n => window.steps.length > n", arg=n, polling="raf", timeout=20_000)
        page.wait_for_timeout(150)
    whole, plotly, draws = zip(*page.evaluate("() => window.steps"), strict=True)
    return {"all": quantiles(whole), "plotly": quantiles(plotly), "draws": max(draws)}


@pytest.mark.parametrize("name", CELLS)
def test_gesture_to_picture(benchmark, open_notebook, lab, tmp_path, name):
    million(lab.root / "million.log")
    notebook = tmp_path / "zoom.ipynb"
    cells = [nbformat.v4.new_code_cell(code) for code in ("from labkit import *", CELLS[name], ECHO.strip())]
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=KERNEL), notebook)
    nb = open_notebook(notebook)
    nb.run_all(240_000)
    bench = nb.page.locator(".lab-bench").first
    expect(bench.locator(".lab-progress")).to_be_hidden(timeout=240_000)
    figure = nb.figure()
    bench.evaluate("bench => bench.scrollIntoView({ block: 'center' })")
    nb.page.wait_for_timeout(3000)
    bench.evaluate(NOTE)
    area, below = figure.locator(".nsewdrag").first, figure.locator(".ewdrag").first
    found = {}

    def gestures():
        def zoom(n):  # three times closer, three times, then all of it again
            if n % 4 == 3:
                area.dblclick(position={"x": 300, "y": 10})
            else:
                drag(nb.page, area, 0.3, 0.63)

        def turn(n):
            area.hover(position={"x": 400, "y": 10})
            nb.page.keyboard.down("Control")
            nb.page.mouse.wheel(0, -100 if n // 6 % 2 == 0 else 100)
            nb.page.keyboard.up("Control")

        found["zoom"] = steps(nb.page, zoom)
        drag(nb.page, area, 0.3, 0.5)
        nb.page.wait_for_timeout(500)
        found["pan"] = steps(nb.page, lambda n: drag(nb.page, below, 0.5, 0.3 if n // 4 % 2 == 0 else 0.7))
        found["wheel"] = steps(nb.page, turn)

    benchmark.pedantic(gestures, rounds=1)
    assert all(each["draws"] == 1 for each in found.values()), found
    nb.page.evaluate(WATCH)
    figure.evaluate(HEAR)
    found["echo"] = move(nb.page, nb.page.locator(".lab-echo-slider"), 30)
    found["empty react"] = quantiles(figure.evaluate(NOTHING))
    found["react anew"] = quantiles(figure.evaluate(ANEW))
    benchmark.extra_info |= found
    print("\n", name, found)
