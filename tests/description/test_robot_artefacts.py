"""What is generated from the description and kept in the package: URDF and meshes."""

from __future__ import annotations

import re
import struct
import subprocess
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from agribot.core.messages import FloatArray
from agribot.description import mesh_files
from agribot.description.export import ARTEFACT, format_tree, write_artefact
from agribot.description.loader import export_urdf, load_robot
from agribot.description.package import PACKAGE, ROOT, list_robot_files
from tests import machine


def test_packaged_urdf_is_current() -> None:
    assert ARTEFACT.read_text("utf-8") == export_urdf(), "run python -m agribot.description.export"


def test_packaged_urdf_is_what_the_writer_writes(tmp_path: Path) -> None:
    assert write_artefact(tmp_path / "x.urdf").read_bytes() == ARTEFACT.read_bytes()


def test_packaged_urdf_knows_nothing_of_this_machine() -> None:
    text = ARTEFACT.read_text("utf-8")
    assert str(ROOT) not in text and "file://" not in text


def test_plugin_tags_are_spelt_as_the_plugins_read_them() -> None:
    tags = {element.tag for plugin in ET.parse(ARTEFACT).iter("plugin") for element in plugin}
    for tag in ("updateRate", "bodyName", "topicName", "gaussianNoise", "velocityGaussianNoise"):
        assert tag in tags and tag.lower() not in tags


def test_tree_shows_every_link_once_below_its_parent() -> None:
    robot = load_robot()
    lines = format_tree(robot).splitlines()
    assert lines[0] == robot.name and lines[1] == "dummy_link"
    named = [re.sub(r"[│├└─ ]*(\w+).*", r"\1", line) for line in lines[1:]]
    assert sorted(named) == sorted(link.name for link in robot.links)
    optical = next(line for line in lines if "camera_optical_frame" in line)
    assert optical.index("camera_optical") > lines[2].index("base_link")


def test_meshes_are_current() -> None:
    for name, build in mesh_files.MESHES.items():
        assert (mesh_files.FOLDER / name).read_bytes() == mesh_files.encode_stl(build()), (
            "run python -m agribot.description.mesh_files"
        )


def test_every_mesh_is_used_and_every_used_mesh_is_there() -> None:
    used = {
        re.sub(rf"^package://{PACKAGE}/meshes/", "", mesh.get("filename", ""))
        for robot in list_robot_files()
        for mesh in ET.fromstring(export_urdf(robot)).iter("mesh")
    }
    there = {file.name for file in mesh_files.FOLDER.iterdir()}
    assert used == there == set(mesh_files.MESHES)
    assert all(" " not in name for name in there)


def test_meshes_are_small() -> None:
    for file in mesh_files.FOLDER.iterdir():
        assert file.stat().st_size < 60_000


def _read_stl(file: Path) -> FloatArray:
    """Corners (N, 3, 3) of a binary STL file."""
    data = file.read_bytes()
    (count,) = struct.unpack_from("<I", data, 80)
    assert len(data) == 84 + 50 * count
    corners = [struct.unpack_from("<12f", data, 84 + 50 * i)[3:] for i in range(count)]
    return np.array(corners).reshape(-1, 3, 3)


def _volume_m3(corners: FloatArray) -> float:
    return float(np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2]))) / 6.0


@pytest.mark.parametrize("name", mesh_files.MESHES)
def test_meshes_are_closed_and_face_outwards(name: str) -> None:
    corners = _read_stl(mesh_files.FOLDER / name)
    edges = Counter(
        (tuple(triangle[i]), tuple(triangle[(i + 1) % 3])) for triangle in corners for i in range(3)
    )
    assert all(edges[(b, a)] == count for (a, b), count in edges.items())
    assert _volume_m3(corners) > 0.0


def test_wheel_mesh_has_the_size_of_the_wheel() -> None:
    corners = _read_stl(mesh_files.FOLDER / "wheel.stl").reshape(-1, 3)
    drive = load_robot().drive
    radii = np.hypot(corners[:, 1], corners[:, 2])
    assert radii.max() == pytest.approx(drive.wheel_radius_m, abs=2e-6)
    assert np.ptp(corners[:, 0]) == pytest.approx(drive.wheel_width_m, abs=1e-6)
    cylinder_m3 = np.pi * drive.wheel_radius_m**2 * drive.wheel_width_m
    assert 0.5 < _volume_m3(_read_stl(mesh_files.FOLDER / "wheel.stl")) / cylinder_m3 < 1.0


def test_chassis_mesh_touches_the_axles_and_clears_the_wheels() -> None:
    corners = _read_stl(mesh_files.FOLDER / "chassis.stl").reshape(-1, 3)
    drive = load_robot().drive
    near_axles = corners[corners[:, 2] < -0.17]
    assert np.abs(near_axles[:, 1]).max() == pytest.approx(
        drive.track_m / 2 - drive.wheel_width_m / 2, abs=1e-6
    )


def _run(command: list[str]) -> str:
    machine.require(command[0])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("legacy", ["false", "true"])
def test_urdf_passes_the_checkers_of_ros_and_gazebo(tmp_path: Path, legacy: str) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(export_urdf(mappings={"legacy_camera": legacy}), "utf-8")
    assert "Successfully Parsed" in _run(["check_urdf", str(file)])
    assert "Valid." in _run(["ign", "sdf", "-k", str(file)])
