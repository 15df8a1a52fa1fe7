"""A robot in SDF: our own export comes back as the same robot, and others are read with care."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.description.elements import SourceFile
from agribot.description.kinematics import read_joints, read_links
from agribot.description.loader import export_urdf, load_robot
from agribot.description.robot_sdf import export_sdf
from agribot.description.sdf_robot import read_sdf_robot

CARRIAGE = """<sdf version='1.9'><model name='carriage'>
  <link name='body'><pose>0 0 1 0 0 0</pose>
    <inertial><pose>0.1 0 0 0 0 0</pose><mass>5</mass><inertia><ixx>1</ixx><iyy>2</iyy>
      <izz>3</izz></inertia></inertial>
    <collision name='c'><geometry><box><size>1 2 3</size></box></geometry>
      <surface><friction><ode><mu>0.7</mu><mu2>0.6</mu2></ode></friction></surface></collision>
    <visual name='v'><geometry><ellipsoid><radii>1 1 1</radii></ellipsoid></geometry></visual>
    <sensor name='s' type='imu'><pose>0 0 0.5 0 0 0</pose><update_rate>50</update_rate></sensor>
  </link>
  <link name='arm'><pose relative_to='body'>1 0 0 0 0 1.5707963267948966</pose></link>
  <joint name='shoulder' type='revolute'><pose>0 0 0.25 0 0 0</pose>
    <parent>body</parent><child>arm</child>
    <axis><xyz expressed_in='__model__'>0 1 0</xyz>
      <limit><lower>-1</lower><upper>2</upper><effort>inf</effort></limit></axis></joint>
  <frame name='tip' attached_to='arm'><pose>0 0.5 0 0 0 0</pose></frame>
</model></sdf>"""

Read = Callable[[str], tuple[SourceFile, dict[str, np.ndarray], str]]


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def write_it(text: str) -> Path:
        path = tmp_path / "robot.sdf"
        path.write_text(text)
        return path

    return write_it


def test_our_own_export_is_the_same_robot_again(write: Callable[[str], Path]) -> None:
    robot = load_robot()
    back = load_robot(str(write(export_sdf(robot))))
    assert {link.name for link in back.links} == {link.name for link in robot.links}
    for link in robot.links:
        if link.name != "dummy_link":  # the root of ours, which hangs on the body there
            there = back.base_from_link(link.name)
            assert np.allclose(there, robot.base_from_link(link.name), atol=1e-9), link.name
        assert back.link(link.name).mass_kg == link.mass_kg
        assert np.allclose(back.link(link.name).inertia_kgm2, link.inertia_kgm2)
    assert back.camera == robot.camera
    assert back.base_height_m == pytest.approx(robot.base_height_m)
    for mine, theirs in ((robot.imu, back.imu), (robot.gnss, back.gnss), (robot.mag, back.mag)):
        assert mine is not None and theirs is not None
        assert (mine.link, mine.rate_hz) == (theirs.link, theirs.rate_hz)
    drive = back.drive
    assert drive.effective_separation_m == pytest.approx(robot.drive.effective_separation_m)
    assert (drive.track_m, drive.wheel_radius_m) == (robot.drive.track_m, 0.09)
    assert sum(len(link.collisions) for link in back.links) == sum(
        len(link.collisions) for link in robot.links
    )


def test_describe_reads_back_what_it_has_printed(
    write: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["describe", "--sdf"]) == 0
    path = write(capsys.readouterr().out)
    assert main(["describe", "--robot", str(path)]) == 0
    assert "12 links, 11 joints, 5.112 kg" in capsys.readouterr().out
    assert main(["describe", "--robot", str(path), "--sdf"]) == 0
    again = write(capsys.readouterr().out)
    assert len(load_robot(str(again)).links) == 12
    assert "<robot" in export_urdf(str(again))
    named = again.rename(again.with_name("model.xml"))
    assert len(load_robot(str(named)).links) == 12
    named.rename(again)
    with pytest.raises(DescriptionError, match="takes no arguments"):
        load_robot(f"{again} side:=left")


def test_joints_frames_and_sensors_stand_where_the_file_has_them(
    write: Callable[[str], Path],
) -> None:
    source = SourceFile("robot.sdf")
    root = read_sdf_robot(write(CARRIAGE), source)
    links = {link.name: link for link in read_links(root, source)}
    joints = {joint.name: joint for joint in read_joints(root, source)}
    body = links["body"]
    assert (body.mass_kg, body.com.xyz_m, body.inertia_kgm2[:3]) == (
        5.0,
        (0.1, 0.0, 0.0),
        (1, 2, 3),
    )
    assert body.collisions[0].size_m == (1.0, 2.0, 3.0)
    assert body.visuals == () and "ellipsoid is left out" in source.list_warnings()[0]
    shoulder, tip = joints["shoulder"], joints["tip_joint"]
    # The joint is 0.25 m above the arm's own frame, and there the link of URDF has its frame.
    assert shoulder.origin.xyz_m == pytest.approx((1.0, 0.0, 0.25))
    assert shoulder.kind == "revolute"
    assert shoulder.axis == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)  # y of the model
    assert (tip.parent, tip.kind) == ("arm", "fixed")
    assert tip.origin.xyz_m == pytest.approx((0.0, 0.5, -0.25))
    limit = root.find("joint[@name='shoulder']/limit")
    assert limit is not None and dict(limit.attrib) == {"lower": "-1", "upper": "2"}
    assert root.findtext("gazebo[@reference='body']/sensor/pose") == "0 0 0.5 0 0 0"
    assert root.findtext("gazebo[@reference='body']/mu1") == "0.7"
    assert root.findtext("gazebo[@reference='body']/mu2") == "0.6"


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ("<lower>-1</lower>", "", "continuous"),
        ("<lower>-1</lower><upper>2</upper>", "<lower>-1e16</lower><upper>1e16</upper>",
         "continuous"),
        ("<lower>-1</lower><upper>2</upper>", "<lower>-inf</lower><upper>inf</upper>",
         "continuous"),
    ],
)  # fmt: skip
def test_a_joint_without_ends_turns_on(
    write: Callable[[str], Path], old: str, new: str, kind: str
) -> None:
    source = SourceFile("robot.sdf")
    root = read_sdf_robot(write(CARRIAGE.replace(old, new)), source)
    assert read_joints(root, source)[0].kind == kind


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("type='revolute'", "type='ball'", "it is of type 'ball'; robots are read with continuous"),
        (
            "<child>arm</child>",
            "<child>leg</child>",
            "there is no link 'leg'; there are: arm, body",
        ),
        ("attached_to='arm'", "attached_to='leg'", "'tip' is placed relative to 'leg'"),
        ("<frame", "<model name='m'/><frame", "a <model> in it; robots are read of one model"),
        ("</model>", "</model><model name='two'/>", "2 models; a robot is an <sdf> with one"),
        ("<lower>-1</lower>", "<lower>left</lower>", "joint 'shoulder' <limit>"),
        ("relative_to='body'", "relative_to='arm'", "relative to itself"),
    ],
)
def test_what_is_no_robot_is_refused_with_its_place(
    write: Callable[[str], Path], old: str, new: str, words: str
) -> None:
    with pytest.raises(DescriptionError) as refusal:
        read_sdf_robot(write(CARRIAGE.replace(old, new)), SourceFile("robot.sdf"))
    assert words in str(refusal.value)


def test_a_world_is_no_robot(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="that is a world; give the robot's own URDF"):
        load_robot(str(tmp_path / "Farm.world"))
    with pytest.raises(DescriptionError, match="does not exist"):
        load_robot(str(tmp_path / "none.sdf"))
