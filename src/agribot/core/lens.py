"""Lens distortion: where a lens puts image points, and the way back.

Source of the model: Brown 1966, with OpenCV's order of the coefficients k1, k2, p1, p2. Image
points are in units of the focal length, from the principal point.
"""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray

ITERATIONS = 60
Coefficients = tuple[float, float, float, float]


def distorted(ideal: FloatArray, coefficients: Coefficients) -> FloatArray:
    """Where a lens puts the image points (..., 2) of a pinhole."""
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


def undistorted(seen: FloatArray, coefficients: Coefficients) -> FloatArray:
    """The inverse of `distorted`, by damped fixed-point steps.

    Strong coefficients have none at the edges: compare `distorted` of the result with `seen`.
    """
    ideal = seen.copy()
    for _ in range(ITERATIONS):
        ideal = np.clip(ideal + 0.7 * (seen - distorted(ideal, coefficients)), -10.0, 10.0)
    return ideal
