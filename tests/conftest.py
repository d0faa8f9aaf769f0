"""The one test session: its order, and what several processes may share of it.

Alone, fast tests come first, then notebooks, then the browser. `make test` has a process more than there are cores, four at
most, since a test in the browser often waits for it: the browser's tests of even and of odd notebooks, the cells of a notebook,
the lines of the README, which read each other's files, the tests of one experiment, which share its run, and those that share a
run of nbval stay together; the rest goes anywhere.
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
    return 2, _number(item.nodeid), item.path.name != "test_every_bench.py"


def _number(nodeid: str) -> str:
    """The number of the notebook that a browser test is about."""
    number = re.search(r"(?<!\d)\d\d(?=[._])", nodeid)
    return number[0] if number else ""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    return min((os.cpu_count() or 1) + 1, 4)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        """The larger groups go out first: notebooks, the browser's tests, experiments."""

        def _split_scope(self, nodeid: str) -> str:
            file, _, test = nodeid.partition("::")
            if file.startswith("tests/browser/"):
                return "even" if int(_number(nodeid) or 1) % 2 == 0 else "odd"
            if file.endswith("/test_every_experiment.py"):
                return test[test.find("[") :]
            return file if file.endswith((".ipynb", "/test_readme.py", "/test_nbval.py")) else nodeid

    return Together(config, log)
