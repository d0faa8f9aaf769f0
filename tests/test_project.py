"""What holds for the project as a whole: its floors, its files, its notebooks' form."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
MODULES = sorted(path.relative_to(ROOT) for path in (ROOT / "labkit").rglob("*.py"))
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))

# ---------------------------------------------------------------------------------------------------- floors of labkit

#: Part of labkit -> its floor. Imports go down, or stay inside the part; a new part gets its line here.
FLOOR = {
    "checks": -2,
    "outside": -1,  # what every reader stands on
    "trace": 0,
    "experiment": 0,
    "data": 0,
    "server": 0,  # loaded by the Jupyter server, without the lab
    "workcopy": 0,  # run by `make lab` before it
    "sweeping": 1,
    "scheduler": 1,
    "cache": 1,
    "sink": 1,
    "fusion": 1,
    "network": 1,
    "kernel": 2,
    "phases": 3,
    "robot": 3,
    "figures": 4,
    "experiments": 5,
    "bench": 6,
    "pages": 7,
    "commands": 8,
    "__main__": 9,
    "labkit": 10,  # the package's own __init__, which names everything and imports it when asked
}
MODELS = ["scheduler", "cache", "sink", "fusion", "network", "kernel", "phases", "robot"]
#: Standing on the ground: the contract knows no other part, and models know nothing of experiments.
STRANGERS = {(part, "experiment") for part in [*MODELS, "trace", "figures"]} | {
    ("bench", part) for part in [*MODELS, "trace", "figures", "experiments"]
}
#: Third-party module -> the declared dependency that brings it.
BROUGHT_BY = {
    "IPython": "ipywidgets",
    "annotated_types": "annotated-types",
    "jupyter_server": "jupyter-server",
    "nbconvert": "jupyterlab",
    "typing_extensions": "typing-extensions",
}
HEAVY = {"pandas", "scipy", "plotly", "ipywidgets", "filterpy", "matplotlib", "IPython"}


def part(module: str) -> str:
    """`labkit.kernel.kernel` -> `kernel`; the package itself is `labkit`."""
    return [*module.split("."), "labkit"][1] if "." in module else "labkit"


@cache
def is_module(name: str) -> bool:
    path = ROOT / Path(*name.split("."))
    return path.with_suffix(".py").exists() or path.is_dir()


@cache
def statements(path: Path) -> list[tuple[ast.Import | ast.ImportFrom, bool, bool]]:
    """Every import, whether it loads with the file, and whether only a type checker reads it."""

    def walk(node: ast.AST, at_once: bool, typing: bool) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import | ast.ImportFrom):
                yield child, at_once and not typing, typing
            elif isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):  # an expression holds no import
                later = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
                checked = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
                yield from walk(child, at_once and not later, typing or checked)

    return list(walk(ast.parse(path.read_text(encoding="utf-8")), True, False))


def imports(path: Path, types: bool = True) -> Iterator[tuple[str, int, bool]]:
    """Every imported module, its line, and whether it loads with the file; with `types`, what only a type checker reads too."""
    package = ".".join(path.with_suffix("").parts[:-1])
    for node, at_once, typing in statements(ROOT / path):
        if typing and not types:
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno, at_once) for alias in node.names)
        else:
            outer = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(filter(None, (outer, node.module)))
            inner = [alias.name for alias in node.names if base == "labkit" or is_module(f"{base}.{alias.name}")]
            yield from ((f"{base}.{name}", node.lineno, at_once) for name in inner)  # from labkit.kernel import services
            if len(inner) < len(node.names):
                yield base, node.lineno, at_once


def home(path: Path) -> str:
    return part(".".join(path.with_suffix("").parts[:2])) if path != Path("labkit/__init__.py") else "labkit"


def test_imports_go_down_only():
    for path in MODULES:
        here = home(path)
        assert here in FLOOR, f"{path}: put {here!r} on a floor in this file"
        for module, line, _ in imports(path):
            there = part(module)
            if module.split(".")[0] != "labkit" or there == here:
                continue
            assert there in FLOOR, f"{path}:{line}: labkit has no part {there!r}"
            assert FLOOR[there] < FLOOR[here], (
                f"{path}:{line}: {here} (floor {FLOOR[here]}) imports {there} (floor {FLOOR[there]})"
            )
            assert (here, there) not in STRANGERS, f"{path}:{line}: {here} knows nothing of {there}"


def deep(module: str) -> bool:
    """Whether the module lies within a room of labkit: `labkit.trace.folds` does, `labkit.trace` and `labkit.data` do not."""
    return module.count(".") > 1 and module.startswith("labkit.")


def test_a_room_is_entered_by_its_door():
    """What a room offers stands in its __init__; nobody outside imports deeper."""
    for path in MODULES:
        for node, *_ in statements(ROOT / path):
            named = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            named += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for module in named:
                inside = not deep(module) or part(module) == home(path)
                assert inside, f"{path}:{node.lineno}: import from labkit.{part(module)}, and add the name to its __init__"


def test_no_module_imports_itself_around_a_corner():
    """Circles, imports inside functions included; what only a type checker reads is none."""
    names = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in MODULES}
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        wanted = {module for module, _, _ in imports(path, types=False)}
        graph[name] = {module for module in wanted if module in names and module != name and not name.startswith(module + ".")}
    done: set[str] = set()

    def visit(name: str, above: tuple[str, ...]) -> None:
        assert name not in above, " -> ".join([*above[above.index(name) :], name])
        if name not in done:
            for module in sorted(graph[name]):
                visit(module, (*above, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def test_pictures_and_widgets_stay_upstairs_and_heavy_packages_wait():
    for path in MODULES:
        here = home(path)
        for module, line, at_once in imports(path):
            top = module.split(".")[0]
            if top in ("ipywidgets", "anywidget", "IPython"):
                assert here == "bench", f"{path}:{line}: only the bench knows widgets"
            assert top != "jupyter_server" or here == "server", f"{path}:{line}: only labkit.server knows the Jupyter server"
            if top == "plotly":
                assert FLOOR[here] >= FLOOR["figures"], f"{path}:{line}: {here} draws nothing"
                assert module != "plotly.express", f"{path}:{line}: plotly.express costs every start a quarter of a second"
            if at_once and top in HEAVY:
                assert here in ("bench", "figures"), f"{path}:{line}: import {top} in the function that needs it"


def test_every_foreign_import_is_a_declared_dependency():
    """What loads with its module must be a dependency; what a function loads may also come from an extra."""
    project = PROJECT["project"]
    extras = [line for extra in project["optional-dependencies"].values() for line in extra]
    for path in MODULES:
        for module, line, at_once in imports(path):
            top = module.split(".")[0]
            if top != "labkit" and top not in sys.stdlib_module_names:
                declared = project["dependencies"] + ([] if at_once else extras)
                names = {re.match(r"[\w-]+", requirement)[0] for requirement in declared}
                assert BROUGHT_BY.get(top, top) in names, f"{path}:{line}: {top} is not in pyproject.toml"


def test_the_floor_test_sees_what_it_must(tmp_path):
    """The import reader itself: relative, nested, deferred and type-only imports."""
    code = "\n".join(
        [
            "import numpy, labkit.trace",
            "from ..trace import Trace",
            "from . import rta",
            "from labkit import cache",
            "if TYPE_CHECKING:",
            "    import pandas",
            "class A:",
            "    def f(self):",
            "        import scipy.stats",
        ]
    )
    (tmp_path / "labkit").mkdir()
    (tmp_path / "labkit" / "kernel.py").write_text(code, encoding="utf-8")
    path = Path("labkit/kernel/kernel.py")
    (tmp_path / path).parent.mkdir()
    (tmp_path / path).write_text(code, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "ROOT", tmp_path)
        found = list(imports(path))
    assert [(module, at_once) for module, _, at_once in found] == [
        ("numpy", True),
        ("labkit.trace", True),
        ("labkit.trace", True),
        ("labkit.kernel", True),
        ("labkit.cache", True),
        ("pandas", False),
        ("scipy.stats", False),
    ]
    assert home(path) == "kernel" and part("labkit.trace.kinds") == "trace" and part("labkit") == "labkit"


def test_import_of_labkit_brings_nothing_heavy():
    code = "import labkit, sys; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "labkit" in loaded
    assert HEAVY.isdisjoint(loaded)


@pytest.mark.parametrize(
    "room", ["trace", *(model for model in MODELS if (ROOT / "labkit" / model).is_dir()), "figures", "experiments"]
)
def test_import_of_a_room_brings_nothing_heavy(room):
    code = f"import labkit.{room}, sys; print(*sorted({{name.split('.')[0] for name in sys.modules}}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert HEAVY.isdisjoint(loaded)


# --------------------------------------------------------------------------------------------------------------- files


def committed() -> list[str]:
    """Paths of the committed files; skips the test where the lab was unpacked without its history."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout, so there is no list of committed files")
    run = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in run.stdout.split("\0") if name and (ROOT / name).exists()]


