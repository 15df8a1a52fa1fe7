"""The meshes of the robot, built from numbers and written as binary STL.

`python -m agribot.description.mesh_files` writes them again; a test holds the bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from agribot.core.messages import FloatArray, Vec3
from agribot.description.package import ROOT

FOLDER = ROOT / "meshes"

# Measures of the machine that the description scales the meshes from.
WHEEL_RADIUS_M, WHEEL_WIDTH_M = 0.09, 0.05
HALF_WHEELBASE_M, HALF_TRACK_M, AXLE_DROP_M = 0.2519, 0.3908, 0.1908
LEG_Y_M = HALF_TRACK_M - 0.07
BOOM_X_M, NOZZLES, NOZZLE_SPACING_M = -0.35, 27, 0.04

WHEEL_SEGMENTS = 36
LUG_DEPTH_M = 0.005
# Left half of the wheel's cross-section from the axis outwards: along the axle, radius.
WHEEL_PROFILE_M = (
    (-0.025, 0.0),
    (-0.025, 0.022),
    (-0.010, 0.026),
    (-0.010, 0.062),
    (-0.022, 0.066),
    (-0.025, 0.080),
)


def make_box(centre_m: Vec3, size_m: Vec3) -> FloatArray:
    """Make a box of outward triangles (12, 3, 3)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    triangles: FloatArray = (corners * np.array(size_m) + np.array(centre_m))[np.array(faces)]
    return triangles


def make_lathed(profile_m: Sequence[Sequence[tuple[float, float]]]) -> FloatArray:
    """Make a closed solid around the x axis.

    Args:
        profile_m: one cross-section for each step around the axis, each from the axis to the
            axis again as (x, radius).

    Returns: outward triangles (N, 3, 3).
    """
    steps = len(profile_m)
    rings = np.array(
        [
            [(x, r * math.cos(k * math.tau / steps), r * math.sin(k * math.tau / steps))
             for x, r in section]
            for k, section in enumerate(profile_m)
        ]
    )  # fmt: skip
    triangles = []
    for here, there in zip(rings, np.roll(rings, -1, axis=0), strict=True):
        last = len(here) - 2
        for i in range(last + 1):
            a, b, c, d = here[i], here[i + 1], there[i + 1], there[i]
            if i > 0:  # the first strip touches the axis: its a and d are one point
                triangles.append((a, d, c))
            if i < last:
                triangles.append((a, c, b))
    return np.array(triangles)


def make_wheel() -> FloatArray:
    """Make a wheel with chevron lugs, triangles (N, 3, 3); the axle is the x axis."""

    def section(step: int) -> list[tuple[float, float]]:
        def tread_m(shift: int) -> float:
            return WHEEL_RADIUS_M - (LUG_DEPTH_M if (step + shift) % 4 >= 2 else 0.0)

        left = [*WHEEL_PROFILE_M, (-WHEEL_WIDTH_M / 2.0, tread_m(0))]
        return [*left, (0.0, tread_m(1)), *((-x, radius) for x, radius in reversed(left))]

    return make_lathed([section(step) for step in range(WHEEL_SEGMENTS)])


def make_frame() -> FloatArray:
    """Make deck, legs, axle stubs and a case on the deck, triangles (N, 3, 3)."""
    deck_m = (2 * HALF_WHEELBASE_M + 0.14, 2 * HALF_TRACK_M - 0.13, 0.05)
    stub_m = HALF_TRACK_M - WHEEL_WIDTH_M / 2.0 - LEG_Y_M
    parts = [make_box((0.0, 0.0, 0.0), deck_m), make_box((-0.1, 0.0, 0.09), (0.28, 0.34, 0.13))]
    for front in (-1.0, 1.0):
        for left in (-1.0, 1.0):
            x_m = front * HALF_WHEELBASE_M
            parts += [
                make_box((x_m, left * LEG_Y_M, -AXLE_DROP_M / 2), (0.03, 0.03, AXLE_DROP_M)),
                make_box((x_m, left * (LEG_Y_M + stub_m / 2), -AXLE_DROP_M), (0.02, stub_m, 0.02)),
            ]
    return np.concatenate(parts)


def make_chassis() -> FloatArray:
    """Make the frame with the spray boom and its nozzles, triangles (N, 3, 3)."""
    parts = [make_frame(), make_box((BOOM_X_M, 0.0, 0.035), (0.02, 1.08, 0.02))]
    parts += [make_box((-0.32, y_m, 0.035), (0.08, 0.02, 0.02)) for y_m in (-0.25, 0.25)]
    for nozzle in range(NOZZLES):
        y_m = ((NOZZLES - 1) / 2.0 - nozzle) * NOZZLE_SPACING_M
        parts.append(make_box((BOOM_X_M, y_m, 0.01), (0.015, 0.015, 0.04)))
    return np.concatenate(parts)


def make_camera_housing() -> FloatArray:
    """Make a housing that looks along x, with its lens at the origin, triangles (N, 3, 3)."""
    lens = [(-0.012, 0.0), (-0.012, 0.018), (0.0, 0.018), (0.0, 0.0)]
    return np.concatenate(
        [make_box((-0.03, 0.0, 0.0), (0.04, 0.06, 0.05)), make_lathed([lens] * 16)]
    )


def make_sensor_box() -> FloatArray:
    """Make a housing of 5 cm with a lid, triangles (N, 3, 3)."""
    return np.concatenate(
        [
            make_box((0.0, 0.0, -0.005), (0.05, 0.05, 0.04)),
            make_box((0.0, 0.0, 0.02), (0.042, 0.042, 0.01)),
        ]
    )


MESHES: dict[str, Callable[[], FloatArray]] = {
    "chassis.stl": make_chassis,
    "frame.stl": make_frame,
    "wheel.stl": make_wheel,
    "camera_housing.stl": make_camera_housing,
    "sensor_box.stl": make_sensor_box,
}


def encode_stl(triangles_m: FloatArray) -> bytes:
    """Encode triangles (N, 3, 3) as binary STL, rounded to a micrometre: the same everywhere."""
    corners = np.round(triangles_m, 6) + 0.0  # no negative zeros
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")]
    )
    records["normal"] = np.round(normals, 4) + 0.0
    records["corners"] = corners
    header = b"AGRIBOT mesh, metres".ljust(80, b" ")
    return b"".join((header, struct.pack("<I", len(corners)), records.tobytes()))


def write_meshes(folder: Path = FOLDER) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, build in MESHES.items():
        (folder / name).write_bytes(encode_stl(build()))


if __name__ == "__main__":
    write_meshes()
