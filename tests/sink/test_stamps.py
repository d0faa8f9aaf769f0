"""Stamps: the counter that wraps, the ring that loses and counts, the formats that tell of it, each lesson's C."""

import random
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.sink import (
    LESSONS,
    PREAMBLE,
    VARIANTS,
    StampRing,
    Stream,
    decode_records,
    decode_words,
    link_load,
    unwrap,
    wrap,
    wrap_seconds,
)
from labkit.sink.formats import record, record_drop, text_line, word, word_alive, word_drop
from labkit.trace import read_log

# --------------------------------------------------------------------------------------------------------------- counter


def test_the_counter_of_source_1_wraps_after_19_88_seconds():
    assert wrap_seconds() == pytest.approx(19.884, abs=5e-4)
    assert wrap_seconds(bits=26) == pytest.approx(0.311, abs=5e-4)


@given(st.integers(0, 2**40), st.lists(st.integers(0, 2**26 - 1), max_size=30), st.sampled_from([26, 32]))
def test_unwrapping_undoes_the_wrap(first, steps, bits):
    cycles = first + np.concatenate([[0], np.cumsum(np.array(steps, dtype=np.int64))])
    found = unwrap(wrap(cycles, bits), bits)
    assert (np.diff(found) == np.diff(cycles)).all() and 0 <= found[0] < 2**bits


@given(st.lists(st.integers(-(2**24), 2**25 - 1), min_size=1, max_size=30))
def test_stamps_out_of_order_are_unwrapped_up_to_half_a_wrap(steps):
    cycles = 2**40 + np.cumsum(np.array(steps, dtype=np.int64))
    assert (np.diff(unwrap(wrap(cycles, 26), 26, ordered=False)) == np.diff(cycles)).all()


def test_silence_for_a_whole_wrap_is_not_seen():
    assert unwrap(wrap([0, 2**32 + 5])).tolist() == [0, 5]
    assert unwrap([5, 3]).tolist() == [5, 2**32 + 3] and unwrap([5, 3], ordered=False).tolist() == [5, 3]
    assert unwrap([]).tolist() == []


@pytest.mark.parametrize("counts", [[-1], [2**26]])
def test_what_the_counter_cannot_show_is_refused(counts):
    with pytest.raises(ValueError, match=r"^a counter of 26 bits shows 0 to 67108863, not"):
        unwrap(counts, 26)


# ------------------------------------------------------------------------------------------------------------------ ring


def test_a_ring_that_is_read_in_time_loses_nothing():
    ring, read = StampRing(4), []
    for i in range(12):
        ring.stamp("a", 2**32 - 6 + i, i % 2 == 0)
        if i % 4 == 3:
            read += ring.drain()
    assert [stamp.cycle for stamp in read] == [(2**32 - 6 + i) % 2**32 for i in range(12)]
    assert ring.lost == 0 and len(ring) == 0


def test_a_lapped_ring_counts_what_is_gone():
    ring = StampRing()
    for i in range(600):
        ring.stamp("a", i, True)
    assert len(ring) == 512
    assert [stamp.cycle for stamp in ring.drain()] == list(range(88, 600))
    assert ring.lost == 88
    ring.stamp("a", 600, True)
    assert [stamp.cycle for stamp in ring.drain()] == [600] and ring.lost == 88


def test_the_loop_of_the_source_prints_the_newest_twice_and_tells_nothing():
    ring = StampRing()
    for i in range(600):
        ring.stamp("a", i, True)
    printed = [stamp.cycle for stamp in ring.drain(counted=False)]
    assert printed == [*range(512, 600), *range(88, 512), *range(512, 600)] and ring.lost == 0


# --------------------------------------------------------------------------------------------------------------- formats


def stamps(count: int, rng: random.Random, most: int = 2**25) -> list[tuple[int, int, bool]]:
    now, made = rng.randrange(2**32), []
    for _ in range(count):
        now += rng.randrange(most)
        made.append((rng.randrange(31), now, rng.random() < 0.5))
    return made


@pytest.mark.parametrize(("encode", "decode", "size"), [(record, decode_records, 8), (word, decode_words, 4)])
def test_binary_stamps_come_back(encode, decode, size):
    made = stamps(500, random.Random(size))
    data = b"".join(encode(*stamp) for stamp in made)
    found = decode(data)
    assert len(data) == 500 * size and len(found.dropped) == found.rejected == found.rest == 0
    assert found.name.tolist() == [name for name, _, _ in made]
    assert found.begin.tolist() == [begin for _, _, begin in made]
    assert np.diff(found.cycle).tolist() == np.diff([cycle for _, cycle, _ in made]).tolist()


def test_a_word_by_hand():
    assert word(5, (1 << 26) + 3, True) == (1 << 31 | 5 << 26 | 3).to_bytes(4, "little")
    assert record(258, 1, True).hex() == "0100000002010100"


def test_a_word_of_time_alone_keeps_long_silences_known():
    silent = [0, 3 * 2**26 + 7]
    assert decode_words(b"".join(word(1, c, True) for c in silent)).cycle.tolist() == [0, 7]
    alive = b"".join(word_alive(k * 2**25) for k in range(1, 7))
    assert decode_words(word(1, 0, True) + alive + word(1, silent[1], True)).cycle.tolist() == silent


def test_many_dropped_need_several_notes():
    assert decode_records(record_drop(200_000)).dropped.tolist() == [[0, 65535]] * 3 + [[0, 3395]]
    assert decode_words(word_drop(2**26)).dropped.sum() == 2**26


