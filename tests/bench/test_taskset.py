"""A bench whose parameter is a table: what the page sends, and what it gets to draw."""

import json

import pytest

from labkit import OwnTaskSet, task_set_editor


class Page:
    """The page of an editor: collects what the table sends, and answers as taskset.js does."""

    def __init__(self, editor):
        self.got = []
        self.table = editor.table
        self.table.send = lambda content, buffers=None: self.got.append(content)
        self.say({"want": "state"})

    def say(self, content):
        self.table._handle_custom_msg(content, [])

    @property
    def shown(self):
        return next(content for content in reversed(self.got) if content["kind"] == "table")


def test_an_edit_moves_results_and_picture():
    editor = task_set_editor(OwnTaskSet)
    page = Page(editor)
    assert page.shown["rows"] == editor.result.rows and page.shown["text"] == editor.experiment.tasks
    page.say({"text": "a, 2, 5; b, 4, 7"})
    assert [head["foot"] for head in page.shown["heads"]] == ["not accepted", "not accepted", "accepted", "–"]
    assert page.shown["beside"][1][0] == {"text": "8 / 8", "good": False}
    assert "exceeds the deadline 7 by 1" in editor.spec["layout"]["meta"]["says"]
    page.say({"set": 2})
    assert editor.experiment.policy == "edf" and page.shown["text"] == "a, 2, 5; b, 4, 7"


def test_a_wrong_cell_is_told_beside_its_row_and_mended():
    page = Page(task_set_editor(OwnTaskSet(tasks="a, 2, 5; b, 4, 7")))
    page.say({"text": "a, 2, 5; b, four, 7"})
    assert page.shown["wrong"][0].startswith("not under TAFT") and "C is 'four'" in page.shown["wrong"][1]
    assert all(cell["text"] == "–" for row in page.shown["beside"] for cell in row)
    page.say({"text": "a, 2, 5; b, 4, 7"})
    assert "four" not in str(page.shown)


def test_every_text_is_answered_even_if_nothing_changes():
    page = Page(task_set_editor(OwnTaskSet))
    before = len(page.got)
    page.say({"text": page.shown["text"]})
    assert len(page.got) == before + 1


def test_files_are_loaded_and_saved_as_labkit_schedule_has_them(tmp_path):
    editor = task_set_editor(OwnTaskSet)
    page = Page(editor)
    data = {"unit": "us", "tasks": [{"name": "x", "period": 9, "wcet": 3, "times": [3, 1]}], "measured": {}}
    page.say({"load": json.dumps(data), "name": "mine.json"})
    assert page.got[-1] == {"kind": "note", "text": "loaded mine.json"} and editor.experiment.unit == "us"
    page.say({"save": True})
    saved = json.loads(page.got[-1]["text"])
    assert saved == {"unit": "us", "tasks": data["tasks"]}
    file = tmp_path / "tasks.json"
    file.write_text(json.dumps(saved))
    assert task_set_editor(OwnTaskSet, str(file)).experiment == editor.experiment
    page.say({"load": "{", "name": "broken.json"})
    assert "broken.json is not JSON" in page.got[-1]["text"] and editor.experiment.unit == "us"


def test_reset_brings_the_first_table_back():
    editor = task_set_editor(OwnTaskSet(tasks="a, 2, 5"))
    page = Page(editor)
    page.say({"text": "a, 2, 5; b, 4, 7"})
    editor.reset()
    assert page.shown["text"] == "a, 2, 5"


def test_a_table_that_cannot_be_saved_says_why():
    page = Page(task_set_editor(OwnTaskSet(tasks="a, x, 5")))
    page.say({"save": True})
    assert page.got[-1]["kind"] == "note" and "C is 'x'" in page.got[-1]["text"]


def test_a_missing_file_is_an_error_of_the_cell():
    with pytest.raises(OSError):
        task_set_editor(OwnTaskSet, "no such file.json")
