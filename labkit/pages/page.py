"""The page: prose, code, and every bench with its default picture, which can be zoomed and read without a kernel."""

from __future__ import annotations

import base64
import html
import json
import mimetypes
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.outside import read_json
from labkit.pages.cells import inside, run_cells

if TYPE_CHECKING:
    from labkit.bench import Bench

HERE = Path(__file__).parent

_OUTSIDE = re.compile(r"<a\s[^>]*?href=[\"'](https?://[^\"']*)[\"'][^>]*>(.*?)</a>", re.S)
_NOTEBOOK = re.compile(r"(<a\s[^>]*?href=[\"'])([^\"':/]+)\.ipynb([\"'#])")
_ANCHOR = re.compile(r"<a class=\"anchor-link\".*?</a>", re.S)
_IMAGE = re.compile(r"(<img\s[^>]*?src=[\"'])([^\"']+)([\"'])")
_CODE = re.compile(r"(<pre.*?</pre>|<code.*?</code>)", re.S)
_TEX = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.S)


def render(notebook: str | os.PathLike[str], target: str | os.PathLike[str]) -> int:
    """Run a notebook and write it as one HTML file without any address outside; formulas are typeset by the browser.

    Args:
        notebook: path of an .ipynb file. Its cells run here: render only notebooks that you would run.
        target: path of the HTML file.

    Returns:
        how many benches are in it.

    Raises:
        ValueError: not a notebook, or a cell fails. OSError: a file cannot be read or written.
    """
    path = Path(notebook)
    data = read_json(path)
    cells = data.get("cells") if isinstance(data, dict) else None
    if not isinstance(cells, list) or not all(isinstance(cell, dict) and "cell_type" in cell for cell in cells):
        raise ValueError(f"{path} is no notebook: it has no list of cells")
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    with inside(path.parent):
        shown = iter([list(each.pieces) for each in run_cells(sources, path.name)])
        parts, benches = [], 0
        for cell in cells:
            source = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(f"<section>{_prose(source, path.parent)}</section>")
            elif cell["cell_type"] == "code":
                parts.append(f"<details class='code'{_open(source)}><summary>Python</summary>{_code(source)}</details>")
                for piece in next(shown):
                    parts.append(piece if isinstance(piece, str) else _bench(piece, benches))
                    benches += not isinstance(piece, str)
    Path(target).write_text(_page(path.stem, "\n".join(parts)), encoding="utf-8")
    return benches


def _page(title: str, body: str) -> str:
    import plotly

    script = (Path(plotly.__file__).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    style, draw = (HERE / name for name in ("page.css", "page.js"))
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{html.escape(title)}</title>\n<style>{style.read_text()}</style>\n"
        f"<script>{script.replace('</script', '<' + chr(92) + '/script')}</script></head>\n"
        f"<body><main>\n{body}\n</main>\n<script>{draw.read_text()}</script></body></html>\n"
    )


def _open(source: str) -> str:
    """A cell that builds a model is shown; one that only opens a bench or asks is folded."""
    return "" if re.match(r"\s*(explore|predict|guesses|from labkit import)\b", source) else " open"


def _prose(source: str, folder: Path) -> str:
    from nbconvert.filters import markdown2html_mistune

    text = _ANCHOR.sub("", markdown2html_mistune(source))
    text = _OUTSIDE.sub(lambda link: f"{link[2]} ({link[1]})" if link[1] not in link[2] else link[2], text)
    text = _NOTEBOOK.sub(r"\1\2.html\3", text)
    text = _IMAGE.sub(lambda image: f"{image[1]}{_embedded(image[2], folder)}{image[3]}", text)
    parts = _CODE.split(text)  # every other one is code, in which a dollar is a dollar
    return "".join(part if at % 2 else _TEX.sub(_typeset, part) for at, part in enumerate(parts))


def _typeset(formula: re.Match[str]) -> str:
    """A formula as MathML, which browsers draw themselves; one with a command unknown to the library stays TeX, to be read so."""
    from latex2mathml.converter import convert

    kind, text = ("block", formula[1]) if formula[1] else ("inline", formula[2])
    try:
        made = str(convert(html.unescape(text), display=kind))
    except Exception:  # the library's own errors have no common parent, and malformed TeX also ends in others
        made = "\\"
    return f"<code class='tex'>{text}</code>" if "\\" in made else made


def _embedded(address: str, folder: Path) -> str:
    """An image as data; one from outside is left out."""
    if address.startswith("data:"):
        return address
    path = folder / address
    if "://" in address or not path.is_file():
        return "data:,"
    kind = mimetypes.guess_type(path.name)[0] or "image/png"
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _code(source: str) -> str:
    from nbconvert.filters import Highlight2HTML

    return str(Highlight2HTML()(source, language="ipython3"))


def _bench(bench: Bench, number: int) -> str:
    """The picture of a bench, its cards, its line of code, and what moves with a kernel."""
    bench.wait()
    if bench.error or (not bench.spec["data"] and not bench.metrics):
        raise ValueError(f"{bench.experiment.name()}: {bench.error or 'it shows nothing'}")
    cards = []
    for m in bench.metrics:
        beside = [
            f"{word} {type(m)('', value, m.unit).text()}"
            for word, value in (("bound", m.bound), ("published", m.published))
            if value is not None
        ]
        mark = "" if m.good is None else " good" if m.good else " bad"
        words = f"<b>{html.escape(m.text())}</b><i>{html.escape(m.name)}</i>"
        cards.append(
            f"<div class='card{mark}'>{words}<small>{html.escape('; '.join([*beside, m.note]).strip('; '))}</small></div>"
        )
    rows = "".join(
        f"<tr><td>{html.escape(p.label)}</td><td>{html.escape(str(getattr(bench.experiment, p.name)))}</td>"
        f"<td>{html.escape(p.doc)} ({html.escape(p.allowed())})</td></tr>"
        for p in bench.experiment.parameters()
    )
    names = html.escape(", ".join(p.label for p in bench.experiment.parameters()))
    spec = json.dumps(_plain(bench.spec), allow_nan=False).replace("<", "\\u003c")
    height = bench.spec["layout"].get("height", 450)
    says = html.escape((bench.spec["layout"].get("meta") or {}).get("says", ""))
    return (
        f"<figure class='bench'><p class='says'>{says}</p><div class='plot' id='plot{number}' style='height:{height}px'></div>"
        f"<script type='application/json' id='spec{number}'>{spec}</script>"
        f"<div class='cards'>{''.join(cards)}</div><code class='line'>{html.escape(bench.experiment.code())}</code>"
        f"<details class='live'><summary>With a running kernel these move: {names}</summary>"
        f"<table>{rows}</table></details></figure>"
    )


def _plain(value: Any) -> Any:
    """A figure as JSON: arrays as lists, what is not finite as null."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