def test_top_level_holds_only_what_belongs_there():
    allowed = {"notebooks", "labkit", "data", "tests", "environment.yml", "README.md", "pyproject.toml"}
    allowed |= {"requirements.lock", "requirements-test.lock", "Makefile", "LICENSE", ".ci", ".github", ".gitignore"}
    assert {name.split("/")[0] for name in committed()} <= allowed


def test_no_machine_path_and_no_registry_host_is_committed():
    wrong = re.compile(r"(?<![\w.~/-])/(?:home|root|Users|work|mnt|opt)/\w|\b(?:pypi|pythonhosted|npmjs)\.\w|\w://\w+:\w+@")
    found = []
    for name in committed():
        data = (ROOT / name).read_bytes()
        if b"\0" not in data:
            lines = data.decode("utf-8").splitlines()
            found += [f"{name}:{n}: {line.strip()[:100]}" for n, line in enumerate(lines, start=1) if wrong.search(line)]
    assert [line for line in found if "wrong = re.compile" not in line] == []


# ----------------------------------------------------------------------------------------------------------- notebooks


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


def test_notebooks_have_a_number_each_and_begin_at_the_start():
    names = [path.name for path in NOTEBOOKS]
    assert names and names[0] == "00_start_here.ipynb"
    assert all(re.fullmatch(r"\d\d_[a-z0-9_]+\.ipynb", name) for name in names)
    assert len({name[:2] for name in names}) == len(names), "two notebooks share a number"


