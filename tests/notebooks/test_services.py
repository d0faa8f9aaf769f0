"""The page of the kernel's services is what its generator writes, and its examples use every call of the table."""

import ast
import runpy

import nbformat
import pytest

from tests.notebooks.make_services import EXAMPLES, PAGE, examples, groups, page


def used(code: str) -> set[str]:
    """The requests and calls made in it, such as `os.take` and `isr.give`."""
    attributes = (node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute))
    return {f"{a.value.id}.{a.attr}" for a in attributes if isinstance(a.value, ast.Name) and a.value.id in ("os", "isr")}


def test_the_stored_page_is_what_the_generator_writes():
    assert PAGE.read_text(encoding="utf-8") == nbformat.writes(page()) + "\n", "run tests/notebooks/make_services.py"


def test_every_group_has_its_file_and_every_file_its_group():
    assert sorted(group.file for group in groups()) == sorted(EXAMPLES.glob("*.py"))
    assert len({call for group in groups() for call in group.calls}) == sum(len(group.calls) for group in groups()) > 60


@pytest.mark.parametrize("group", groups(), ids=lambda group: group.name)
def test_the_examples_use_every_call_of_their_rows(group):
    assert group.calls and group.calls <= used("\n".join(code for _, code in examples(group.file)[1]))


@pytest.mark.parametrize("group", groups(), ids=lambda group: group.name)
def test_an_example_is_short_and_runs_by_itself(group, capsys):
    about, cells = examples(group.file)
    assert about.endswith(".") and cells
    for sentence, code in cells:
        assert sentence.endswith(".") and len(code.splitlines()) <= 20 and "print(" in code
    runpy.run_path(str(group.file))
    assert len(capsys.readouterr().out.splitlines()) >= len(cells)


def test_nbval_compares_what_every_example_prints():
    stored = [cell for cell in nbformat.read(PAGE, as_version=4).cells if cell.cell_type == "code"][1:]
    assert all(cell.source.startswith("# NBVAL_CHECK_OUTPUT\n") and cell.outputs[0].text for cell in stored)
