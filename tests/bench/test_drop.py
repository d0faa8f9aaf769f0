"""A file dropped on a bench: it comes in pieces, nothing is overwritten, what is wrong is a sentence."""

from pathlib import Path

import pytest

from labkit import OwnRecording, explore
from labkit.bench import drop
from labkit.data import example

PIECE = 1000


class Page:
    """The page of a bench that takes a file: collects what the strip is told, and answers as drop.js does."""

    def __init__(self, bench):
        self.bench, self.got, self.file = bench, [], b""
        [self.strip] = [each for each in bench.children[0].children if isinstance(each, drop.Drop)]
        self.strip.send = self.take

    def say(self, content, piece=None):
        self.strip._handle_custom_msg(content, [] if piece is None else [memoryview(piece)])

    def take(self, content):
        self.got.append(content)
        if content["kind"] == "more":
            self.say({"piece": content["at"]}, self.file[content["at"] : content["at"] + PIECE])

    def drop(self, name, data):
        self.file = data
        self.say({"begin": name, "size": len(data)})
        return self.got[-1]["text"]


@pytest.fixture
def page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Page(explore(OwnRecording))


@pytest.mark.parametrize("name", ["board.log", "board.btf", "linux_ftrace.txt", "run.csv", "run.json"])
def test_a_file_arrives_as_it_is_and_is_shown(page, name):
    data = example(name).read_bytes()
    assert len(data) > 2 * PIECE
    assert page.drop(name, data) == f"kept as dropped/{name}"
    assert Path("dropped", name).read_bytes() == data and page.bench.experiment.file == f"dropped/{name}"
    assert page.bench.result.report == OwnRecording(file=str(example(name))).run().report
    assert "ctl" in page.bench.spec["layout"]["meta"]["told"] and not page.bench.error


def test_another_file_of_the_same_name_gets_a_number_and_the_same_one_none(page):
    first, second = b"a 0 1\na 5 0\n", b"a 0 1\na 7 0\n"
    assert page.drop("a.log", first) == page.drop("a.log", first) == "kept as dropped/a.log"
    assert page.drop("a.log", second) == "kept as dropped/a-2.log"
    assert page.bench.result.ran == {"a": 0.007}
    assert page.drop("a.log", first) == "kept as dropped/a.log" and page.bench.result.ran == {"a": 0.005}
    assert sorted(path.name for path in Path("dropped").iterdir()) == ["a-2.log", "a.log"]


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../../x.log", "x.log"),
        ("C:\\logs\\x.log", "x.log"),
        (".hidden", "hidden"),
        ("..", "file"),
        ("a\nb\u202e.log", "a_b_.log"),
    ],
)
def test_a_name_stays_in_its_folder(page, name, kept):
    assert page.drop(name, b"a 0 1\na 5 0\n") == f"kept as dropped/{kept}"
    assert [path.name for path in Path().iterdir()] == ["dropped"]


def test_what_is_no_recording_is_told_by_the_bench(page):
    page.drop("photo.jpg", bytes(range(256)) * 10)
    assert "photo.jpg" in page.bench.error and page.bench.result.report.source.endswith("unordered.log")
    page.drop("empty.log", b"")
    assert "empty.log" in page.bench.error
    page.drop("a.log", b"a 0 1\na 5 0\n")
    assert not page.bench.error


def test_a_file_too_long_is_refused_before_it_is_sent(page):
    page.say({"begin": "long.log", "size": (256 << 20) + 1})
    assert page.got == [{"kind": "note", "text": "long.log is longer than 256 MiB, the most that is taken"}]
    assert not Path("dropped").exists()


def test_a_file_given_up_leaves_nothing(page):
    page.strip.send = page.got.append  # a page that does not go on by itself
    page.say({"begin": "a.log", "size": 20})
    page.say({"piece": 0}, b"a 0 1\n")
    page.say({"piece": 0}, b"a 0 1\n")  # not what was asked for
    assert page.got[-1] == {"kind": "more", "at": 6}
    page.say({"begin": "b.log", "size": 12})
    page.say({"piece": 6}, b"a 9 0\n")  # of the file before
    page.say({"piece": 0}, b"b 0 1\nb 5 0\n")
    assert [path.name for path in Path("dropped").iterdir()] == ["b.log"]
    page.say({"begin": "c.log", "size": 12})
    page.say({"stop": True})
    assert [path.name for path in Path("dropped").iterdir()] == ["b.log"]


def test_a_folder_that_cannot_be_written_is_a_sentence(page):
    Path("dropped").write_text("a file is in the way")
    assert page.drop("a.log", b"a 0 1\n") == "a.log cannot be kept: File exists"
