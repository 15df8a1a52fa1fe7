"""Binary STL meshes, as the robot's visuals name them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np

from agribot.core.errors import DescriptionError, explain_os_error
from agribot.core.messages import FloatArray

HEADER_BYTES, COUNT_BYTES = 80, 4
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
FARTHEST = 1e6  # largest coordinate in the file's unit, often millimetres
OWN_PACKAGE = "package://agribot_description/"


def find_mesh_file(name: str) -> Path:
    """Find the file of a mesh name in a robot description.

    Names of our own description package are found in it; any other is a path.
    """
    if name.startswith(OWN_PACKAGE):
        folder = Path(str(resources.files("agribot"))) / "description"
        return folder / name.removeprefix(OWN_PACKAGE)
    return Path(name.removeprefix("file://"))


def read_stl(path: Path) -> FloatArray:
    """Read triangles (n, 3, 3), counter-clockwise seen from outside, in the file's unit.

    Raises: DescriptionError: no such file, or it is not binary STL, or nothing of a robot's size.
    """
    with explain_os_error(
        f"cannot read the mesh {path}", "check the description's mesh names", DescriptionError
    ):
        data = path.read_bytes()
    start = HEADER_BYTES + COUNT_BYTES
    count = int(np.frombuffer(data[HEADER_BYTES:start], "<u4")[0]) if len(data) >= start else -1
    wanted = start + count * TRIANGLE.itemsize
    if count < 0 or len(data) != wanted:
        raise DescriptionError(
            f"the mesh {path} has {len(data)} bytes, a binary STL of {max(count, 0)} triangles "
            f"has {max(wanted, start)}; convert it to binary STL"
        )
    corners: FloatArray = np.frombuffer(data, TRIANGLE, offset=start)["corners"].astype(float)
    if not count or not np.abs(corners).max() <= FARTHEST:
        raise DescriptionError(
            f"the mesh {path} has {count} triangles, whose corners must be numbers up to "
            f"{FARTHEST:g}; export it again"
        )
    return corners
