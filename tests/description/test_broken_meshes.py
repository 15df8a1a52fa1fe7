"""Cut and damaged meshes, height maps and map pictures: read, replaced with a warning, or refused
in one sentence; never anything else.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.core.errors import AgribotError, DescriptionError
from agribot.description.loader import export_urdf, load_robot
from agribot.description.mesh_files import encode_stl, make_box
from agribot.description.ros_map import load_ros_map
from agribot.description.worlds_sdf import load_world
from agribot.sim.stl import read_stl

CUBE = make_box((0.0, 0.0, 0.5), (1.0, 1.0, 1.0))
OBJ = "\n".join(f"v {x} {y} {z}" for x, y, z in CUBE.reshape(-1, 3))
ASCII = "solid cube\n" + "\n".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
    + "endloop\nendfacet"
    for triangle in CUBE
)
NUMBERS = " ".join(f"{value:g}" for value in CUBE.ravel())
DAE = f"""<COLLADA><asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset><mesh>
<float_array id="cube-positions-array" count="{CUBE.size}">{NUMBERS}</float_array>
</mesh></COLLADA>"""
MESHES = {
    "cube.stl": encode_stl(CUBE),
    "text.stl": ASCII.encode(),
    "cube.obj": OBJ.encode(),
    "cube.dae": DAE.encode(),
}
WORLD = """<sdf version="1.7"><world name="w">
<model name="ground"><static>true</static><link name="l"><collision name="c"><geometry><plane>
<normal>0 0 1</normal><size>20 20</size></plane></geometry></collision></link></model>
<model name="rock"><static>true</static><pose>5 0 0 0 0 0</pose><link name="l"><collision name="c">
<geometry><mesh><uri>MESH</uri></mesh></geometry></collision></link></model></world></sdf>"""
HILLS = """<sdf version="1.7"><world name="w"><model name="hills"><static>true</static>
<link name="l"><collision name="c"><geometry><heightmap><uri>MAP</uri><size>20 20 3</size>
</heightmap></geometry></collision></link></model></world></sdf>"""
YAML = """image: map.png
resolution: 0.1
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def _picture(mode: str = "PNG") -> bytes:
    file = io.BytesIO()
    heights = np.linspace(0, 65535, 33 * 33).reshape(33, 33).astype(np.uint16)
    Image.fromarray(heights if mode == "PNG" else (heights // 256).astype(np.uint8)).save(
        file, mode
    )
    return file.getvalue()


def _samples() -> bytes:
    file = io.BytesIO()
    np.save(file, np.linspace(0.0, 2.0, 33 * 33).reshape(33, 33))
    return file.getvalue()


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One of: cut off, a stretch lost, a stretch doubled, bytes changed, the head changed."""
    first, last = sorted(rng.integers(0, len(data), 2).tolist())
    last = min(last, first + 200)
    kind = int(rng.integers(5))
    if kind == 0:
        return data[:first]
    if kind == 1:
        return data[:first] + data[last:]
    if kind == 2:
        return data[:last] + data[first:]
    at = first if kind == 3 else int(rng.integers(min(len(data), 100)))
    return data[:at] + rng.bytes(4) + data[at + 4 :]


def read_world(folder: Path, name: str) -> None:
    text = (HILLS if name.startswith("map.") else WORLD).replace("MESH", name).replace("MAP", name)
    (folder / "x.world").write_text(text, "utf-8")
    world = load_world(str(folder / "x.world"))
    sizes = [shape.size_m for thing in world.obstacles for shape in thing.shapes]
    assert np.isfinite(np.array(sizes)).all()


def read_visual(folder: Path, name: str) -> None:
    assert np.isfinite(read_stl(folder / name)).all()


def read_robot(folder: Path, name: str) -> None:
    """A robot whose wheels have the mesh as their only shape: the radius comes from it."""
    text = export_urdf().replace("package://agribot_description/meshes/wheel.stl", name)
    assert name in text
    (folder / "robot.urdf").write_text(text, "utf-8")
    load_robot(str(folder / "robot.urdf"))


def read_map(folder: Path, name: str) -> None:
    (folder / "map.yaml").write_text(YAML.replace("map.png", name), "utf-8")
    load_ros_map(folder / "map.yaml")


FILES: dict[str, tuple[Callable[[Path, str], None], bytes, int]] = {
    **{f"world with {name}": (read_world, data, 40) for name, data in MESHES.items()},
    "robot with cube.stl": (read_robot, MESHES["cube.stl"], 15),
    "visual of cube.stl": (read_visual, MESHES["cube.stl"], 150),
    "heights of map.png": (read_world, _picture(), 80),
    "heights of map.jpg": (read_world, _picture("JPEG"), 40),
    "heights of map.npy": (read_world, _samples(), 80),
    "cells of map.png": (read_map, _picture(), 80),
}


@pytest.mark.parametrize("kind", FILES)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(kind: str, tmp_path: Path) -> None:
    read, data, count = FILES[kind]
    name, rng = kind.rsplit(maxsplit=1)[-1], np.random.default_rng(len(kind))
    (tmp_path / name).write_bytes(data)
    read(tmp_path, name)  # as it is, it is sound
    for _ in range(count):
        (tmp_path / name).write_bytes(damaged(data, rng))
        try:
            read(tmp_path, name)
        except AgribotError as error:
            assert 10 < len(str(error)) < 1000


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_that_is_touched_has_the_size_of_its_bounds(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(MESHES[name])
    (tmp_path / "x.world").write_text(WORLD.replace("MESH", name), "utf-8")
    (rock,) = load_world(str(tmp_path / "x.world")).obstacles
    (shape,) = rock.shapes
    side_m = 0.5 if name == "cube.dae" else 1.0  # its unit is half a metre
    assert shape.kind == "box"
    assert shape.size_m == pytest.approx((side_m, side_m, side_m))


def test_a_picture_that_unpacks_to_gigabytes_is_refused_by_its_head(tmp_path: Path) -> None:
    data = bytearray(_picture())
    data[16:24] = struct.pack(">II", 60_000, 60_000)
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    (tmp_path / "map.png").write_bytes(bytes(data))
    with warnings.catch_warnings(), pytest.raises(DescriptionError, match=r"map\.png"):
        warnings.simplefilter("error")
        read_map(tmp_path, "map.png")


def test_heights_that_claim_a_huge_array_or_hold_no_number_are_refused(tmp_path: Path) -> None:
    huge = _samples().replace(b"(33, 33)", b"(9**9,9)")
    flat = io.BytesIO()
    np.save(flat, np.full((9, 9), np.nan))
    huge_shape = _samples().replace(b"'shape': (33, 33), }", b"'shape':(1000000,1000000)}")
    for data in (huge, flat.getvalue(), huge_shape):
        (tmp_path / "map.npy").write_bytes(data)
        with pytest.raises(DescriptionError, match=r"map\.npy"):
            read_world(tmp_path, "map.npy")
