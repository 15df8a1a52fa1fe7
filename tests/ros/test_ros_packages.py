"""The packages for those who have ROS installed: launch files that start, and views that show."""

from __future__ import annotations

import ast
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from ruamel.yaml import YAML

from agribot.core import topics
from agribot.ros.ros1.types import list_outputs
from tests import machine, nightly
from tests.ros.live import ROOT, free_port
from tests.ros.ros1_system import Ros1, ask
from tests.waiting import wait_for

ROS1, ROS2 = ROOT / "ros1" / "agribot_description", ROOT / "ros2" / "agribot_description"
LAUNCH_FILES = sorted(path.name for path in (ROS1 / "launch").glob("*.launch"))
DESCRIPTION = ROOT / "src" / "agribot" / "description"
RVIZ_PLUGINS = "/usr/share/rviz/plugin_description.xml"
TOOLS = {"/initialpose", "/clicked_point", "/goal_pose", "/move_base_simple/goal"}  # they publish

needs_ros1 = machine.needs("roslaunch")
needs_rviz = pytest.mark.skipif(
    machine.find("rviz") is None or machine.find("Xvfb") is None, reason=machine.missing("rviz")
)


def shown(path: Path) -> set[str]:
    """The topics that an RViz view names."""
    return set(re.findall(r"(?:Topic|Value): (/[\w/]+)", path.read_text()))


def test_the_views_show_topics_that_exist() -> None:
    ros1 = {
        output.name for topic in topics.TOPICS if topic.ros_type for output in list_outputs(topic)
    }
    ros2 = {topic.name for topic in topics.TOPICS if topic.ros_type}
    for folder, known in ((ROS1, ros1), (ROS2, ros2)):
        names = shown(folder / "rviz" / "agribot.rviz")
        assert len(names & known) >= 5
        assert names - TOOLS <= known


@needs_rviz
def test_rviz_knows_each_display_tool_and_view_of_its_configuration() -> None:
    """Without a start; in the view for ROS 2 they have the same names in other libraries."""
    known = {
        element.get("name", "").removeprefix("rviz/")
        for element in ElementTree.parse(RVIZ_PLUGINS).getroot().iter("class")
    }
    kinds = [read_kinds(folder / "rviz" / "agribot.rviz") for folder in (ROS1, ROS2)]
    assert kinds[0] == kinds[1]
    assert set(kinds[0]) <= known
    assert kinds[0].count("Orbit") == 1 and len(kinds[0]) > 12


def read_kinds(path: Path) -> list[str]:
    manager = YAML(typ="safe").load(path)["Visualization Manager"]
    parts = [*manager["Displays"], *manager["Tools"], manager["Views"]["Current"]]
    assert all(part.get("Enabled", True) for part in parts)
    return [part["Class"].partition("/")[2] for part in parts]


@pytest.mark.parametrize("name", LAUNCH_FILES)
def test_what_a_launch_file_includes_and_starts_of_its_package_is_there(name: str) -> None:
    launch = ElementTree.parse(ROS1 / "launch" / name).getroot()
    assert launch.tag == "launch"
    folders = re.compile(r"\$\(find agribot_description\)/([\w./]+)")
    texts = [value for element in launch.iter() for value in element.attrib.values()]
    named = [ROS1 / path for text in texts for path in folders.findall(text)]
    named += [
        ROS1 / "scripts" / node.get("type", "")
        for node in launch.iter("node")
        if node.get("pkg") == "agribot_description"
    ]
    assert all(path.is_file() for path in named)
    arguments = {arg.get("name") for arg in launch.findall("arg")}
    used = {arg for text in texts for arg in re.findall(r"\$\(arg (\w+)\)", text)}
    assert used == arguments


def test_the_description_is_linked_and_never_copied() -> None:
    for name in ("meshes", "urdf"):
        assert (ROS1 / name).is_symlink()
        assert (ROS1 / name).resolve() == (DESCRIPTION / name).resolve()
    assert not list(ROS2.rglob("*.xacro")) + list(ROS2.rglob("*.stl"))


def test_the_ros2_package_installs_launch_files_view_and_description(tmp_path: Path) -> None:
    command = [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(tmp_path)]
    command += ["install_data", "--install-dir", str(tmp_path / "installed")]
    subprocess.run(command, cwd=ROS2, check=True, timeout=120, capture_output=True)
    share = tmp_path / "installed" / "share"
    assert (share / "ament_index/resource_index/packages/agribot_description").is_file()
    installed = {str(path.relative_to(share)) for path in share.rglob("*") if path.is_file()}
    wanted = {f"launch/{path.name}" for path in (ROS2 / "launch").iterdir()}
    wanted |= {"rviz/agribot.rviz", "package.xml"}
    wanted |= {f"{k}/{p.name}" for k in ("urdf", "meshes") for p in (DESCRIPTION / k).iterdir()}
    assert {f"agribot_description/{name}" for name in wanted} <= installed
    mesh = "agribot_description/meshes/wheel.stl"
    assert (share / mesh).read_bytes() == (DESCRIPTION / "meshes" / "wheel.stl").read_bytes()


