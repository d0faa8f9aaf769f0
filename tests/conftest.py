"""Order of the one test session: fast tests, then notebooks, then the browser.

Browser tests come last because Playwright keeps an event loop in this thread, in which nothing else can start one.
"""

import os

import hypothesis
import pytest

if "CI" not in os.environ:  # there hypothesis chooses its own settings: the same examples every time, no deadline
    hypothesis.settings.register_profile("lab", deadline=None)  # a busy machine is no defect
    hypothesis.settings.load_profile("lab")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: 2 if item.get_closest_marker("browser") else item.path.suffix == ".ipynb")
