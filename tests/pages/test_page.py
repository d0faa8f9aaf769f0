"""A rendered notebook: everything in one file, no address outside, the numbers those of a live bench."""

import json
import re

import pytest

from labkit.__main__ import main
from labkit.pages import render

NOTEBOOK = [
    (
        "markdown",
        "# A title\nThe bound is $R_i \\le D_i$, not `$HOME`. See [a paper](https://example.org/x) and [02](02_x.ipynb).",
    ),
    ("code", "from labkit import PriorityInversion, explore, predict"),
    ("code", "explore(PriorityInversion, hold=8)"),
    ("code", "predict('How long?', PriorityInversion(), 'H blocked, semaphore', ['a week', 'a day'])"),
    ("code", "import pandas as pd\nprint('printed <here>')\npd.DataFrame({'x': [12345]})"),
    ("code", "2 + 2;"),
]


def notebook(path, cells=NOTEBOOK):
    made = [{"cell_type": kind, "source": source.splitlines(keepends=True)} for kind, source in cells]
    path.write_text(json.dumps({"cells": made}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    assert render(notebook(folder / "n.ipynb"), folder / "n.html") == 1
    return (folder / "n.html").read_text(encoding="utf-8")


def own(page):
    """The page without plotly's code, in which the addresses of map services stand as texts that nothing here asks for."""
    scripts = re.findall(r"<script>.*?</script>", page, flags=re.S)
    assert len(max(scripts, key=len)) > 1_000_000 and sum("plotly.js v" in script for script in scripts) == 1  # embedded once
    return page.replace(max(scripts, key=len), "")


def test_no_address_outside(page):
    assert not re.findall(
        r"""(?:src|href|action|data)\s*=\s*["']?\s*(?:https?:)?//|@import|url\(|import\s*\(|import .* from""", own(page)
    )
    assert "a paper (https://example.org/x)" in page and 'href="02_x.html"' in page


def test_every_bench_has_its_picture_and_its_numbers(page):
    spec = json.loads(re.search(r"id='spec0'>(.*?)</script>", page, flags=re.S)[1])
    assert spec["data"] and spec["layout"]["xaxis"]
    from labkit import PriorityInversion

    bench = PriorityInversion(hold=8)
    for metric in bench.metrics(bench.run()):
        assert f"<b>{metric.text()}</b><i>{metric.name}</i>" in page
    assert "PriorityInversion(hold=8)" in page and "With a running kernel these move: " in page and "1 to 15 ms" in page


def test_prose_code_and_outputs(page):
    assert "<span class='tex'>R_i \\le D_i</span>" in page and "<code>$HOME</code>" in page
    assert "printed &lt;here&gt;" in page and "12345" in page and ">4<" not in own(page)
    assert "How long?" in page and "<li>a week</li>" in page and "13 ms" not in page.split("How long?")[1].split("</div>")[0]


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([("code", "1 / 0")], "code cell 1: ZeroDivisionError: division by zero"),
        ([("code", "x = 1"), ("code", "def")], "code cell 2: SyntaxError"),
    ],
)
def test_a_cell_that_fails_is_named(cells, message, tmp_path, capsys):
    assert main(["render", str(notebook(tmp_path / "n.ipynb", cells)), "--out", str(tmp_path / "n.html")]) == 1
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1 and not (tmp_path / "n.html").exists()


@pytest.mark.parametrize(
    ("text", "message"), [("{}", "is no notebook"), ("[", "is not JSON"), ('{"cells": [1]}', "is no notebook")]
)
def test_what_is_no_notebook_is_told(text, message, tmp_path, capsys):
    (tmp_path / "n.ipynb").write_text(text)
    assert main(["render", str(tmp_path / "n.ipynb"), "--out", str(tmp_path / "n.html")]) == 1
    assert message in capsys.readouterr().err
    assert main(["render", str(tmp_path / "none.ipynb"), "--out", str(tmp_path / "n.html")]) == 1
    assert capsys.readouterr().err.endswith("none.ipynb: No such file or directory\n")
