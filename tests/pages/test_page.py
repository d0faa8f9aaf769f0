"""A rendered notebook: everything in one file, no address outside, the numbers those of a live bench."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from labkit.__main__ import main
from labkit.pages import render
from labkit.pages.page import _prose

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
MATHML = "{http://www.w3.org/1998/Math/MathML}"
PLAIN = {f"{MATHML}{name}" for name in ("math", "mrow", "mi", "mn", "mo", "mtext", "mspace", "mstyle", "mfrac", "msqrt")}
SCRIPTS = {f"{MATHML}{name}" for name in ("msub", "msup", "msubsup", "munder", "mover", "munderover")}

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
    assert "<msub><mi>R</mi><mi>i</mi></msub><mo>&#x02264;</mo>" in page and "R_i" not in page and "<code>$HOME</code>" in page
    assert "printed &lt;here&gt;" in page and "12345" in page and ">4<" not in own(page)
    assert "How long?" in page and "<li>a week</li>" in page and "13 ms" not in page.split("How long?")[1].split("</div>")[0]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_formula_is_typeset(path):
    """As many pieces of MathML as formulas were written, each well-formed and of elements that browsers know; no TeX is left."""
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "markdown":
            continue
        source = re.sub(r"(`+).+?\1", "", "".join(cell["source"]), flags=re.S)  # in code a dollar is a dollar
        if "$" not in source:
            continue
        page = _prose("".join(cell["source"]), path.parent)
        assert "class='tex'" not in page and "$" not in re.sub(r"<(pre|code).*?</\1>", "", page, flags=re.S)
        formulas = re.findall(r"<math.*?</math>", page, flags=re.S)
        blocks = source.count("$$") // 2
        assert len(formulas) == blocks + (source.count("$") - 4 * blocks) // 2
        for formula in formulas:
            assert {each.tag for each in ElementTree.fromstring(formula).iter()} <= PLAIN | SCRIPTS


def test_a_formula_beyond_the_library_stays_tex():
    page = _prose("$a < \\nosuch{b}$ and $\\left( x$ and $x_1 < y$", Path())
    assert "<code class='tex'>a &lt; \\nosuch{b}</code>" in page and "<code class='tex'>\\left( x</code>" in page
    assert page.count("<math") == 1


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
