"""One picture per notebook for the README, drawn by Chromium from the experiments themselves: `make stills`. Needs no network."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import labkit
from labkit.bench.plot import pack
from tests.browser.conftest import FLAGS, chromium_path

FOLDER = Path(__file__).parents[2] / "notebooks" / "stills"
WIDTH = 1100

#: Number of the notebook -> an experiment of it in a telling position.
STILLS = {
    "00": ("ThreeTasks", {"pose_work": 12}),
    "01": ("PriorityInversion", {"at": 6}),
    "02": ("CacheMap", {}),
    "03": ("DmaCoherence", {"step": 8}),
    "04": ("SinkStory", {"step": 5}),
    "05": ("TickRates", {}),
    "06": ("RateCurves", {}),
    "07": ("Schedules", {}),
    "08": ("SixDesigns", {}),
    "09": ("TimestampDrift", {}),
    "10": ("OneLoss", {}),
    "11": ("LaserPipeline", {}),
    "12": ("TwoStations", {}),
    "13": ("DistributedFusion", {}),
}
DRAW = """async ([figure, width]) => {
    const draws = ({ showlegend, x }) => showlegend !== false || x === undefined || x.length > 0;
    const layout = { ...figure.layout, font: { size: 15, ...figure.layout.font }, width };
    await Plotly.newPlot('picture', figure.data.filter(draws), layout, { staticPlot: true }) }"""


def plain(value: object) -> object:
    """Arrays as lists: there is no kernel here that could send buffers."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, list | tuple) else pack(value, [])


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    spec = importlib.util.find_spec("plotly")
    assert spec is not None and spec.origin is not None, "plotly is a dependency"
    code = (Path(spec.origin).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        page = browser.new_page(viewport={"width": WIDTH, "height": 900})
        page.set_content("<body style='margin:0;background:white'><div id='picture'></div></body>")
        page.add_script_tag(content=code)
        for number, (name, values) in STILLS.items():
            experiment = getattr(labkit, name)(**values)
            figure = json.loads(json.dumps(plain(experiment.figure(experiment.run()))))
            page.evaluate(DRAW, [figure, WIDTH])
            page.locator("#picture .svg-container").screenshot(path=FOLDER / f"{number}.png")
        browser.close()


if __name__ == "__main__":
    main()
