"""Many shapes as one line: each is filled, what lies between them is not."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from labkit.figures.outline import CROSS, SPOT, outline

places = st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), max_size=12)


def area(x: np.ndarray, y: np.ndarray) -> float:
    """Of a closed line, by the shoelace formula; what it surrounds the other way round counts negative."""
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


@given(places, st.sampled_from([CROSS, SPOT]))
def test_only_the_shapes_are_filled(at, shape):
    x, y = np.array(at, float).reshape(-1, 2).T
    line_x, line_y, which = outline(shape, x, y, 0.3, 0.2)
    assert len(line_x) == len(line_y) == len(which) == len(x) * (shape.shape[1] + 2)
    assert np.isfinite(line_x).all() and np.isfinite(line_y).all(), "a gap would begin another element"
    assert np.isclose(area(line_x, line_y), len(x) * area(0.3 * shape[0], 0.2 * shape[1]))
    assert np.all(np.abs(line_x - x[which]) <= 0.3 + 1e-9) and np.all(np.abs(line_y - y[which]) <= 0.2 + 1e-9)
    there = list(zip(line_x, line_y, strict=True))
    ways = list(zip(there, [*there[1:], *there[:1]], strict=True))
    first = [(a + 0.3 * shape[0, 0], b + 0.2 * shape[1, 0]) for a, b in zip(x, y, strict=True)]
    between = [way for way in ways if way[0] in first and way[1] in first and way[0] != way[1]]
    assert sorted(between) == sorted((end, begin) for begin, end in between), "each way is gone back"
