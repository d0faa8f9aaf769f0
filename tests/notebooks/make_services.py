"""The page "kernel services": the table in `labkit.kernel`, group by group, each with examples that run.

    python tests/notebooks/make_services.py     # after a change of the table or of an example; writes the notebook

The examples of a group stand in the file of its name in the folder `services`, which runs by itself: what the group is about,
then for each a comment that begins with `# %%`, and its code; where a line is `# %%` and nothing else, another cell begins. All
that a cell prints is stored and compared.
"""

from __future__ import annotations

import ast
import contextlib
import io
import re
from dataclasses import dataclass
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

import labkit.kernel
import labkit.kernel.kernel

HERE = Path(__file__).parent
EXAMPLES = HERE / "services"
PAGE = HERE.parents[1] / "notebooks" / "reference" / "kernel_services.ipynb"
INTRODUCTION = """# Which call of FreeRTOS is which in the lab?

A reference, to look things up in: every call by the name that it has in FreeRTOS, what it is called in a task's body (`os.`, to
be yielded) or in an interrupt's handler (`isr.`), what differs, and an example to change and run. {everywhere}

The semantics are those of the real kernel, recorded scenario by scenario. {left_out}"""
SETUP = "from labkit.kernel import Heap, Kernel"


@dataclass(frozen=True)
class Group:
    """Calls that belong together: rows of (FreeRTOS, here, what differs)."""

    name: str
    rows: tuple[tuple[str, str, str], ...]

    @property
    def file(self) -> Path:
        """Where its examples stand."""
        return EXAMPLES / f"{self.name.lower().replace(' ', '_')}.py"

    def table(self, first: int) -> str:
        """The rows as Markdown, each with the numbers of its examples, the group's first being `first`."""
        uses = [used("\n".join(each.cells)) for each in examples(self.file)[1]]
        shown = [{n for n, here in enumerate(uses, first) for call in calls(row) if call in here} for row in self.rows]
        lines = [f"| {_code(there)} | {_code(here)} | {differs} |" for there, here, differs in self.rows]
        numbered = [f"{line} {', '.join(map(str, sorted(numbers)))} |" for line, numbers in zip(lines, shown, strict=True)]
        return "\n".join(["| FreeRTOS | here | what differs | example |", "|---|---|---|---|", *numbered])


def calls(row: tuple[str, str, str]) -> set[str]:
    """Such as `os.take` and `isr.give`."""
    return set(re.findall(r"\b(?:os|isr)\.\w+", row[1]))


def used(code: str) -> set[str]:
    """The requests and calls made in it, such as `os.take` and `isr.give`."""
    attributes = (node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute))
    return {f"{a.value.id}.{a.attr}" for a in attributes if isinstance(a.value, ast.Name) and a.value.id in ("os", "isr")}


def _code(names: str) -> str:
    return ", ".join(f"`{name}`" for name in names.split(", "))


def groups() -> list[Group]:
    """The table in the docstring of `labkit.kernel`."""
    table = (labkit.kernel.__doc__ or "").partition("differs\n")[2].partition("\n\n")[0]
    found: list[Group] = []
    for line in map(str.strip, table.splitlines()):
        if line.endswith(":"):
            found.append(Group(line[:-1], ()))
        else:
            there, here, *notes = re.split(r"\s{2,}", line)
            found[-1] = Group(found[-1].name, (*found[-1].rows, (there, here, "".join(notes))))
    return found


@dataclass(frozen=True)
class Example:
    """A sentence and the code of its cells."""

    sentence: str
    cells: tuple[str, ...]


def examples(path: Path) -> tuple[str, list[Example]]:
    """What a file is about, and its examples."""
    head, *parts = path.read_text(encoding="utf-8").split("\n# %% ")
    found = []
    for part in parts:
        lines = part.splitlines()
        first = next(n for n, line in enumerate(lines) if n and not line.startswith("# "))
        code = re.sub(r"\n{2,}", "\n\n", "\n".join(lines[first:]))  # in a file functions stand further apart
        cells = tuple(cell.strip() for cell in code.split("\n# %%\n"))
        found.append(Example(" ".join(line.removeprefix("# ") for line in lines[:first]), cells))
    return head.split('"""')[1], found


def page() -> nbformat.NotebookNode:
    """The notebook, each cell with what it prints."""
    everywhere = one_line(labkit.kernel.__doc__, "differs. ")
    left_out = one_line(labkit.kernel.kernel.__doc__, "\n\nLeft out: ")
    text = INTRODUCTION.format(everywhere=everywhere, left_out=f"Left out: {left_out}")
    names: dict[str, object] = {}
    exec(SETUP, names)
    cells = [new_markdown_cell(text), new_code_cell(SETUP)]
    number = 0
    for group in groups():
        about, parts = examples(group.file)
        before = f"## {group.name}\n\n{about}\n\n{group.table(number + 1)}\n\n"
        for example in parts:
            number += 1
            cells.append(new_markdown_cell(f"{before}**Example {number}.** {example.sentence}"))
            cells += [_run(code, names, group.file.name) for code in example.cells]
            before = ""
    for at, cell in enumerate(cells):
        cell.id = f"s{at:02}"
    kernel = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
    return new_notebook(cells=cells, metadata={"kernelspec": kernel})


def _run(code: str, names: dict[str, object], where: str) -> nbformat.NotebookNode:
    """A cell with what it prints, compared by nbval if that is anything."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(code, where, "exec"), names)
    if not said.getvalue():
        return new_code_cell(code)
    output = new_output("stream", name="stdout", text=said.getvalue())
    return new_code_cell(f"# NBVAL_CHECK_OUTPUT\n{code}", outputs=[output], execution_count=1)


def one_line(text: str | None, after: str) -> str:
    """The rest of the paragraph of a docstring behind some words, without its line ends."""
    return " ".join((text or "").split(after)[1].partition("\n\n")[0].split())


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    nbformat.write(page(), PAGE)
    print(f"wrote {PAGE.name}")
