"""Order of the one test session: fast tests, then notebooks, then the browser.

Browser tests come last because Playwright keeps an event loop in this thread, in which nothing else can start one.
"""

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: 2 if item.get_closest_marker("browser") else item.path.suffix == ".ipynb")
