"""Lens distortion: where a lens puts image points, and the way back.

Source of the model: Brown 1966, with OpenCV's order of the coefficients k1, k2, p1, p2. Image
points are in units of the focal length, from the principal point.
"""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray

ITERATIONS = 60
Coefficients = tuple[float, float, float, float]


def distort(ideal: FloatArray, coefficients: Coefficients) -> FloatArray:
    """Map the ideal image points of a pinhole, (..., 2), to where the lens puts them, (..., 2)."""
    k1, k2, p1, p2 = coefficients
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2 * r2
    seen: FloatArray = np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )
    return seen


def undistort(seen: FloatArray, coefficients: Coefficients) -> FloatArray:
    """Invert `distort` by damped fixed-point steps; (..., 2) to (..., 2).

    Strong coefficients have none at the edges: compare `distort` of the result with `seen`.
    """
    ideal = seen.copy()
    for _ in range(ITERATIONS):
        ideal = np.clip(ideal + 0.7 * (seen - distort(ideal, coefficients)), -10.0, 10.0)
    return ideal
