"""Access patterns and trace files: what they contain and how typos are answered."""

import io
import pickle
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from labkit.cache import DCACHE, References, TraceFileError, count, count_trace, miss_classes, patterns, read_trace


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


def test_the_largest_patterns_are_made_and_the_next_one_is_refused_at_once():
    assert len(patterns.parse("repeat 2000; repeat 100; read 0 times 10; end; end")) == 2_000_000
    many = "\n".join(["read 0"] * 20_000)
    assert len(patterns.parse(many)) == 20_000
    with pytest.raises(ValueError, match="line 1: 2000010 references; a pattern may have 2000000 at most"):
        patterns.parse("read 0 times 10; repeat 2000; repeat 100; read 0 times 10; end; end")


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
        (
            lambda: patterns.strided(4, 1 << 40),
            "elements of 4 bytes from 0x20020000 to 0x30020020000; addresses must stay within",
        ),
        (lambda: patterns.random(4, 1 << 70), "elements of 4 bytes from 0x20020000 to"),
        (lambda: patterns.sequential(4, start=-4), "elements of 4 bytes from -0x4 to 0x8; addresses must stay within 32 bits"),
        (lambda: patterns.sequential(1, size=1 << 17), "elements of 131072 bytes; an element has 65536 at most"),
        (lambda: patterns.matrix_product(2, element=1 << 40), "elements of 1099511627776 bytes from 0x20020000"),
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
    with pytest.raises(TraceFileError, match="it is no trace of data references: neither"):
        read_trace(tmp_path / "text.npz")
    np.save(tmp_path / "one.npy", GOOD["op"])
    with pytest.raises(TraceFileError, match="holds a single array"):
        read_trace(tmp_path / "one.npy")
    with pytest.raises(TraceFileError, match="Is a directory"):
        read_trace(tmp_path)


def archive(path, members, method=zipfile.ZIP_DEFLATED):
    """A zip file of these members, bytes as they are."""
    with zipfile.ZipFile(path, "w", method) as made:
        for name, data in members.items():
            made.writestr(name, data)


def header(entries, dtype="|u1"):
    """What numpy writes before the data of an array."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": dtype, "fortran_order": False, "shape": (entries,)})
    return file.getvalue()


def refusal(path):
    """The sentence with which a trace file is refused, and the memory [bytes] that it took."""
    tracemalloc.start()
    with pytest.raises(TraceFileError) as error:
        read_trace(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "\n" not in str(error.value) and "pickle" not in str(error.value)
    return str(error.value), peak


def test_what_would_unpack_to_too_much_is_refused_before_it_is_unpacked(tmp_path):
    zeros = bytes(1 << 20)
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as made:
        for name in ("op.npy", "addr.npy", "size.npy"):
            with made.open(name, "w") as member:
                member.write(header(100_000_000))
                for _ in range(100):
                    member.write(zeros)
    said, peak = refusal(tmp_path / "bomb.npz")
    assert said.endswith("array op unpacks to 104857728 bytes; a trace has 5000000 references at most")
    assert peak < 10_000_000


def test_an_array_that_announces_more_than_it_holds_is_refused_without_making_room(tmp_path):
    good = {"addr.npy": header(0, "<u8"), "size.npy": header(0)}
    for entries, says in (
        (1 << 40, "array op announces 1099511627776 entries; a trace has 5000000 at most"),
        (-1, "array op announces -1 entries; a trace has 5000000 at most"),
        (4_000_000, "array op does not hold the 4000000 bytes of data that it announces"),
    ):
        archive(tmp_path / "lie.npz", {"op.npy": header(entries) + b"\2", **good})
        said, peak = refusal(tmp_path / "lie.npz")
        assert said.endswith(says)
        assert peak < 1_000_000


def test_a_directory_of_the_archive_that_understates_a_size_is_not_believed(tmp_path):
    lie = tmp_path / "lie.npz"
    archive(lie, {"op.npy": header(4) + bytes(40_000_000), "addr.npy": header(0, "<u8"), "size.npy": header(0)})
    data = lie.read_bytes()
    true, said = (128 + 40_000_000).to_bytes(4, "little"), (128 + 4).to_bytes(4, "little")
    lie.write_bytes(data.replace(true, said))
    assert refusal(lie)[1] < 1_000_000


@pytest.mark.parametrize(
    ("members", "method", "says"),
    [
        ({"op.npy": b"\x93NUMPY\1\0\x10\0" + b"(" * 16}, zipfile.ZIP_STORED, "array op has no readable header"),
        ({"op.npy": b"\x93NUMPY\3\0"}, zipfile.ZIP_STORED, "it must be in numpy's format 1.0 or 2.0"),
        ({"op.npy": header(1)[:8] + b"\xff\xff" + b" " * 65535}, zipfile.ZIP_STORED, "array op has no readable header"),
        ({"op.npy": header(1) + b"\1"}, zipfile.ZIP_BZIP2, "array op is compressed by method 12; it must be stored or deflated"),
        ({f"\r\n\x1b{n}.npy": b"" for n in range(30)}, zipfile.ZIP_STORED, r"\r\n\x1b0, \r\n\x1b1"),
    ],
)
def test_a_strange_archive_is_refused_in_one_printable_sentence(tmp_path, members, method, says):
    others = {"addr.npy": header(0, "<u8"), "size.npy": header(0)} if "op.npy" in members else {}
    archive(tmp_path / "strange.npz", members | others, method)
    said, _ = refusal(tmp_path / "strange.npz")
    assert says in said and said.isprintable() and len(said) < 400


def test_nobody_is_advised_to_allow_pickles(tmp_path):
    objects = np.array([1, None], object)
    for name, write in {
        "text.npz": lambda path: path.write_text("op addr size"),
        "objects.npz": lambda path: np.savez(path, op=objects, addr=np.zeros(2, np.uint64), size=np.zeros(2, np.uint8)),
        "objects.npy": lambda path: np.save(path, objects),
        "dumped.npz": lambda path: path.write_bytes(pickle.dumps([objects])),
        "empty.npz": lambda path: path.write_bytes(b""),
    }.items():
        write(tmp_path / name)
        refusal(tmp_path / name)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (([1], [0, 4], [4, 4]), "op, address and size have the shapes (1,), (2,) and (2,); they must be 1-dimensional"),
        (([[1]], [[0]], [[4]]), "op, address and size have the shapes (1, 1), (1, 1) and (1, 1); they must be 1-dimensional"),
        (([4], [0], [4]), "op of reference 0 is 4; allowed is 1 store, 2 load or 3 modify"),
        (([1], [0], [0]), "size of reference 0 is 0; allowed is at least 1 byte"),
        (([1], [-1], [4]), "address of reference 0 is -1; allowed is at least 0"),
        (
            ([1], [2**63 - 4], [4]),
            "address of reference 0 is 9223372036854775804; allowed is at most 2**63 - 1, its size included",
        ),
    ],
)
def test_references_that_cannot_be_are_refused(columns, says):
    with pytest.raises(ValueError) as error:
        References(*(np.array(column, np.int64) for column in columns))
    assert str(error.value).startswith(says)


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
