"""Other people's robot files: what is understood, and how a broken one is explained."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest

from agribot.core.errors import DescriptionError
from agribot.description.loader import check_robot, export_urdf, load_robot
from agribot.description.package import ROOT
from agribot.description.robot_sdf import export_sdf


def _urdf_without(folder: Path, pattern: str) -> str:
    """The packaged robot as a URDF file, with what matches the pattern taken out."""
    text, count = re.subn(pattern, "", export_urdf(), flags=re.DOTALL)
    assert count > 0
    file = folder / "robot.urdf"
    file.write_text(text, "utf-8")
    return str(file)


def test_a_plain_urdf_reads_like_its_xacro(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(export_urdf(), "utf-8")
    assert load_robot(str(file)) == load_robot()


def test_tag_names_may_have_any_case(tmp_path: Path) -> None:
    def flat(match: re.Match[str]) -> str:
        return match.group(0).lower()

    # Inside the plugins only, as in the descriptions of the original robot.
    plugins = re.compile(r"<plugin .*?(?=</plugin>)", re.DOTALL)
    text = plugins.sub(lambda m: re.sub(r"</?\w+>", flat, m.group(0)), export_urdf())
    assert "<updaterate>" in text and "<updateRate>" not in text
    file = tmp_path / "robot.urdf"
    file.write_text(text, "utf-8")
    assert load_robot(str(file)) == load_robot()


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        (r'<joint name="base_link_to_left_wheel_F_joint".*?</joint>', ("wheels", "right_wheel_F")),
        (r"<cylinder.*?/>", ("<geometry> is empty",)),
        (r'<mass value="0.411" ?/>', ("<mass> is missing", "right_wheel_R")),
    ],
)
def test_a_missing_part_is_named_with_file_and_what_there_is(
    tmp_path: Path, pattern: str, words: tuple[str, ...]
) -> None:
    with pytest.raises(DescriptionError) as raised:
        load_robot(_urdf_without(tmp_path, pattern))
    for word in ("robot.urdf", *words):
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        (r'<plugin [^>]*ros_imu.so"[^>]*>.*?</plugin>', "no IMU; one at 100 Hz on 'imu_link'"),
        (r'<plugin [^>]*ros_gps.so"[^>]*>.*?</plugin>', "no GNSS receiver; one at 5 Hz on 'gps_l"),
        (r'<plugin [^>]*ros_magnetic.so"[^>]*>.*?</plugin>', "no magnetometer; one at 10 Hz on 'm"),
        (r'<plugin [^>]*steer_drive.so"[^>]*>.*?</plugin>', "no drive plugin"),
        (r"<agribot>.*?</agribot>", "<agribot>: <drive> is missing"),
        (r"<yaw_multiplier>.*?</yaw_multiplier>", "<yaw_multiplier> is missing; 1.415 is used"),
        (r"<torque>.*?</torque>", "<torque> is missing; 2.257 is used"),
    ],
)
def test_what_is_left_out_is_replaced_with_a_warning_and_fails_a_strict_check(
    tmp_path: Path, pattern: str, words: str
) -> None:
    file = _urdf_without(tmp_path, pattern)
    robot = load_robot(file)
    assert any(words in warning for warning in robot.warnings), robot.warnings
    assert any(words in finding.text for finding in check_robot(file))
    assert robot.drive.yaw_multiplier == pytest.approx(load_robot().drive.yaw_multiplier, rel=1e-8)


def test_a_robot_without_camera_or_sprayer_can_still_drive(tmp_path: Path) -> None:
    pattern = r'<sensor name="camera".*?</sensor>|<sprayer>.*?</sprayer>'
    robot = load_robot(_urdf_without(tmp_path, pattern))
    assert robot.camera is None and robot.implement is None


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("<torque>20</torque>", "<torque>much</torque>", ("<torque>", "'much'")),
        ("<torque>20</torque>", "<torque>0</torque>", ("<torque>", "give a number above 0")),
        ('xyz="0 0.06 0"', 'xyz="0 0.06"', ("base_link_to_imu_link_joint", "needs 3 numbers")),
        ("<bodyName>imu_link</", "<bodyName>nose</", ("IMU", "'nose'", "imu_link")),
        ('child link="gps_link"', 'child link="gpslink"', ("'gpslink'", "gps_link")),
        ('<mass value="0.411"', '<mass value="nan"', ("<mass>", "nan")),
    ],
)
def test_a_wrong_value_is_named_with_its_place(
    tmp_path: Path, before: str, after: str, words: tuple[str, ...]
) -> None:
    text = export_urdf()
    assert before in text
    file = tmp_path / "robot.urdf"
    file.write_text(text.replace(before, after), "utf-8")
    with pytest.raises(DescriptionError) as raised:
        load_robot(str(file))
    for word in ("robot.urdf", *words):
        assert word in str(raised.value)


def test_sensors_of_the_new_gazebo_are_understood(tmp_path: Path) -> None:
    root = ET.fromstring(export_urdf())
    for block in root.findall("gazebo"):
        for plugin in block.findall("plugin"):
            if "hector" in plugin.get("filename", ""):
                block.remove(plugin)
    for link, kind, rate_hz in (
        ("imu_link", "imu", 100),
        ("gps_link", "navsat", 2),
        ("magnetometer_link", "magnetometer", 20),
    ):
        block = ET.SubElement(root, "gazebo", reference=link)
        sensor = ET.SubElement(block, "sensor", name=kind, type=kind)
        ET.SubElement(sensor, "update_rate").text = str(rate_hz)
    file = tmp_path / "robot.urdf"
    file.write_text(ET.tostring(root, encoding="unicode"), "utf-8")
    robot = load_robot(str(file))
    assert (robot.imu.link, robot.imu.rate_hz) == ("imu_link", 100.0)
    assert (robot.gnss.link, robot.gnss.rate_hz) == ("gps_link", 2.0)
    assert robot.mag is not None
    assert (robot.mag.link, robot.mag.rate_hz) == ("magnetometer_link", 20.0)


def _expect_error(call: Callable[[], object], *words: str) -> None:
    with pytest.raises(DescriptionError) as raised:
        call()
    for word in words:
        assert word in str(raised.value)


def test_unknown_robot_names_the_known_ones() -> None:
    _expect_error(lambda: load_robot("husky"), "husky", "agribot")


def test_missing_file_is_named() -> None:
    _expect_error(lambda: load_robot("nowhere/rover.urdf"), "nowhere/rover.urdf")


def test_unknown_argument_names_the_known_ones() -> None:
    _expect_error(lambda: load_robot(mappings={"camera": "x"}), "'camera'", "legacy_camera")


def test_arguments_for_a_plain_urdf_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(export_urdf(), "utf-8")
    _expect_error(lambda: load_robot(str(file), {"legacy_camera": "true"}), "not a xacro file")


def _broken_set(folder: Path, name: str, before: str, after: str) -> str:
    (folder / "urdf").mkdir()
    for file in (ROOT / "urdf").glob("*.xacro"):
        text = file.read_text("utf-8")
        if file.name == name:
            assert before in text
            text = text.replace(before, after, 1)
        (folder / "urdf" / file.name).write_text(text, "utf-8")
    return str(folder / "urdf" / "agribot_sensors.urdf.xacro")


def test_broken_xml_names_the_included_file_and_the_line(tmp_path: Path) -> None:
    name = "agribot_parts.urdf.xacro"
    top = _broken_set(tmp_path, name, "</link>", "</lnk>")
    lines = (tmp_path / "urdf" / name).read_text("utf-8").splitlines()
    line = 1 + next(i for i, text in enumerate(lines) if "</lnk>" in text)
    _expect_error(lambda: load_robot(top), name, f"line {line}")


def test_broken_urdf_names_the_line(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text('<robot name="x">\n<link name="a">\n</robot>\n', "utf-8")
    _expect_error(lambda: load_robot(str(file)), "robot.urdf", "line 3")


@pytest.mark.parametrize(
    ("name", "before", "after", "words"),
    [
        ("agribot_body.urdf.xacro", "${-axle_drop}", "${-axle_dorp}", ("axle_dorp",)),
        ("agribot_sensors.urdf.xacro", "agribot_camera.urdf", "no_camera.urdf", ("no_camera",)),
        ("agribot_sensors.urdf.xacro", "$(find agribot_description)", "$(find", ("xacro",)),
        ("agribot_camera.urdf.xacro", "$(arg camera_xyz)", "$(arg camera_yxz)", ("camera_yxz",)),
    ],
)
def test_what_xacro_cannot_expand_names_the_file(
    tmp_path: Path, name: str, before: str, after: str, words: tuple[str, ...]
) -> None:
    top = _broken_set(tmp_path, name, before, after)
    _expect_error(lambda: load_robot(top), str(tmp_path), *words)


def test_a_failed_reading_leaves_nothing_behind(tmp_path: Path) -> None:
    before = export_urdf()
    top = _broken_set(tmp_path, "agribot_parts.urdf.xacro", "</link>", "</lnk>")
    for _ in range(3):
        with pytest.raises(DescriptionError):
            load_robot(top)
    assert export_urdf() == before


def test_packages_are_found_by_the_name_of_a_folder_above(tmp_path: Path) -> None:
    package = tmp_path / "my_rover"
    package.mkdir()
    top = Path(_broken_set(package, "", "", ""))
    for file in (package / "urdf").glob("*.xacro"):
        file.write_text(file.read_text().replace("$(find agribot_description)", "$(find my_rover)"))
    assert load_robot(str(top)) == load_robot()


def test_a_file_that_is_no_robot_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "world.urdf"
    file.write_text("<sdf/>", "utf-8")
    _expect_error(lambda: load_robot(str(file)), "<sdf>", "<robot>")


def _urdf_with(folder: Path, old: str, new: str) -> str:
    text = export_urdf()
    assert old in text
    file = folder / "robot.urdf"
    file.write_text(text.replace(old, new, 1), "utf-8")
    return str(file)


SDF_LENS = (
    "<distortion><k1>-0.2</k1><k2>0.05</k2><k3>0</k3><p1>0.001</p1><p2>-2e-3</p2></distortion>"
)


@pytest.mark.parametrize(
    ("old", "new", "lens"),
    [
        ("<clip>", f"{SDF_LENS}<clip>", (-0.2, 0.05, 0.001, -0.002)),
        ("<distortionK1>0.0<", "<distortionK1>-0.15<", (-0.15, 0.0, 0.0, 0.0)),
        ("<distortionT2>0.0<", "<distortionT2>0.004<", (0.0, 0.0, 0.0, 0.004)),
    ],
)
def test_lens_distortion_is_read_from_sdf_and_from_the_ros_plugin(
    tmp_path: Path, old: str, new: str, lens: tuple[float, ...]
) -> None:
    robot = load_robot(_urdf_with(tmp_path, old, new))
    assert robot.camera is not None
    assert robot.camera.distortion == lens
    written = ET.fromstring(export_sdf(robot)).find(".//camera/distortion")
    assert written is not None
    assert [float(written.findtext(name, "")) for name in ("k1", "k2", "p1", "p2")] == list(lens)


def test_a_lens_coefficient_that_is_not_modelled_is_told(tmp_path: Path) -> None:
    file = _urdf_with(tmp_path, "<distortionK3>0.0<", "<distortionK3>0.1<")
    assert any("k3" in warning for warning in load_robot(file).warnings)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("<update_rate>30.0<", "<update_rate>0<", "<update_rate> 0: out of range; give 0.01"),
        ("<width>640<", "<width>1e9<", "1e+09: out of range; give 16 to 8192"),
        ("<horizontal_fov>1.3962634<", "<horizontal_fov>4<", "4: out of range; give 0.01 to 3.1"),
        ("<near>0.02<", "<near>nan<", "nan"),
    ],
)
def test_an_absurd_camera_is_refused_with_its_element(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    with pytest.raises(DescriptionError) as refusal:
        load_robot(_urdf_with(tmp_path, old, new))
    assert complaint in str(refusal.value)
