"""What the packages offer by name, and where the published files are found."""

import ast
from pathlib import Path

import pytest

import labkit
import labkit.data
import labkit.experiments

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("package", [labkit, labkit.experiments], ids=lambda package: package.__name__)
def test_every_name_offered_is_there(package):
    assert package.__all__ and set(package.__all__) <= set(dir(package))
    for name in package.__all__:
        assert getattr(package, name) is not None
    taken = {}
    exec(f"from {package.__name__} import *", taken)
    assert set(package.__all__) <= set(taken)


def test_labkit_offers_what_a_notebook_begins_with():
    assert {"explore", "predict", "published", "sweep", "ParameterError", "PriorityInversion"} <= set(dir(labkit))


@pytest.mark.parametrize("package", [labkit, labkit.experiments], ids=lambda package: package.__name__)
def test_a_name_that_is_not_there_is_said_to_be_missing(package):
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'PriorityReversion'"):
        package.PriorityReversion


def test_experiments_exports_every_check():
    written = {
        node.name: path.stem
        for path in (ROOT / "labkit" / "experiments").glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("check_")
    }
    assert len(written) > 15
    offered = {name: home for name, home in labkit.experiments.EXERCISES.items() if name.startswith("check_")}
    assert offered == written


def test_published_files_are_found_in_an_installed_package_first(tmp_path, monkeypatch):
    assert labkit.data.published("xu2025_tasks.csv") == ROOT / "data" / "xu2025_tasks.csv"
    inside = tmp_path / "labkit" / "data_files"
    inside.mkdir(parents=True)
    (inside / "some.csv").write_text("a\n1\n")
    monkeypatch.setattr(labkit.data, "_PACKAGE", tmp_path / "labkit")
    assert labkit.data.published("some.csv") == inside / "some.csv"
    for name in ("other.csv", "../some.csv", ""):
        with pytest.raises(ValueError, match=r"no published file .*; there are some.csv"):
            labkit.data.published(name)
