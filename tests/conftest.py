"""The one test session: its order, and what several processes may share of it.

Alone, fast tests come first, then notebooks, then the browser. `make test` has a process per core: all browser tests run in one
of them (two JupyterLabs and two Chromiums would wait for each other), the cells of a notebook stay together, and so do the tests
of one experiment, which share its run; the rest goes anywhere.
"""

import os
import re

import hypothesis
import pytest

if "CI" not in os.environ:  # there hypothesis chooses its own settings: the same examples every time, no deadline
    hypothesis.settings.register_profile("lab", deadline=None)  # a busy machine is no defect
    hypothesis.settings.load_profile("lab")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=_place)


def _place(item: pytest.Item) -> tuple[int, str, bool]:
    """Its third of the session; there, the browser's tests of a notebook stand together, that of all its benches first."""
    if not item.get_closest_marker("browser"):
        return int(item.path.suffix == ".ipynb"), "", False
    number = re.search(r"(?<!\d)\d\d(?=[._])", item.nodeid)
    return 2, number[0] if number else "", item.path.name != "test_every_bench.py"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        """The largest group goes out first, which is the browser's."""

        def _split_scope(self, nodeid: str) -> str:
            file, _, test = nodeid.partition("::")
            if file.startswith("tests/browser/"):
                return "browser"
            if file.endswith("/test_every_experiment.py"):
                return test[test.find("[") :]
            return file if file.endswith(".ipynb") else nodeid

    return Together(config, log)
