"""Texts of lackey and Dinero: what cachegrind counted for the very program, both formats alike, and damage."""

from pathlib import Path

import numpy as np
import pytest

from labkit.cache import TraceFileError, count_trace, read_references
from labkit.cache.references import npz, text

EXAMPLES = Path(__file__).parents[2] / "data" / "examples"

#: size, ways, line -> reads, read misses, writes, write misses: cachegrind (3.19, --D1=size,ways,line) of the program whose
#: references lackey wrote into sum_lackey.txt.
CACHEGRIND = {
    (1024, 2, 32): (576, 128, 321, 65),
    (512, 1, 32): (576, 136, 321, 81),
    (2048, 1, 64): (576, 72, 321, 73),
    (16384, 4, 32): (576, 128, 321, 1),
}


@pytest.mark.parametrize("geometry", CACHEGRIND)
@pytest.mark.parametrize("name", ["sum_lackey.txt", "sum_dinero.din"])
def test_the_counts_are_those_of_cachegrind(geometry, name):
    counts = count_trace(read_references(EXAMPLES / name).references, *geometry)
    found = tuple(counts[key] for key in ("reads", "read_misses", "writes", "write_misses"))
    assert found == CACHEGRIND[geometry]


def written(tmp_path, data):
    path = tmp_path / "trace"
    path.write_bytes(data)
    return path


def test_lackey_line_by_line(tmp_path):
    lines = b"==7== Lackey\nI  04001000,3\n L 1ffe7e8,8\n S 0x20,4\r\n M 30,16\nSB 04001000\nhello\n L zz,4\n\n L 40,8"
    found = read_references(written(tmp_path, lines))
    refs = found.references
    assert list(zip(refs.op.tolist(), refs.address.tolist(), refs.size.tolist())) == [
        (2, 0x1FFE7E8, 8),
        (1, 0x20, 4),
        (3, 0x30, 16),
        (2, 0x40, 8),
    ]
    assert str(found) == (
        "lackey, 4 data references; left out: 1 instructions, 4 lines of another form"  # ==7==, SB without its blank, hello, zz
    )


def test_dinero_line_by_line(tmp_path):
    lines = b"2 0\n0 1000 a comment\n0 0x70f60888\n  1 70F60890\n3 0\n4 0\n7 1\n1 12345678901234567\n"
    found = read_references(written(tmp_path, lines))
    refs = found.references
    assert list(zip(refs.op.tolist(), refs.address.tolist(), refs.size.tolist())) == [
        (2, 0x1000, 4),
        (2, 0x70F60888, 4),
        (1, 0x70F60890, 4),
    ]
    assert dict(found.left_out) == {"instructions": 1, "escapes": 1, "flushes": 1, "lines of another form": 2}


def test_blocks_are_joined_wherever_they_are_cut(tmp_path, monkeypatch):
    path = EXAMPLES / "sum_lackey.txt"
    whole = read_references(path)
    monkeypatch.setattr(text, "BLOCK", 97)
    cut = read_references(path)
    assert np.array_equal(cut.references.address, whole.references.address) and cut.left_out == whole.left_out


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "it is no trace of data references"),
        (b"\0" * 100_000, "it is no trace of data references"),
        (b"hello\nworld\n", "it is no trace of data references"),
        (b"I  04001000,3\n" * 9, "it has no data reference in the form of lackey"),
        (b" L 40,0\n", "size of reference 0 is 0"),
        (b" L ffffffffffffffff,8\n", "address of reference 0 is -1"),
        (b" L 40,8\n" * 9 + b"x" * 2_100_000 + b"\n", "a line of more than a megabyte"),
    ],
)
def test_what_is_no_trace_is_told_in_one_sentence(tmp_path, data, said):
    with pytest.raises(TraceFileError, match=r"^[^\n]+$") as error:
        read_references(written(tmp_path, data))
    assert said in str(error.value)


def test_too_many_references_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "MOST_IN_FILE", 100)
    with pytest.raises(TraceFileError, match="more than 100 data references"):
        read_references(written(tmp_path, b" L 40,8\n" * 101))
    assert npz.MOST_IN_FILE == 5_000_000