def test_both_packages_are_called_as_the_urdf_calls_its_meshes() -> None:
    urdf = (DESCRIPTION / "urdf" / "agribot.urdf").read_text()
    (package,) = set(re.findall(r'"package://(\w+)/', urdf))
    for folder, kind in ((ROS1, "catkin"), (ROS2, "ament_python")):
        manifest = ElementTree.parse(folder / "package.xml").getroot()
        assert manifest.findtext("name") == package == folder.name
        texts = {element.text for element in manifest.iter()}
        assert kind in texts


def test_every_ros2_launch_file_describes_a_launch() -> None:
    for path in (ROS2 / "launch").glob("*.launch.py"):
        functions = [
            node.name
            for node in ast.parse(path.read_text()).body
            if isinstance(node, ast.FunctionDef)
        ]
        assert functions == ["generate_launch_description"], path.name


# ------------------------------------------------------------------ with Debian's ROS 1


@pytest.fixture(scope="module")
def ros1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros1]:
    """A ROS 1 that finds the package, and `agribot` in its PATH."""
    with closing(Ros1(tmp_path_factory.mktemp("ros1"))) as ros:
        ros.add_package()
        yield ros


def run(ros: Ros1, *command: str) -> str:
    done = subprocess.run(
        command, env=ros.environment, cwd=ros.folder, timeout=120, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_ros1
@pytest.mark.parametrize(
    "name",
    [
        "agribot.launch",
        *(
            pytest.param(
                name,
                marks=nightly.by_day(
                    "test_what_a_launch_file_includes_and_starts_of_its_package_is_there"
                ),
            )
            for name in LAUNCH_FILES
            if name != "agribot.launch"
        ),
    ],
)
def test_roslaunch_understands_every_launch_file_and_finds_what_it_starts(
    ros1: Ros1, name: str
) -> None:
    nodes = run(ros1, "roslaunch", "--nodes", "agribot_description", name).split()
    assert nodes
    for node in nodes:
        if "program" in node:
            run(ros1, "roslaunch", "--args", node, "agribot_description", name)


@needs_ros1
def test_the_description_alone_gives_the_model_and_its_frames(ros1: Ros1) -> None:
    process = ros1.start("roslaunch", "agribot_description", "agribot_description.launch")
    wait_for(lambda: "/robot_state_publisher" in ros1.publishers().get("/tf", []), "frames", 120.0)
    wait_for(lambda: "/joint_states" in ros1.publishers(), "joint states", 120.0)
    model = ask(ros1.uri, "getParam", "/robot_description")[2]
    assert "package://agribot_description/meshes/wheel.stl" in model
    ros1.stop(process)


@nightly.by_day(
    "test_the_views_show_topics_that_exist",
    "test_rviz_knows_each_display_tool_and_view_of_its_configuration",
    "test_roslaunch_understands_every_launch_file_and_finds_what_it_starts",
)
@needs_ros1
@needs_rviz
def test_rviz_shows_the_farm(ros1: Ros1, tmp_path: Path) -> None:
    """Starts run and view by the one launch file and looks at the screen."""
    number = 100 + free_port() % 500
    ros1.environment |= {
        "DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1", "QT_X11_NO_MITSHM": "1",
    }  # fmt: skip
    screen = tmp_path / "Xvfb_screen0"
    display = ros1.start(
        "Xvfb", f":{number}", "-screen", "0", "1280x900x24", "-fbdir", str(tmp_path)
    )
    wait_for(screen.exists, "the screen")
    # At this speed the mission lasts longer than all that is waited for below.
    options = f"--out {tmp_path / 'run'} --speed 0.4 --set record.enabled=false"
    options += " --set perception.camera_rate_hz=2"
    launched = ros1.start(
        "roslaunch", "agribot_description", "agribot.launch", f"options:={options}"
    )
    wanted = shown(ROS1 / "rviz" / "agribot.rviz") - TOOLS

    def is_watched() -> bool:
        heard = ros1.subscribers()
        return all(any("rviz" in node for node in heard.get(name, [])) for name in wanted)

    wait_for(is_watched, f"rviz to listen to {wanted}", 240.0)
    wait_for(lambda: shows_the_farm(view_of(screen)), "robot, plan and goals in the view", 240.0)
    Image.fromarray(pixels_of(screen)).save(tmp_path / "rviz.png")
    ros1.stop(launched)
    ros1.stop(display)


def pixels_of(screen: Path) -> np.ndarray[Any, Any]:
    """(height, width, 3) of an X window dump as Xvfb keeps it: a header, a colour map, BGRX."""
    data = screen.read_bytes()
    header = struct.unpack(">25I", data[:100])
    start, width, height, stride, colours = header[0], *header[4:6], header[12], header[19]
    at = start + 12 * colours
    rows = np.frombuffer(data, np.uint8, height * stride, at).reshape(height, stride)
    return rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1].copy()


def view_of(screen: Path) -> np.ndarray[Any, Any]:
    """The picture in three dimensions, without the panels around it."""
    return pixels_of(screen)[70:700, 390:1180]


def shows_the_farm(rgb: np.ndarray[Any, Any]) -> bool:
    red, green, blue = (rgb[:, :, i].astype(int) for i in range(3))
    goals = (green > 120) & (green - red > 60) & (green - blue > 60)
    plan = (blue > 150) & (blue - red > 100)
    body = (red > 130) & (red - blue > 40) & (abs(red - green) < 40)
    return bool(goals.sum() > 50 and plan.sum() > 200 and body.sum() > 200)
