"""From a key press on a slider to the painted picture, in JupyterLab, beside two floors measured in the same page.

Goal: median <= 70 ms and 95 % <= 120 ms for PriorityInversion, <= 100 and 150 for every other. The floors: a number that a
slider sends to the kernel and that comes back into the page, and a `Plotly.react` that has nothing to do. Reported: least, median
and 95 %; a machine that shares its cores with others changes its speed within milliseconds, by which the least of a floor and its
median tell.
"""

import re
import shutil
import statistics
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"

pytestmark = pytest.mark.browser

MOVES = 60

#: experiment -> notebook and a slider of it with room for four steps to the right. PriorityInversion is the light one, the others
#: are the heaviest of their notebooks.
BENCHES = {
    "PriorityInversion": ("01_priority_inversion.ipynb", "hold"),
    "ThreeTasks": ("00_start_here.ipynb", "wheel-work"),
    "MarsPathfinder": ("01_priority_inversion.ipynb", "comm-work"),
    "CacheMap": ("02_cache_speedups.ipynb", "step"),
    "DmaCoherence": ("03_dma_coherence.ipynb", "step"),
    "Schedules": ("07_schedulability.ipynb", "ECET"),
    "SixDesigns": ("08_taft_phases.ipynb", "seed"),
    "Timeliness": ("08_taft_phases.ipynb", "seed"),
}

ECHO = '''
import anywidget, ipywidgets, traitlets

class Echo(anywidget.AnyWidget):
    _esm = """export default { render({ model, el }) {
        el.className = "lab-echo";
        model.on("msg:custom", ({ value }) => { el.textContent = value; requestAnimationFrame(() => window.painted?.()) });
    } }"""

slider, echo = ipywidgets.IntSlider(min=0, max=1000, value=500), Echo()
slider.add_class("lab-echo-slider")
slider.observe(lambda change: echo.send({"value": change["new"]}), names="value")
ipywidgets.VBox([slider, echo])
'''

#: Notes when a key goes down and when the page has painted what came of it.
WATCH = """() => {
    window.waits = [];
    window.painted = () => { if (window.pressed) { window.waits.push(performance.now() - window.pressed); window.pressed = 0 } };
    window.addEventListener('keydown', () => { window.pressed = performance.now() }, true);
}"""
HEAR = "figure => figure.on('plotly_afterplot', () => requestAnimationFrame(window.painted))"
#: Milliseconds of a react without a change, up to the paint, 30 times.
NOTHING = """async figure => {
    const took = [], lib = window.labkitPlotly.lib;
    for (let i = 0; i < 30; i++) {
        const start = performance.now();
        await lib.react(figure, figure.data, figure.layout);
        took.push(performance.now() - start);
        await new Promise(requestAnimationFrame);
    }
    return took;
}"""


def quantiles(times: list[float]) -> tuple[float, float, float]:
    """Least, median and 95 %."""
    times = sorted(times)
    return round(times[0], 1), round(statistics.median(times), 1), round(times[int(0.95 * len(times))], 1)


def move(page, control, moves: int, keys: tuple[str, str] = ("ArrowRight", "ArrowLeft")) -> tuple[float, float, float]:
    """Press keys on a control, four of a kind, one after the other has been painted; quantiles in ms."""
    page.evaluate("() => { window.waits = [] }")
    handle = control.locator(".noUi-handle, input[type=checkbox]").first
    handle.focus()
    for n in range(moves):
        handle.press(keys[n // 4 % 2])
        page.wait_for_function("n => window.waits.length > n", arg=n, polling="raf", timeout=20_000)
    return quantiles(page.evaluate("() => window.waits")[3:])


def watched(nb, name):
    """The bench of an experiment and its picture, at rest and with a clock on them."""
    bench = nb.page.locator(".lab-bench").filter(has=nb.page.locator(".lab-code", has_text=re.compile(rf"^{name}\("))).first
    bench.scroll_into_view_if_needed()
    bench.locator(".main-svg").first.wait_for()
    nb.page.wait_for_timeout(3000)
    figure = bench.locator(".js-plotly-plot")
    nb.page.evaluate(WATCH)
    figure.evaluate(HEAR)
    return bench, figure


@pytest.mark.parametrize("name", BENCHES)
def test_slider_to_picture(benchmark, open_notebook, name, tmp_path):
    notebook, slider = BENCHES[name]
    copy = tmp_path / notebook
    shutil.copy(NOTEBOOKS / notebook, copy)
    content = nbformat.read(copy, as_version=4)
    content.cells.append(nbformat.v4.new_code_cell(ECHO.strip()))
    nbformat.write(content, copy)
    nb = open_notebook(copy)
    nb.run_all(120_000)
    bench, figure = watched(nb, name)
    found = {}

    def press():
        found["key to painted"] = move(nb.page, bench.locator(f".lab-{slider}"), MOVES)

    benchmark.pedantic(press, rounds=1)
    found["echo"] = move(nb.page, nb.page.locator(".lab-echo-slider"), MOVES)
    found["empty react"] = quantiles(figure.evaluate(NOTHING))
    benchmark.extra_info |= {f"{what}, least, median and 95 % in ms": times for what, times in found.items()}
    print("\n", name, found)


def test_a_window_of_ten_kilohertz(benchmark, open_notebook):
    """Goal: as for every other bench. The slider moves the window; the box is one that has the 100 ms simulated anew."""
    nb = open_notebook("05_tick_rates.ipynb")
    nb.run_all(180_000)
    bench, figure = watched(nb, "TickRates")
    bench.locator(".lab-rates select").select_option(label="10000|5000 Hz")
    bench.locator(".lab-code", has_text="10000|5000").wait_for()
    nb.page.wait_for_timeout(2000)
    found = {}

    def press():
        found["window moved, key to painted"] = move(nb.page, bench.locator(".lab-start"), MOVES)

    benchmark.pedantic(press, rounds=1)
    found["simulated anew, key to painted"] = move(nb.page, bench.locator(".lab-caches"), MOVES, ("Space", "Space"))
    found["empty react"] = quantiles(figure.evaluate(NOTHING))
    benchmark.extra_info |= {f"{what}, least, median and 95 % in ms": times for what, times in found.items()}
    print("\n 10 kHz", found)
