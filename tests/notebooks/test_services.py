"""The page of the kernel's services is what its generator writes, and its examples use every call of the table."""

import runpy

import nbformat
import pytest

from tests.notebooks.make_services import EXAMPLES, PAGE, calls, examples, groups, page, used


def test_the_stored_page_is_what_the_generator_writes():
    assert PAGE.read_text(encoding="utf-8") == nbformat.writes(page()) + "\n", "run tests/notebooks/make_services.py"


def test_every_group_has_its_file_and_every_file_its_group():
    assert sorted(group.file for group in groups()) == sorted(EXAMPLES.glob("*.py"))
    called = [call for group in groups() for row in group.rows for call in calls(row)]
    assert len(set(called)) == len(called) > 60


@pytest.mark.parametrize("group", groups(), ids=lambda group: group.name)
def test_each_row_has_its_examples_and_they_use_all_of_its_calls(group):
    uses = {str(n): used("\n".join(example.cells)) for n, example in enumerate(examples(group.file)[1], 7)}
    rows = group.table(7).splitlines()[2:]
    for row, line in zip(group.rows, rows, strict=True):
        numbers = line.split("|")[-2].split(",")
        assert calls(row) and calls(row) <= set().union(*(uses[number.strip()] for number in numbers)), row


@pytest.mark.parametrize("group", groups(), ids=lambda group: group.name)
def test_an_example_is_short_and_runs_by_itself(group, capsys):
    about, found = examples(group.file)
    assert about.endswith(".") and found
    for example in found:
        assert example.sentence.endswith(".") and sum(len(cell.splitlines()) for cell in example.cells) <= 20
        assert "k.advance(" in example.cells[-1] and "print(" in "".join(example.cells)
    runpy.run_path(str(group.file))
    assert len(capsys.readouterr().out.splitlines()) >= len(found)


def test_nbval_compares_what_every_example_prints_and_cells_are_short():
    stored = [cell for cell in nbformat.read(PAGE, as_version=4).cells if cell.cell_type == "code"][1:]
    cells = [cell for group in groups() for example in examples(group.file)[1] for cell in example.cells]
    assert [cell.source.removeprefix("# NBVAL_CHECK_OUTPUT\n") for cell in stored] == cells
    for cell in stored:
        assert cell.source.count("\n") < 15
        runs = "k.advance(" in cell.source  # the others only say what tasks do
        assert cell.source.startswith("# NBVAL_CHECK_OUTPUT\n") == bool(cell.outputs) == runs
