"""The copies that `make lab` opens: nothing anybody wrote is ever overwritten."""

import subprocess
import sys

import pytest

from labkit.workcopy import KNOWN, update


@pytest.fixture
def folders(tmp_path):
    source, copies = tmp_path / "notebooks", tmp_path / "mine" / "deep"
    source.mkdir()
    for name in ("00.ipynb", "01.ipynb", "lab.png"):
        (source / name).write_text(f"{name}, first version")
    update(source, copies)
    return source, copies


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.name != KNOWN}


def test_a_second_time_changes_nothing(folders):
    source, copies = folders
    assert contents(copies) == contents(source)
    assert update(source, copies) == [] and contents(copies) == contents(source)


def test_what_is_missing_comes_back(folders):
    source, copies = folders
    (copies / "01.ipynb").unlink()
    assert [said.split("/")[-1] for said in update(source, copies)] == ["01.ipynb: copied"]


def test_an_update_replaces_what_nobody_changed_and_is_laid_beside_what_somebody_did(folders):
    source, copies = folders
    (copies / "00.ipynb").write_text("work of hours")
    for name in ("00.ipynb", "01.ipynb"):
        (source / name).write_text(f"{name}, second version")
    said = update(source, copies)
    assert len(said) == 2 and "holds changes of yours" in said[0] and "replaced" in said[1]
    assert contents(copies) == {
        "00.ipynb": "work of hours",
        "00.new.ipynb": "00.ipynb, second version",
        "01.ipynb": "01.ipynb, second version",
        "lab.png": "lab.png, first version",
    }
    assert update(source, copies) == []  # offered once
    (source / "00.ipynb").write_text("third version")
    update(source, copies)
    assert contents(copies)["00.new2.ipynb"] == "third version" and contents(copies)["00.ipynb"] == "work of hours"


@pytest.mark.parametrize("damage", ["", "[1]", "{"])
def test_without_its_memory_every_difference_is_somebodys_work(folders, damage):
    source, copies = folders
    (copies / KNOWN).write_text(damage)
    (source / "00.ipynb").write_text("second version")
    update(source, copies)
    assert contents(copies)["00.ipynb"] == "00.ipynb, first version" and contents(copies)["00.new.ipynb"] == "second version"


def test_it_runs_as_a_command_and_says_what_it_did(folders, tmp_path):
    source, _ = folders
    command = [sys.executable, "-m", "labkit.workcopy", str(source), str(tmp_path / "other")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.count(": copied\n") == 3