def test_any_bytes_are_decoded_or_counted():
    rng = random.Random(3)
    for length in range(200):
        data = rng.randbytes(length)
        records, words = decode_records(data), decode_words(data)
        assert len(records.cycle) + len(records.dropped) + records.rejected == length // 8 and records.rest == length % 8
        notes = sum(value >> 26 & 31 == 31 for value in np.frombuffer(data[: length // 4 * 4], "<u4").tolist())
        assert len(words.cycle) == length // 4 - notes and words.rest == length % 4


NAMES = ("IDLE", "w_ctrl", "odom")


@pytest.mark.parametrize(("format", "size"), [("text", 40), ("record", 24), ("word", 12)])
def test_what_a_stream_drops_is_in_the_stream(format, size):
    """Every stamp is either received or in a note, and the note stands where the stamps are missing."""
    rng = random.Random(format)
    stream, wire, put = Stream(100, format, NAMES), b"", []
    for i in range(400):
        put.append((i, stream.put(NAMES[i % 3], 216 * i, i % 2 == 0)))
        assert len(stream) <= 100
        if rng.random() < 0.4:
            wire += stream.take(rng.randrange(size))
    wire += stream.close()
    kept = [i for i, taken in put if taken]
    assert stream.dropped == 400 - len(kept) > 50 and stream.pending == 0
    if format == "text":
        lines = wire.decode().splitlines()
        times = [int(line.split()[1]) for line in lines if not line.startswith("#")]
        drops = [(sum(not x.startswith("#") for x in lines[:n]), int(x.split()[2])) for n, x in enumerate(lines) if x[0] == "#"]
    else:
        found = {"record": decode_records, "word": decode_words}[format](wire)
        times, drops = (found.cycle // 216).tolist(), found.dropped.tolist()
    assert times == kept and sum(many for _, many in drops) == stream.dropped
    for place, many in drops:
        before, after = ([-1, *kept][place], [*kept, 400][place])
        assert after - before - 1 == many


def test_binary_streams_become_the_text_that_the_reader_of_logs_takes():
    stream = Stream(80, "word", NAMES)
    for i in range(30):
        stream.put("w_ctrl", 21_600 * i, i % 2 == 0)
    text = b"".join(decode_words(stream.close()).lines(NAMES))
    trace, report = read_log(text)
    assert text.splitlines()[-1] == b"# dropped 10" and report.as_dict()["comments"] == 1
    assert text_line("w_ctrl", 21_600, False) == b"w_ctrl 100 0\n" and b"w_ctrl 100 0\n" in text
    assert trace.names == ("w_ctrl",) and len(trace.time) == 20


def test_a_stream_of_words_can_say_the_time():
    silent = [0, 3 * 2**26 + 7]
    for every, known in ((2**25, silent), (2**26 + 1, [0, 7])):
        stream = Stream(100, "word", NAMES)
        stream.put("IDLE", silent[0], True)
        for cycle in range(every, silent[1], every):
            assert stream.alive(cycle)
        stream.put("IDLE", silent[1], True)
        assert decode_words(stream.close()).cycle.tolist() == known
    full = Stream(6, "word", NAMES)
    assert full.alive(0) and not full.alive(1) and len(full) == 4 and full.dropped == 0
    with pytest.raises(ValueError, match=r"^the format 'record' has no words of time alone; only 'word' has$"):
        Stream(100, "record", NAMES).alive(0)


def test_names_and_formats_have_limits():
    with pytest.raises(ValueError, match=r"^there is no format 'xml'; there are text, record, word$"):
        Stream(10, "xml", NAMES)
    with pytest.raises(ValueError, match=r"^32 names; in the format 'word' at most 31 are allowed$"):
        Stream(10, "word", [str(i) for i in range(32)])
    with pytest.raises(ValueError, match=r"^the baud rate is 0; a whole number from 1 to 1000000000 is allowed$"):
        link_load(8, 1000, 0)


TEXT = 17.35  # bytes of a line, on average


@pytest.mark.parametrize(("size", "hz", "megabaud", "percent"), [
    (TEXT, 1000, 12.5, 17), (TEXT, 5000, 12.5, 83), (TEXT, 10_000, 12.5, 167), (TEXT, 1000, 2, 104), (8, 10_000, 12.5, 77),
    (4, 10_000, 12.5, 38),
])  # fmt: skip
def test_load_of_the_link_with_twelve_stamps_per_period(size, hz, megabaud, percent):
    assert round(100 * link_load(size, 12 * hz, int(megabaud * 1e6))) == percent


# --------------------------------------------------------------------------------------------------------------- lessons


def test_every_variant_has_its_lesson_and_names_its_orders():
    assert LESSONS.keys() == VARIANTS.keys()
    for name, lesson in LESSONS.items():
        for order in lesson.orders:
            assert order == "seq_cst" or f"memory_order_{order}" in lesson.code, (name, order)
        assert lesson.why and (lesson.orders or "lock()" in lesson.code)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
@pytest.mark.parametrize("variant", LESSONS)
def test_the_lessons_are_c11(variant):
    command = [
        "gcc",
        "-std=c11",
        "-pedantic",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wno-unused-variable",
        "-fsyntax-only",
        "-x",
        "c",
        "-",
    ]
    done = subprocess.run(command, input=PREAMBLE + LESSONS[variant].code, text=True, capture_output=True)
    assert done.returncode == 0, done.stderr
