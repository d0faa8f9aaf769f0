"""What the README tells an engineer to type runs, one line after the other, in a folder of its own."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from labkit.__main__ import main

ROOT = Path(__file__).parents[1]
LINES = re.findall(r"^    labkit (.*?)(?:\s+#.*)?$", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.M)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "data", made / "data")
    shutil.copytree(ROOT / "notebooks", made / "notebooks", ignore=shutil.ignore_patterns(".ipynb_checkpoints"))
    return made


@pytest.mark.parametrize("line", LINES)
def test_a_line_of_the_readme_runs(line, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(shlex.split(line)) == 0, capsys.readouterr().err
    assert capsys.readouterr().out.strip() or "--out" in line or "--export" in line


@pytest.mark.parametrize("line", re.findall(r"`labkit ([^`]+)`", (ROOT / "data" / "examples" / "README.md").read_text("utf-8")))
def test_a_line_beside_a_sample_runs(line, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(shlex.split(line)) == 0, capsys.readouterr().err
    assert capsys.readouterr().out.strip()


def test_every_row_names_a_sample_and_what_reads_it():
    rows = re.findall(
        r"^\| `(.+?)` \| (.+?) \| (.+?) \|$", (ROOT / "data" / "examples" / "README.md").read_text("utf-8"), flags=re.M
    )
    assert len(rows) == len(list((ROOT / "data" / "examples").iterdir())) - 1
    for name, what, reader in rows:
        assert len(what) > 20 and (f"data/examples/{name}" in reader or "import read_scans`" in reader)


def test_the_samples_are_described_and_all_of_them_are_there():
    text = (ROOT / "data" / "examples" / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.]+\.\w+)`", text)) - {"labkit.fusion"}
    assert named == {path.name for path in (ROOT / "data" / "examples").iterdir()} - {"README.md"}
