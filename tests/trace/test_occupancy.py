"""Busy shares of pixel columns against brute force, unit by unit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.trace import occupancy


@st.composite
def disjoint(draw):
    """(row, start, end) of slices that do not overlap within their row, in any order, some of no length; and how many rows."""
    rows = draw(st.integers(1, 3))
    made = []
    for row in range(rows):
        now = draw(st.integers(0, 3))
        for length, gap in draw(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3)), max_size=6)):
            made.append((row, now, now + length))
            now += length + gap
    table = np.array(draw(st.permutations(made)), dtype=np.int64).reshape(-1, 3)
    return table, rows


def edges_of(low, width, columns):
    return low + width * np.arange(columns + 1)


@settings(max_examples=300, deadline=None)
@given(disjoint(), st.integers(-2, 20), st.integers(1, 5), st.integers(1, 8))
def test_shares_are_what_counting_every_unit_gives(drawn, low, width, columns):
    table, rows = drawn
    edges = edges_of(low, width, columns)
    busy = np.zeros((rows, columns))
    for row, start, end in table.tolist():
        for unit in range(start, end):
            if low <= unit < edges[-1]:
                busy[row, (unit - low) // width] += 1
    prepared = occupancy(*table.T, rows)
    assert np.array_equal(prepared.shares(edges) * width, busy)
    assert np.array_equal(prepared.shares(edges.astype(float)) * width, busy)


@settings(max_examples=300, deadline=None)
@given(disjoint(), st.integers(-4, 40).map(lambda x: x / 2), st.integers(0, 24).map(lambda x: x / 2))
def test_a_window_has_the_slices_with_a_part_in_it(drawn, low, width):
    table, rows = drawn
    prepared = occupancy(*table.T, rows)
    inside = [i for i, (_, start, end) in enumerate(table.tolist()) if end > low and start < low + width]
    assert sorted(prepared.inside(low, low + width).tolist()) == inside
    assert prepared.count(low, low + width) == len(inside)


def test_rows_below_0_are_left_out_and_an_empty_picture_is_empty():
    one = np.array([-1, 0]), np.array([0, 2]), np.array([9, 4])
    assert occupancy(*one, 1).shares(np.array([0, 4, 8])).tolist() == [[0.5, 0]]
    none = occupancy(*(np.empty(0, np.int64) for _ in range(3)), 2)
    assert none.count(0, 9) == 0 and not len(none.inside(0, 9)) and none.shares(np.array([0, 9])).tolist() == [[0], [0]]


@pytest.mark.parametrize(
    ("slices", "message"),
    [
        ([(2, 0, 1)], "a slice in row 2; there are 2 rows"),
        ([(0, 5, 3)], "a slice from 5 to 3"),
        ([(0, 0, 5), (1, 1, 2), (0, 4, 6)], "row 0 has a slice to 5 and another from 4"),
    ],
)
def test_what_is_no_occupancy_is_refused(slices, message):
    with pytest.raises(ValueError, match=message):
        occupancy(*np.array(slices).T, 2)


def test_a_million_slices():
    start = np.arange(1_000_000) * 10
    prepared = occupancy(start % 50 // 10, start, start + 7, 5)
    assert prepared.shares(np.linspace(0, 10_000_000, 701)).sum(axis=0) == pytest.approx(0.7, abs=1e-3)
    assert prepared.count(0, 1000) == 100 and len(prepared.inside(500, 1000)) == 50
