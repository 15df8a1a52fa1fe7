"""The size of a mesh file, for a box in its place."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from agribot.core.messages import FloatArray

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def measure_mesh_m(path: Path) -> tuple[FloatArray, FloatArray] | None:
    """Return the lowest and highest corner, (3,) each, m; None where the file cannot be read."""
    points = read_mesh_points(path)
    return None if points is None else (points.min(axis=0), points.max(axis=0))


def read_mesh_points(path: Path) -> FloatArray | None:
    """Read the corners (n, 3) of a mesh, m; None where the file cannot be read."""
    read = {".stl": _read_stl, ".obj": _read_obj, ".dae": _read_dae}.get(path.suffix.lower())
    if read is None:
        return None
    try:
        points = read(path.read_bytes())
    except (OSError, ValueError, struct.error):
        return None
    if len(points) == 0 or not np.isfinite(points).all():
        return None
    return points


def _read_stl(data: bytes) -> FloatArray:
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else 0
    if count > 0 and 84 + 50 * count <= len(data) < 84 + 50 * count + 50:
        record = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("spare", "<u2")])
        corners: FloatArray = np.frombuffer(data, record, count, 84)["corner"].astype(np.float64)
        return corners.reshape(-1, 3)
    return _read_rows(data, rb"vertex\s+")


def _read_obj(data: bytes) -> FloatArray:
    return _read_rows(data, rb"(?m)^v\s+")


def _read_rows(data: bytes, before: bytes) -> FloatArray:
    three = rb"\s+".join([rb"(" + NUMBER.encode() + rb")"] * 3)
    found = re.findall(before + three, data)
    return np.array([[float(word) for word in row] for row in found]).reshape(-1, 3)


def _read_dae(data: bytes) -> FloatArray:
    """Read the points (n, 3) of the file; transforms of its nodes are ignored."""
    text = data.decode("utf-8", "replace")
    unit = re.search(rf'<unit[^>]*meter="({NUMBER})"', text)
    arrays = re.findall(r'<float_array[^>]*id="[^"]*[Pp]osition[^"]*"[^>]*>([^<]*)<', text)
    points = np.array([float(word) for array in arrays for word in array.split()])
    points = points[: len(points) // 3 * 3].reshape(-1, 3) * (float(unit.group(1)) if unit else 1.0)
    if "Y_UP" in text:
        points = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    return points
