"""What is installed where: bounds, locks, the conda environment, the wheel, and the commands that use them."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RUNTIME = [Requirement(line) for line in PROJECT["project"]["dependencies"]]
BUILD = [Requirement(line) for line in PROJECT["dependency-groups"]["build"]]
TOOLS = [Requirement(line) for extra in PROJECT["project"]["optional-dependencies"].values() for line in extra]
TOOLS += [Requirement(line) for line in PROJECT["dependency-groups"]["check"]]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def locked(name: str, unmarked: bool = False) -> dict[str, str]:
    """Package -> version; with `unmarked`, only what is installed on every machine."""
    end = r" \\$" if unmarked else ""
    return dict(re.findall(rf"^([a-z0-9.-]+)==(\S+){end}", text(name), flags=re.MULTILINE))


LAB, BEYOND = locked("requirements.lock"), locked("requirements-test.lock")

# --------------------------------------------------------------------------------------------------------------- locks


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-test.lock"])
def test_lock_holds_names_versions_markers_and_hashes_only(name):
    lock = text(name)
    assert "://" not in lock
    entry = r"[a-z0-9.-]+==[\w.+!]+(?: ; [\w. '\"<>=!()]+)?(?: \\\n    --hash=sha256:[0-9a-f]{64})+\n"
    assert re.fullmatch(f"(?:{entry})+", lock), "every entry is name==version, a marker where needed, and its hashes"


@pytest.mark.parametrize("requirement", [*RUNTIME, *BUILD, *TOOLS], ids=str)
def test_lock_meets_every_requirement_of_the_project(requirement):
    lock = LAB | BEYOND if requirement in TOOLS else LAB
    version = lock.get(canonicalize_name(requirement.name), "none")
    assert version != "none" and requirement.specifier.contains(version), f"locked: {version}; run `make lock`"


def test_what_builds_the_lab_is_in_the_environment():
    assert set(PROJECT["build-system"]["requires"]) <= set(PROJECT["dependency-groups"]["build"])


def test_the_lab_is_installed_without_the_test_tools():
    tools = {canonicalize_name(tool.name) for tool in TOOLS} - {"packaging", "pyyaml"}  # JupyterLab needs these two
    assert tools.isdisjoint(LAB)
    assert tools <= set(BEYOND)


def test_the_second_lock_only_adds_to_the_first():
    assert set(BEYOND).isdisjoint(locked("requirements.lock", unmarked=True))
    assert {name: version for name, version in BEYOND.items() if LAB.get(name, version) != version} == {}


# -------------------------------------------------------------------------------------------------------------- bounds


def bounded(specifier: str) -> bool:
    """Does it have a lower and an upper bound?"""
    return {clause.operator for clause in SpecifierSet(specifier)} == {">=", "<"}


@pytest.mark.parametrize("requirement", RUNTIME, ids=str)
def test_every_package_of_the_lab_has_both_bounds(requirement):
    assert bounded(str(requirement.specifier))


def test_conda_environment_names_python_and_pip_with_bounds_and_takes_the_rest_from_pyproject():
    environment = yaml.safe_load(text("environment.yml"))
    assert set(environment) == {"name", "channels", "dependencies"}
    assert environment["channels"] == ["conda-forge"]
    *conda, pip = environment["dependencies"]
    assert pip == {"pip": ["-e ."]}
    specs = [re.fullmatch(r"([a-z0-9_.-]+)((?:(?:>=|<)\d+(?:\.\d+)*,?)+)", spec) for spec in conda]  # conda: no blank, no ~=
    assert all(specs), conda
    bounds = {spec[1]: spec[2] for spec in specs}
    assert set(bounds) == {"python", "pip"}
    assert bounds["python"] == PROJECT["project"]["requires-python"]
    assert all(map(bounded, bounds.values()))


def test_make_refuses_the_same_pythons_as_pyproject():
    low, high = re.search(r"not \(3, (\d+)\) <= sys.version_info < \(3, (\d+)\)", text("Makefile")).groups()
    assert PROJECT["project"]["requires-python"] == f">=3.{low},<3.{high}"
    said = re.findall(r"3\.(\d+) to 3\.(\d+)", text("Makefile") + text("README.md"))
    assert len(said) == 3 and set(said) == {(low, str(int(high) - 1))}


# --------------------------------------------------------------------------------------------------------------- wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The folder of an unpacked wheel, built with the locked tools and no network."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=ROOT, check=True)
    (built,) = folder.glob("*.whl")
    with zipfile.ZipFile(built) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"


def files(folder: Path, *suffixes: str) -> set[str]:
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path.as_posix() for path in found if "__pycache__" not in path.parts and path.suffix in (suffixes or [path.suffix])}


def test_wheel_holds_the_package_and_the_published_files(wheel):
    assert files(ROOT / "labkit", ".py", ".js", ".css", ".typed") <= files(wheel / "labkit")
    assert "py.typed" in files(wheel / "labkit")
    assert files(wheel / "labkit" / "data_files") == files(ROOT / "data")
    assert {path.name for path in wheel.iterdir() if not path.name.endswith(".dist-info")} == {"labkit"}


def run(wheel: Path, *arguments: str) -> str:
    """Output of a Python that sees the wheel before the checkout, from a folder that is neither."""
    command = subprocess.run(
        [sys.executable, *arguments],
        cwd=wheel.parent,
        env={"PYTHONPATH": str(wheel)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert command.returncode == 0, command.stderr
    return command.stdout


def test_wheel_works_alone(wheel):
    name = "xu2025_tasks.csv"
    read = f"import labkit as l; print(l.__file__, l.published({name!r}), len(l.published_table({name!r})))"
    package, table, rows = run(wheel, "-c", read).split()
    assert Path(package).is_relative_to(wheel) and Path(table).is_relative_to(wheel) and int(rows) > 0
    assert "priority-inversion" in run(wheel, "-m", "labkit", "list")
    assert PROJECT["project"]["version"] in run(wheel, "-m", "labkit", "--version")


# ------------------------------------------------------------------------------------------------------------ commands


def targets() -> set[str]:
    return set(re.search(r"^\.PHONY: (.*)", text("Makefile"), flags=re.MULTILINE)[1].split())


def test_make_help_lists_every_command():
    said = subprocess.run(["make", "--no-print-directory", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"^make (\w+)", said, flags=re.MULTILINE)) == targets() - {"help"}


@pytest.mark.parametrize("page", ["README.md", ".ci/run"])
def test_every_command_named_elsewhere_exists(page):
    named = set(re.findall(r"(?:^|`|exec )\s*make ([a-z]+)", text(page), flags=re.MULTILINE))
    assert named and named <= targets()


def test_every_test_stands_behind_the_check():
    assert re.findall(r"^(?:exec )?make (\w+)$", text(".ci/run"), flags=re.MULTILINE) == ["check", "test"]
