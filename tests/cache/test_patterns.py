"""Access patterns and trace files: what they contain and how typos are answered."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from labkit.cache import DCACHE, TraceFileError, count, count_trace, miss_classes, patterns, read_trace


def rows(references):
    return list(zip(references.op.tolist(), references.address.tolist(), references.size.tolist()))


def test_a_matrix_product_of_floats_has_the_known_negative_conflict_misses():
    trace = patterns.matrix_product(64, element=4)
    misses = count(trace, DCACHE)["fills"]
    classes = miss_classes(misses, trace, DCACHE)
    assert (classes.compulsory, classes.capacity, classes.conflict) == (1536, 32256, -9976)


@pytest.mark.parametrize("order", patterns.ORDERS)
@pytest.mark.parametrize("tile", [None, 2])
def test_every_loop_order_touches_the_same_elements_as_the_textbook_loop(order, tile):
    n, expected = 4, []
    for i in range(n):
        for j in range(n):
            for k in range(n):
                c = 32 + i * n + j
                expected += [(2, i * n + k), (2, 16 + k * n + j), (2, c), (1, c)]
    trace = patterns.matrix_product(n, order=order, element=8, start=0, tile=tile)
    found = [(op, address // 8) for op, address, _ in rows(trace)]
    assert sorted(found) == sorted(expected)
    if order == "ijk" and tile is None:
        assert found == expected


def test_accumulate_stores_each_element_once():
    found = rows(patterns.matrix_product(2, element=4, start=0, accumulate=True))
    assert [(op, address // 4) for op, address, _ in found[:5]] == [(2, 0), (2, 4), (2, 1), (2, 6), (1, 8)]
    assert len(found) == 2 * 8 + 4


def test_sequential_strided_and_random():
    assert rows(patterns.sequential(2, start=0, rounds=2)) == [(2, 0, 4), (2, 4, 4)] * 2
    assert rows(patterns.strided(3, 64, start=0, op="write", size=8)) == [(1, 0, 8), (1, 64, 8), (1, 128, 8)]
    trace = patterns.random(1000, 64, start=0, seed=7)
    assert set(trace.address.tolist()) == set(range(0, 64, 4))
    assert np.array_equal(trace.address, patterns.random(1000, 64, start=0, seed=7).address)


def test_own_pattern():
    text = """
    read 0x100          # a comment
    repeat 2
      write 16 size 8; modify 0x20 times 2 step 32
      repeat 2
        read 64 step -4 times 2
      end
    end
    """
    inner = [(1, 16, 8), (3, 32, 4), (3, 64, 4), *[(2, 64, 4), (2, 60, 4)] * 2]
    assert rows(patterns.parse(text)) == [(2, 256, 4), *inner, *inner]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("read 0x10\nraed 0x20", "line 2: 'raed' is no command; there are write, read, modify, repeat, end"),
        ("read", "line 1: read needs an address, as in 'read 0x20020000'"),
        ("read ox20", "line 1: address is 'ox20'; it must be a whole number such as 64 or 0x40"),
        ("read 0x20 tines 3", "line 1: 'tines' is no option of read; there are size, times, step"),
        ("read 0x20 times", "line 1: times needs a number after it"),
        ("read 0x20 times many", "line 1: times is 'many'; it must be a whole number such as 64 or 0x40"),
        ("read 0x20 times 0", "line 1: times is 0; it must be at least 1 and below 2**32"),
        ("read 0x20 size -4", "line 1: size is -4; it must be at least 1 and below 2**32"),
        ("read -4", "line 1: address is -4; it must be at least 0 and below 2**32"),
        (
            "read 4 times 3 step -4",
            "line 1: 3 times step -4 from 0x4 with size 4; addresses must stay within 32 bits and a size within 65536 bytes",
        ),
        ("repeat\nend", "line 1: repeat needs one number, as in 'repeat 3'"),
        ("repeat 2\nread 0", "line 1: repeat without an end"),
        ("read 0\nend", "line 2: end without a repeat before it"),
        ("repeat 2\nread 0\nend 2", "line 3: '2' after end; end stands alone"),
        ("read 0 times 3000000", "line 1: 3000000 references; a pattern may have 2000000 at most"),
        ("repeat 4000000000\nread 0\nend", "line 3: 4000000000 references; a pattern may have 2000000 at most"),
        ("# nothing", "the pattern has no references; write for example 'read 0x20020000 times 64 step 4'"),
    ],
)
def test_a_typo_in_a_pattern_is_named_with_its_line(text, says):
    with pytest.raises(ValueError) as error:
        patterns.parse(text)
    assert str(error.value) == says


WORDS = ["read", "write", "repeat", "end", "times", "step", "size", "0x20", "3", "-1", ";", "\n", "#", "9" * 5000, "é"]


@given(st.lists(st.sampled_from(WORDS), max_size=12).map(" ".join) | st.text(max_size=40))
@example("repeat 99999\nrepeat 99999\nend\nend")
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_pattern_or_one_sentence(text):
    try:
        assert len(patterns.parse(text)) > 0
    except ValueError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: patterns.sequential(0), "count is 0; it must be at least 1"),
        (lambda: patterns.strided(4, 0), "stride is 0; it must be at least 1"),
        (lambda: patterns.strided(4, 4, op="raed"), "no operation 'raed'; there are write, read, modify"),
        (lambda: patterns.random(4, 2), "span is 2 bytes; at least one element of 4 bytes must fit"),
        (lambda: patterns.sequential(1 << 40), "1099511627776 references; a pattern may have 2000000 at most"),
        (lambda: patterns.matrix_product(4, order="iij"), "no loop order 'iij'; there are ijk, ikj, jik, jki, kij, kji"),
        (lambda: patterns.matrix_product(4, tile=3), "tile is 3; it must be at least 1 and divide n, which is 4"),
        (lambda: patterns.matrix_product(4, order="ikj", accumulate=True), "order ikj with accumulate; a sum in a register"),
        (lambda: patterns.matrix_product(1000), "4000000000 references; a pattern may have 2000000 at most"),
    ],
)
def test_a_pattern_that_cannot_be_is_refused(call, says):
    with pytest.raises(ValueError) as error:
        call()
    assert str(error.value).startswith(says)


GOOD = {"op": np.array([1, 2], np.uint8), "addr": np.array([64, 96], np.uint64), "size": np.array([4, 4], np.uint8)}


def test_a_good_file_is_read(tmp_path):
    np.savez(tmp_path / "good.npz", **GOOD)
    assert rows(read_trace(tmp_path / "good.npz")) == [(1, 64, 4), (2, 96, 4)]
    np.savez(tmp_path / "empty.npz", **{name: column[:0] for name, column in GOOD.items()})
    assert set(count_trace(tmp_path / "empty.npz").values()) == {0}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"addr": None}, "has the arrays op, size; a trace has op, addr and size"),
        ({"extra": GOOD["op"]}, "has the arrays addr, extra, op, size; a trace has op, addr and size"),
        ({"op": GOOD["op"].astype(int)}, "array op is 1-dimensional int64; it must be 1-dimensional uint8"),
        ({"addr": GOOD["addr"].astype(float)}, "array addr is 1-dimensional float64; it must be 1-dimensional uint64"),
        ({"size": GOOD["size"].reshape(1, 2)}, "array size is 2-dimensional uint8; it must be 1-dimensional uint8"),
        ({"size": np.array([4], np.uint8)}, "array size has 1 entries and op 2; they must agree"),
        ({"op": np.array([1, 7], np.uint8)}, "op of reference 1 is 7; allowed is 1 store, 2 load or 3 modify"),
        ({"size": np.array([0, 4], np.uint8)}, "size of reference 0 is 0; allowed is at least 1 byte"),
        (
            {"addr": np.array([64, 2**64 - 1], np.uint64)},
            "addr of reference 1 is 18446744073709551615; allowed is below 2**63 - 256",
        ),
        ({"op": np.array([1, None], object)}, "cannot be read as an .npz file of plain arrays"),
    ],
)
def test_a_file_with_wrong_arrays_is_refused_in_one_sentence(tmp_path, change, says):
    path = tmp_path / "trace.npz"
    np.savez(path, **{name: column for name, column in {**GOOD, **change}.items() if column is not None})
    with pytest.raises(TraceFileError) as error:
        count_trace(path)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_what_is_no_trace_file_is_refused(tmp_path):
    with pytest.raises(TraceFileError, match="there is no file"):
        read_trace(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("op addr size")
    with pytest.raises(TraceFileError, match="cannot be read as an .npz file"):
        read_trace(tmp_path / "text.npz")
    np.save(tmp_path / "one.npy", GOOD["op"])
    with pytest.raises(TraceFileError, match="holds a single array"):
        read_trace(tmp_path / "one.npy")
    with pytest.raises(TraceFileError, match="cannot be read as an .npz file"):
        read_trace(tmp_path)


@given(st.binary(max_size=400), st.integers(0, 2000), st.integers(0, 2000))
@settings(max_examples=150, deadline=None)
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path_factory, junk, at, length):
    path = tmp_path_factory.mktemp("damaged") / "trace.npz"
    np.savez(path, **GOOD)
    data = path.read_bytes()
    path.write_bytes(data[:at] + junk + data[at + length :])
    try:
        count_trace(path)
    except TraceFileError as error:
        assert "\n" not in str(error)