@pytest.mark.parametrize("page", ["README.md", "notebooks/00_start_here.ipynb"])
def test_the_map_has_every_notebook(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    missing = [path.name for path in NOTEBOOKS if path.name not in text and path.name != Path(page).name]
    assert not missing


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_stores_no_state_and_no_picture(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert "widgets" not in notebook["metadata"]
    assert notebook["metadata"].get("kernelspec", {}).get("name") == "python3"
    for number, cell in enumerate(cells(path, "code"), start=1):
        where = f"{path.name}, code cell {number}"
        compared = "NBVAL_CHECK_OUTPUT" in "".join(cell["source"])  # nbval compares only a cell that counts as run
        assert compared == bool(cell["outputs"]), f"{where}: an output is stored if and only if nbval compares it"
        assert cell["execution_count"] == (1 if compared else None), f"{where}: run `make notebooks`"
        for output in cell["outputs"]:
            assert output["output_type"] in ("stream", "execute_result", "display_data"), f"{where} stores an error"
            assert set(output.get("data", {"text/plain": ""})) == {"text/plain"}, f"{where} stores more than text"
        assert len(json.dumps(cell["outputs"])) < 4000, f"{where} stores a long output"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_imports_from_labkit_and_its_rooms_only(path):
    source = "\n".join("".join(cell["source"]) for cell in cells(path, "code"))
    found = re.findall(r"^\s*(?:from|import)\s+(labkit[\w.]*)", source, flags=re.M)
    assert found and not [module for module in found if deep(module)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_prose_and_short_cells(path):
    code = ["".join(cell["source"]) for cell in cells(path, "code")]
    assert code[0].startswith("from labkit import")
    for number, source in enumerate(code, start=1):
        where = f"{path.name}, code cell {number}"
        assert source.count("\n") < 15, f"{where} is longer than 15 lines"
        assert not re.search(r"^\s*(class|global)\s|\.observe\(", source, flags=re.M), f"{where}: this belongs into labkit"
        assert not re.search(r"NBVAL_(IGNORE|SKIP|RAISES)", source), f"{where} hides from the tests"
    first = "".join(cells(path, "markdown")[0]["source"]).splitlines()[0]
    assert first.startswith("# "), f"{path.name} has no title"
