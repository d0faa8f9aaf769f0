"""Hundreds of small shapes as one line that is filled: plotly then has one element to draw, not one for each of them."""

from __future__ import annotations

import numpy as np

#: Corners of shapes between -1 and 1, across and up.
CROSS = np.array([[0, 0.6, 1, 0.4, 1, 0.6, 0, -0.6, -1, -0.4, -1, -0.6], [0.4, 1, 0.6, 0, -0.6, -1, -0.4, -1, -0.6, 0, 0.6, 1]])
SPOT = np.array([[1, 0.5, -0.5, -1, -0.5, 0.5], [0, 0.87, 0.87, 0, -0.87, -0.87]])


def outline(
    shape: np.ndarray, x: np.ndarray, y: np.ndarray, wide: float, high: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The shape at each of n places.

    The line goes round each of them, from one to the next, and the same way back, so that nothing between them is filled. (At a
    gap in it plotly would begin another element.)

    Args:
        shape: corners, shape (2, k). x, y: places, shape (n,). wide, high: from the middle to the outermost corner.

    Returns:
        x and y of the line, and which of the places each of its points belongs to, shape (n * (k + 2),).
    """
    n, round_ = len(x), np.append(np.arange(shape.shape[1]), 0)
    place = np.concatenate([np.repeat(np.arange(n), len(round_)), np.arange(n)[::-1]])
    corner = np.concatenate([np.tile(round_, n), np.zeros(n, np.int64)])
    return x[place] + wide * shape[0, corner], y[place] + high * shape[1, corner], place
