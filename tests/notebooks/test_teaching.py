"""The lecturer's page: a section for every notebook, and exam questions whose answers are those of the models."""

import doctest
import re
from pathlib import Path

import pytest

import labkit

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
PAGE = (NOTEBOOKS / "README.md").read_text(encoding="utf-8")
SECTIONS = {section[:2]: section for section in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]}


def test_every_notebook_has_its_section():
    assert list(SECTIONS) == [path.name[:2] for path in sorted(NOTEBOOKS.glob("*.ipynb"))]
    for section in SECTIONS.values():
        assert all(word in section for word in ("**45**", "**90**", "To the hall", "Misconception"))


@pytest.mark.parametrize("number", SECTIONS)
def test_exam_questions_have_these_answers(number):
    names = {name: getattr(labkit, name) for name in labkit.__all__}
    test = doctest.DocTestParser().get_doctest(SECTIONS[number], names, number, "notebooks/README.md", 0)
    assert number == "13" or test.examples
    assert doctest.DocTestRunner().run(test).failed == 0
