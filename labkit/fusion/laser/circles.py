"""Fitting circles to points, one set or many of the same size at once.

Points have the shape (..., n, 2); centres come as (..., 2), radii as (...).

Sources: I. Kasa, IEEE Trans. Instrumentation and Measurement 25 (1976); G. Taubin, IEEE PAMI 13 (1991), in the centred form of
N. Chernov, *Circular and Linear Regression* (2010), section 5.8.
"""

from __future__ import annotations

import numpy as np

ROUNDS, NEGLIGIBLE = 10, 1e-9  # of Gauss-Newton, at most, and the step in m at which it ends


def kasa(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The circle that minimises the sum of (|p - c|^2 - r^2)^2: linear, and too small on a short arc. At least three points that
    are not in line, else nan.
    """
    mean = xy.mean(axis=-2, keepdims=True)
    p = xy - mean
    square = (p**2).sum(axis=-1)
    (sxx, sxy), (_, syy) = _moments(p)
    zx, zy = (np.mean(square * p[..., i], axis=-1) for i in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        det = 2 * (sxx * syy - sxy**2)
        centre = np.stack([(zx * syy - zy * sxy) / det, (zy * sxx - zx * sxy) / det], axis=-1)
        centre[~np.isfinite(centre)] = np.nan
    return centre + mean[..., 0, :], np.sqrt(square.mean(axis=-1) + (centre**2).sum(axis=-1))


def taubin(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The circle that minimises the sum of (|p - c|^2 - r^2)^2 / (4 |p - c|^2): almost free of Kasa's shrinking. Points in line
    give a huge radius, or nan.
    """
    mean = xy.mean(axis=-2, keepdims=True)
    p = xy - mean
    square = (p**2).sum(axis=-1, keepdims=True)
    size = square.mean(axis=-2, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        design = np.nan_to_num(np.concatenate([(square - size) / (2 * np.sqrt(size)), p], axis=-1))
        _, vectors = np.linalg.eigh(np.swapaxes(design, -1, -2) @ design)
        a = vectors[..., 0]  # of the smallest eigenvalue
        size = size[..., 0, 0]
        a0 = a[..., 0] / (2 * np.sqrt(size))
        centre = -a[..., 1:] / (2 * a0[..., None])
        radius = np.sqrt((a[..., 1:] ** 2).sum(axis=-1) / a0**2 / 4 + size)
    return centre + mean[..., 0, :], radius


def known_radius(xy: np.ndarray, radius: float, start: np.ndarray) -> np.ndarray:
    """The centre that minimises the sum of (|p - c| - radius)^2, by Gauss-Newton from `start` (..., 2).

    The start decides on which side of a short arc the centre is looked for.
    """
    px, py = np.moveaxis(np.asarray(xy, dtype=float), -1, 0)
    x, y = np.moveaxis(np.array(start, dtype=float)[..., None, :], -1, 0)  # a trailing axis for the points
    for _ in range(ROUNDS):
        ux, uy = x - px, y - py
        distance = np.maximum(np.sqrt(ux * ux + uy * uy), 1e-12)
        ux, uy, error = ux / distance, uy / distance, distance - radius
        a, b, d, gx, gy = (q.sum(axis=-1, keepdims=True) for q in (ux * ux, ux * uy, uy * uy, ux * error, uy * error))
        det = np.maximum(a * d - b * b, 1e-9)
        dx, dy = (d * gx - b * gy) / det, (a * gy - b * gx) / det
        length = np.sqrt(dx * dx + dy * dy)
        held = np.minimum(1, radius / np.maximum(length, 1e-30))  # never further than a radius at once
        x, y = x - dx * held, y - dy * held
        if length.max(initial=0) < NEGLIGIBLE:
            break
    return np.concatenate([x, y], axis=-1)


def off_circle(xy: np.ndarray, centre: np.ndarray, radius: float | np.ndarray) -> np.ndarray:
    """Root mean square distance of the points from the circle, (...)."""
    distance = np.sqrt(((xy - np.asarray(centre)[..., None, :]) ** 2).sum(axis=-1))
    return np.sqrt(((distance - np.asarray(radius)[..., None]) ** 2).mean(axis=-1))


def _moments(p: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Means of the products of the coordinates."""
    x, y = p[..., 0], p[..., 1]
    xx, xy, yy = (x * x).mean(axis=-1), (x * y).mean(axis=-1), (y * y).mean(axis=-1)
    return (xx, xy), (xy, yy)
