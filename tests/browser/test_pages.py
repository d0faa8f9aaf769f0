"""Rendered notebooks in Chromium with the network off: every picture is drawn and nothing is asked for."""

from pathlib import Path

import pytest

from labkit.pages import render

pytestmark = pytest.mark.browser
NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_page_draws_every_picture_offline(path, chromium, tmp_path):
    count = render(path, tmp_path / "page.html")
    page = chromium.new_page(viewport={"width": 1600, "height": 900})
    page.context.set_offline(True)
    asked, failed = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: failed.append(str(error)))
    page.goto((tmp_path / "page.html").as_uri())
    plots = page.locator(".plot")
    assert plots.count() == count > 0
    for at in range(count):
        plots.nth(at).scroll_into_view_if_needed()
        plots.nth(at).locator("svg.main-svg").first.wait_for(timeout=30_000)
    assert not failed and not [url for url in asked if not url.startswith(("file:", "data:", "blob:"))]
    page.close()
