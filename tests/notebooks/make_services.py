"""The page "kernel services": the table in `labkit.kernel`, group by group, each with examples that run.

    python tests/notebooks/make_services.py     # after a change of the table or of an example; writes the notebook

The examples of a group stand in the file of its name in the folder `services`, which runs by itself: what the group is about,
then for each cell a comment that begins with `# %%`, and its code. All that a cell prints is stored and compared.
"""

from __future__ import annotations

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
    def calls(self) -> set[str]:
        """Such as `os.take` and `isr.give`."""
        return {call for _, here, _ in self.rows for call in re.findall(r"\b(?:os|isr)\.\w+", here)}

    @property
    def file(self) -> Path:
        """Where its examples stand."""
        return EXAMPLES / f"{self.name.lower().replace(' ', '_')}.py"

    def table(self) -> str:
        """The rows as Markdown."""
        lines = [f"| {_code(there)} | {_code(here)} | {differs} |" for there, here, differs in self.rows]
        return "\n".join(["| FreeRTOS | here | what differs |", "|---|---|---|", *lines])


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


def examples(path: Path) -> tuple[str, list[tuple[str, str]]]:
    """What a file is about, and its cells: (sentence, code)."""
    head, *parts = path.read_text(encoding="utf-8").split("\n# %% ")
    cells = []
    for part in parts:
        lines = part.splitlines()
        first = next(n for n, line in enumerate(lines) if n and not line.startswith("# "))
        code = re.sub(r"\n{2,}", "\n\n", "\n".join(lines[first:]).strip())  # in a file functions stand further apart
        cells.append((" ".join(line.removeprefix("# ") for line in lines[:first]), code))
    return head.split('"""')[1], cells


def page() -> nbformat.NotebookNode:
    """The notebook, each cell with what it prints."""
    everywhere = one_line(labkit.kernel.__doc__, "differs. ")
    left_out = one_line(labkit.kernel.kernel.__doc__, "\n\nLeft out: ")
    text = INTRODUCTION.format(everywhere=everywhere, left_out=f"Left out: {left_out}")
    names: dict[str, object] = {}
    exec(SETUP, names)
    cells = [new_markdown_cell(text), new_code_cell(SETUP)]
    for group in groups():
        about, parts = examples(group.file)
        before = f"## {group.name}\n\n{about}\n\n{group.table()}\n\n"
        for sentence, code in parts:
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                exec(compile(code, group.file.name, "exec"), names)
            output = new_output("stream", name="stdout", text=said.getvalue())
            cells.append(new_markdown_cell(before + sentence))
            cells.append(new_code_cell(f"# NBVAL_CHECK_OUTPUT\n{code}", outputs=[output], execution_count=1))
            before = ""
    for number, cell in enumerate(cells):
        cell.id = f"s{number:02}"
    kernel = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
    return new_notebook(cells=cells, metadata={"kernelspec": kernel})


def one_line(text: str | None, after: str) -> str:
    """The rest of the paragraph of a docstring behind some words, without its line ends."""
    return " ".join((text or "").split(after)[1].partition("\n\n")[0].split())


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    nbformat.write(page(), PAGE)
    print(f"wrote {PAGE.name}")
