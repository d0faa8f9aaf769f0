"""What holds for every bench of every notebook in the page: it draws what the model gives, and nothing lies on anything.

A new notebook joins by existing. A question's bench is veiled; each control of each experiment is moved, one with a pinned
picture behind; what can be played goes one step on; the bench is reset; lecture mode fits windows of three sizes.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import ElementHandle, Page, TimeoutError, expect

from labkit import experiments
from labkit.bench.plot import cards, pack
from labkit.experiment import Experiment, Parameter
from tests.bench.test_bench import Fresh, unpacked
from tests.browser.conftest import IMPATIENT

pytestmark = pytest.mark.browser

NOTEBOOKS = sorted(path.name for path in (Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))

#: What the page draws, typed arrays as lists and gaps as null.
DRAWN = (
    """plot => JSON.stringify([plot.data, plot.layout], (key, value) => ArrayBuffer.isView(value) ? Array.from(value) : value)"""
)
#: Texts that lie on each other or are cut at the edge of the picture or of their field, in words.
FAULTS = """bench => {
    const plot = bench.querySelector('.js-plotly-plot'), frame = plot.querySelector('.main-svg').getBoundingClientRect();
    const seen = [...plot.querySelectorAll('.infolayer text, .lab-legend text, .xaxislayer-above text, .yaxislayer-above text')]
        .filter(t => t.textContent.trim() && getComputedStyle(t).visibility !== 'hidden' && getComputedStyle(t).opacity > 0)
        .map(t => ({ text: t.textContent, box: t.getBoundingClientRect() })).filter(t => t.box.width > 0);
    const faults = [];
    seen.forEach((a, i) => {
        const { left, right, top, bottom } = a.box;
        if (left < frame.left - 1 || right > frame.right + 1 || top < frame.top - 1 || bottom > frame.bottom + 1)
            faults.push(`cut at the edge: ${a.text}`);
        for (const b of seen.slice(i + 1))
            if (Math.min(right, b.box.right) - Math.max(left, b.box.left) > 2
                && Math.min(bottom, b.box.bottom) - Math.max(top, b.box.top) > 4)
                faults.push(`on each other: ${a.text} | ${b.text}`);
    });
    for (const e of bench.querySelectorAll('.widget-label, .widget-readout, .lab-metric b, .lab-metric span, .lab-button'))
        if (e.scrollWidth > e.clientWidth + 1 && e.clientWidth) faults.push(`cut word: ${e.textContent}`);
    for (const e of bench.querySelectorAll('select')) {
        const pen = document.createElement('canvas').getContext('2d'), style = getComputedStyle(e);
        pen.font = `${style.fontSize} ${style.fontFamily}`;
        const chosen = e.selectedOptions[0].text;
        if (pen.measureText(chosen).width > e.clientWidth - 20) faults.push(`cut choice: ${chosen}`);
    }
    if (bench.scrollWidth > bench.clientWidth + 1) faults.push('wider than its place');
    return faults;
}"""
#: What does not fit the window in lecture mode, in words.
WINDOW_FAULTS = """bench => {
    const faults = [], box = e => e.getBoundingClientRect(), all = box(bench), picture = box(bench.querySelector('.main-svg'));
    if (all.left || all.top || all.width !== innerWidth || all.height !== innerHeight) faults.push('does not fill the window');
    if (bench.scrollHeight > bench.clientHeight + 1 || bench.scrollWidth > bench.clientWidth + 1) faults.push('has to scroll');
    const cards = [...bench.querySelectorAll('.lab-bar .lab-metric')].map(box);
    if (cards.length > 3 || new Set(cards.map(c => c.top)).size > 1) faults.push('cards wrap');
    const code = box(bench.querySelector('.lab-code')), bar = box(bench.querySelector('.lab-bar'));
    if (picture.bottom > code.top + 1 || code.bottom > innerHeight + 1) faults.push('the picture lies on the code line');
    if (picture.top < bar.bottom - 1 || picture.right > innerWidth + 1) faults.push('the picture lies on the cards');
    if (picture.height < 0.45 * innerHeight) faults.push(`the picture is only ${Math.round(picture.height)} px high`);
    const texts = [...bench.querySelectorAll('.infolayer text, .lab-legend text, .xaxislayer-above text')];
    const letters = Math.min(...texts.map(text => box(text).height).filter(height => height > 1));
    if (letters < innerHeight / 75) faults.push(`letters of ${letters.toFixed(1)} px`);
    return faults;
}"""
#: There are benches that wait for an answer, no more of them than there are questions.
ASKED = """() => {
    const veiled = document.querySelectorAll('.lab-veil:not([hidden])').length;
    return 0 < veiled && veiled <= document.querySelectorAll('.lab-predict').length }"""
#: What a bench says of itself when it is not what was waited for.
STATE = """bench => [bench.isConnected, bench.querySelector('.lab-code').textContent,
    bench.querySelector('.lab-picture').dataset.drawn,
    bench.querySelector('.lab-plot').className, bench.querySelector('.lab-picture').clientWidth,
    bench.querySelector('.lab-error-slot').textContent, !bench.querySelector('.lab-progress').hidden]"""
#: Where the picture and its texts are.
PLACES = """bench => [...bench.querySelectorAll('.main-svg, .infolayer text, .lab-legend text')].map(e => {
    const { x, y, width, height } = e.getBoundingClientRect();
    return [x, y, width, height] })"""
#: What does not fit or lies on what in lecture mode, once the picture fills its place and nothing moves any more; after five
#: seconds in any case.
AT_REST = f"""async bench => {{
    const places = {PLACES}, faults = [{WINDOW_FAULTS}, {FAULTS}], end = performance.now() + 5000;
    const size = css => bench.querySelector(css).getBoundingClientRect();
    for (let before = ''; ; ) {{
        await new Promise(requestAnimationFrame);
        const now = JSON.stringify(places(bench)), place = size('.lab-picture'), picture = size('.main-svg');
        const fills = Math.abs(place.width - picture.width) < 3 && Math.abs(place.height - picture.height) < 3;
        const found = fills && now === before || performance.now() > end ? faults.flatMap(each => each(bench)) : ['not at rest'];
        if (!found.length || performance.now() > end) return found;
        before = now;
    }}
}}"""
WINDOWS = ((1920, 1080), (1366, 768), (1600, 900))  # the last is that of the other tests
HEIGHT = 720  # px, at most, of a bench at its defaults
COMPARED = 4  # of a slow experiment only every fourth move is compared with the model; the page is looked at after each
LEGEND = "bench => [...bench.querySelectorAll('.lab-legend text')].map(text => text.dataset.unformatted)"
CARDS = """bench => [...bench.querySelectorAll('.lab-metric')].map(card => [...card.children].map(e => e.textContent))"""


class Bench(NamedTuple):
    """A bench in the page by its element: a locator would search the whole page for it again and again."""

    page: Page
    element: ElementHandle

    def find(self, css: str) -> ElementHandle:
        return self.element.query_selector(css)

    def click(self, css: str) -> None:
        self.find(css).dispatch_event("click")

    def wait(self, condition: str, *arguments) -> None:
        """Until a condition on `bench` and the arguments `a`, `b`, ... holds."""
        names = ", ".join(["bench", *"abc"[: len(arguments)]])
        try:
            self.page.wait_for_function(f"([{names}]) => {condition}", arg=[self.element, *arguments], timeout=60_000)
        except TimeoutError as error:
            raise AssertionError(f"not within 60 s: {condition} {arguments}; there is {self.element.evaluate(STATE)}") from error


def benches_of(page: Page) -> Iterator[Bench]:
    """Each is looked up when its turn comes: the page may have made it anew meanwhile."""
    for i in range(page.locator(".lab-bench").count()):
        yield Bench(page, page.query_selector_all(".lab-bench")[i])


def experiment_of(bench: Bench) -> Experiment:
    """What the code line says, made afresh here."""
    code = bench.find(".lab-code").text_content()
    name = re.match(r"\w+", code)[0]
    return eval(code, {name: getattr(experiments, name)})


def settled(bench: Bench, code: str | None = None) -> None:
    """Wait until the page has drawn the code line it shows (or that one), and nothing is under way."""
    drawn = "bench.querySelector('.lab-picture').dataset.drawn === (a ?? bench.querySelector('.lab-code').textContent)"
    bench.wait(f"!bench.querySelector('.lab-stale') && {drawn}", code)


def matches(drawn, fresh) -> bool:
    """Whether all that the fresh figure says is in what is drawn (plotly may add to it)."""
    if drawn == fresh:
        return True
    if isinstance(fresh, dict):
        return isinstance(drawn, dict) and all(value is None or matches(drawn.get(key), value) for key, value in fresh.items())
    if isinstance(fresh, list):
        return len(drawn or []) == len(fresh) and all(map(matches, drawn or [], fresh))
    if isinstance(fresh, float) and isinstance(drawn, int | float):
        return abs(drawn - fresh) <= 1e-9 * abs(fresh)
    return False


def is_key(trace: dict) -> bool:
    """Whether it is only an entry of the legend."""
    return trace.get("x") == [None]


def legend(figure: dict) -> list[str]:
    """The entries of its legend, in order."""
    if figure["layout"].get("showlegend") is False:
        return []
    named = [t for t in figure["data"] if "name" in t and t.get("showlegend") is not False and t.get("visible") is not False]
    names = [trace["name"] for trace in named if trace["x"] != []]
    return names[::-1] if figure["layout"]["legend"]["traceorder"] == "reversed" else names


def check(bench: Bench, experiment: Experiment, apart: Fresh, where: str, faults: list[str]) -> None:
    """Wait until the page shows this experiment, compare it with the model, and note what lies on what."""
    apart.result(experiment)  # while the page and its kernel do the same
    look(bench, experiment, where, faults)
    compare(bench, experiment, apart, f"{where}: {experiment.code()}")


def look(bench: Bench, experiment: Experiment, where: str, faults: list[str]) -> None:
    """Wait until the page shows this experiment, and note what lies on what."""
    settled(bench, experiment.code())
    faults += [f"{where}: {experiment.code()}: {fault}" for fault in bench.element.evaluate(FAULTS)]


def compare(bench: Bench, experiment: Experiment, apart: Fresh, what: str) -> None:
    """What the page draws, its legend and its cards, with what the model gives."""
    result = apart.result(experiment)
    buffers: list = []
    fresh = unpacked(pack(experiment.figure(result), buffers), buffers)
    entries = legend(fresh)
    fresh["data"] = [t for t in fresh["data"] if not is_key(t) and (t.get("showlegend") is not False or t.get("x") != [])]
    data, layout = json.loads(bench.find(".js-plotly-plot").evaluate(DRAWN))
    data = [trace for trace in data if not is_key(trace)]  # those that plotly was given when it drew the legend
    for i, (drawn, wanted) in enumerate(zip(data, fresh["data"], strict=True)):
        wrong = [key for key in wanted if not matches({key: drawn.get(key)}, {key: wanted[key]})]
        assert wrong == [], f"{what}: the page draws {wrong} of trace {i} otherwise than the model"
    wanted = fresh["layout"]
    assert matches(layout.get("shapes"), wanted.get("shapes", [])), f"{what}: other shapes"
    texts = [[note["text"] for note in one.get("annotations", [])] for one in (layout, wanted)]
    assert matches(*texts), f"{what}: other notes"
    axes = {name: axis for name, axis in wanted.items() if name[1:5] == "axis"}
    for name, axis in axes.items() if not any("scaleanchor" in axis for axis in axes.values()) else ():  # plotly fits such a pair
        if None not in (axis.get("range") or [None]):
            assert matches(layout[name]["range"], axis["range"]), f"{what}: another range of {name}"
    assert bench.element.evaluate(LEGEND) == entries, f"{what}: another legend"
    written = cards(experiment.metrics(result), experiment.headline)
    written.sort(key=lambda card: not card["headline"])
    expected = [[c["text"], " · ".join([c["name"], *c["beside"]])] for c in written]
    assert bench.element.evaluate(CARDS) == expected, f"{what}: other cards"


def move(bench: Bench, parameter: Parameter, experiment: Experiment) -> Experiment:
    """Move one control to another allowed position; what the bench has to show then."""
    css = f".lab-{parameter.name.replace('_', '-')}"
    value = getattr(experiment, parameter.name)
    if parameter.choices:
        at = (parameter.choices.index(value) + 1) % len(parameter.choices)
        bench.find(f"{css} select").select_option(index=at)
        return experiment.replace(**{parameter.name: parameter.choices[at]})
    if parameter.type is bool:
        bench.find(f"{css} input").click()
        return experiment.replace(**{parameter.name: not value})
    if parameter.type is str:
        return experiment
    step = parameter.step or (1 if parameter.type is int else (parameter.high - parameter.low) / 100)
    up = value + step <= parameter.high
    bench.find(f"{css} .noUi-handle").press("ArrowRight" if up else "ArrowLeft")
    return experiment.replace(**{parameter.name: round(value + (step if up else -step), 9)})


def pinned(bench: Bench, parameter: Parameter, before: Experiment) -> Experiment:
    """Pin what is shown, move one control, and take the pin away again; what the bench has to show then."""
    line = bench.find(".lab-pinned-code")
    traces = "bench.querySelector('.js-plotly-plot').data.filter(trace => trace.x?.[0] !== null).length"  # none of the legend's
    alone = bench.element.evaluate(f"bench => {traces}")
    bench.click(".lab-pin")
    after = move(bench, parameter, before)
    settled(bench, after.code())
    assert line.text_content() == f"pinned: {before.code()}"
    both = bench.element.evaluate(f"bench => {traces}")
    assert both > alone, f"{before.code()}: nothing of the pinned picture is left behind the new one"
    bench.click(".lab-pin")
    bench.wait(f"{traces} < a", both)
    assert not line.is_visible()
    return after


def played(bench: Bench, experiment: Experiment, apart: Fresh) -> Experiment:
    """One step forward, or back from the end, where there is something to play; what the bench has to show then."""
    if not bench.find(".lab-transport").is_visible():
        return experiment
    assert bench.find(".lab-says").text_content() or bench.find(".annotation-text"), (
        f"{experiment.code()}: nothing says what happens"
    )
    bench.click(".lab-back" if at_the_end(experiment, apart) else ".lab-forward")
    bench.wait("bench.querySelector('.lab-code').textContent !== a", experiment.code())
    return experiment_of(bench)


def at_the_end(experiment: Experiment, apart: Fresh) -> bool:
    """Whether nothing more can be played."""
    (p,) = (p for p in experiment.parameters() if p.play)
    meta = experiment.figure(apart.result(experiment))["layout"].get("meta") or {}
    return bool(meta.get("ended")) or getattr(experiment, p.name) >= p.high


def lecture(bench: Bench, where: str, faults: list[str]) -> None:
    """Go into lecture mode and note what does not fit, once the picture has taken its place."""
    bench.click(".lab-lecture-switch")
    faults += [f"{where}: {fault}" for fault in bench.element.evaluate(AT_REST)]


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_every_bench_draws_what_the_model_gives_and_fits(open_notebook, notebook):
    nb = open_notebook(notebook)
    complaints: list[str] = []
    nb.page.on("pageerror", lambda error: complaints.append(str(error)))
    nb.page.on("console", lambda said: complaints.append(said.text) if said.text.startswith("WARN:") else None)  # plotly's
    nb.run_all(180_000, lift=False)
    nb.page.wait_for_function(ASKED, timeout=60_000)
    expect(nb.page.locator(".lab-veil:not([hidden]) ~ .lab-picture >> visible=true")).to_have_count(0)
    nb.lift()
    faults: list[str] = []
    for bench in benches_of(nb.page):
        bench.element.scroll_into_view_if_needed()
        settled(bench)
        start = experiment = experiment_of(bench)
        apart = Fresh()
        check(bench, start, apart, notebook, faults)
        if (height := bench.element.bounding_box()["height"]) > HEIGHT:
            faults.append(f"{notebook}: {start.code()}: {height:.0f} px high")
        moved = 0
        for parameter in start.parameters():
            if parameter.name not in experiment.without_effect():
                go = pinned if experiment == start else move
                experiment = go(bench, parameter, experiment)
                moved += 1
                if start.slow and moved % COMPARED:
                    look(bench, experiment, notebook, faults)
                else:
                    check(bench, experiment, apart, notebook, faults)
        check(bench, played(bench, experiment, apart), apart, notebook, faults)
        bench.click(".lab-reset")
        check(bench, start, apart, notebook, faults)
        assert not bench.find(".lab-error")
    for width, height in WINDOWS:
        nb.page.set_viewport_size({"width": width, "height": height})
        for i, bench in enumerate(benches_of(nb.page)):
            lecture(bench, f"{notebook}: bench {i} at {width}x{height}", faults)
            nb.screenshot(f"{notebook[:2]}_{i}_{width}")
            nb.page.keyboard.press("Escape")
    assert set(complaints) <= {IMPATIENT}
    assert not faults, "\n".join(faults)
    nb.as_at_first = True
