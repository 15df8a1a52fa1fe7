"""Shapes of the plain values in messages."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

MapPoint = tuple[float, float]  # East and North, m
Vec3 = tuple[float, float, float]
Four = tuple[float, float, float, float]
FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
ByteArray = npt.NDArray[np.uint8]
