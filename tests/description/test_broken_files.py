"""Cut, damaged and absurd files: read, or refused in one sentence; never anything else.

The damage is drawn from a fixed seed, so that every run sees the same files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from agribot.core import config
from agribot.core.errors import AgribotError, DescriptionError
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import read_field_settings
from agribot.description.loader import export_urdf, load_robot
from agribot.description.package import ROOT
from agribot.description.worlds_sdf import load_world

ABSURD = ("nan", "inf", "-inf", "0", "-1", "1e9", "1e308", "-1e-300", "", "many", "1 2 3")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
GEOJSON = {
    "type": "Feature",
    "properties": {},
    "geometry": {
        "type": "Polygon",
        "coordinates": [[[72.7869, 21.1611], [72.7873, 21.1611], [72.7873, 21.1615],
                         [72.7869, 21.1615], [72.7869, 21.1611]]],
    },
}  # fmt: skip
FIELD = """
name = "small"
boundary = "edge.geojson"
[rows]
count = 3
length_m = 6.0
pitch_m = 0.75
[crop]
spacing_m = 0.3
height_m = 0.2
[weeds]
density_per_m2 = 1.0
[soil]
residue_ratio = 0.2
"""


def damaged(text: str, rng: np.random.Generator) -> str:
    """One of: cut off, a stretch lost, a stretch doubled, bytes flipped, a number made absurd."""
    first, last = sorted(rng.integers(0, len(text), 2).tolist())
    last = min(last, first + 200)
    kind = int(rng.integers(7))
    if kind == 0:
        return text[:first]
    if kind == 1:
        return text[:first] + text[last:]
    if kind == 2:
        return text[:last] + text[first:]
    if kind == 3:
        symbols = "".join(chr(int(code)) for code in rng.integers(32, 127, 3))
        return text[:first] + symbols + text[first + 3 :]
    numbers = list(NUMBER.finditer(text))
    hit = numbers[int(rng.integers(len(numbers)))]
    return text[: hit.start()] + str(rng.choice(ABSURD)) + text[hit.end() :]


def read_robot(folder: Path, text: str) -> None:
    (folder / "robot.urdf").write_text(text, "utf-8")
    load_robot(str(folder / "robot.urdf"))


def read_world(folder: Path, text: str) -> None:
    (folder / "x.world").write_text(text, "utf-8")
    load_world(str(folder / "x.world"))


def read_field(folder: Path, text: str) -> None:
    (folder / "edge.geojson").write_text(json.dumps(GEOJSON), "utf-8")
    (folder / "field.toml").write_text(text, "utf-8")
    generate_field(read_field_settings(folder / "field.toml"), 0, folder)


def read_boundary(folder: Path, text: str) -> None:
    (folder / "edge.geojson").write_text(text, "utf-8")
    (folder / "field.toml").write_text(FIELD, "utf-8")
    generate_field(read_field_settings(folder / "field.toml"), 0, folder)


def read_profile(folder: Path, text: str) -> None:
    (folder / "profile.toml").write_text(text, "utf-8")
    config.load(str(folder / "profile.toml"))


def _whole(kind: str) -> str:
    packaged = {"world": "worlds/world1.world", "hills": "worlds/hills.world"}
    if kind in packaged:
        return (ROOT / packaged[kind]).read_text("utf-8")
    if kind == "robot":
        return export_urdf()
    if kind == "profile":
        return (ROOT.parent / "core" / "profiles" / "farm.toml").read_text("utf-8")
    return json.dumps(GEOJSON, indent=1) if kind == "boundary" else FIELD


READERS: dict[str, tuple[Callable[[Path, str], None], int]] = {
    "robot": (read_robot, 120),
    "world": (read_world, 120),
    "hills": (read_world, 30),
    "field": (read_field, 150),
    "boundary": (read_boundary, 80),
    "profile": (read_profile, 100),
}


@pytest.mark.parametrize("kind", READERS)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(kind: str, tmp_path: Path) -> None:
    read, count = READERS[kind]
    text, rng = _whole(kind), np.random.default_rng(len(kind))
    read(tmp_path, text)  # as it is, it is sound
    refused = 0
    for _ in range(count):
        broken = damaged(text, rng)
        try:
            read(tmp_path, broken)
        except AgribotError as error:
            refused += 1
            assert 10 < len(str(error)) < 1000
    assert refused > count // 10


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("count = 3", "count = 1000000000", "count"),
        ("spacing_m = 0.3", "spacing_m = 1e-9", "spacing_m"),
        ("length_m = 6.0", "length_m = 1e9", "length_m"),
        ("density_per_m2 = 1.0", "density_per_m2 = 1e9", "density_per_m2"),
        ("height_m = 0.2", "height_m = nan", "height_m"),
        ("pitch_m = 0.75", "pitch_m = inf", "pitch_m"),
        ("count = 3\nlength_m = 6.0", "count = 1000\nlength_m = 1000.0", "plants"),
    ],
)
def test_a_field_of_absurd_size_is_refused_before_it_grows(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    assert old in FIELD
    with pytest.raises(DescriptionError, match=complaint):
        read_field(tmp_path, FIELD.replace(old, new).replace('boundary = "edge.geojson"\n', ""))


@pytest.mark.parametrize(
    ("pattern", "new"),
    [
        (r'<mass value="[^"]*"', '<mass value="0"'),
        (r'<mass value="[^"]*"', '<mass value="nan"'),
        (r"<updateRate>100(\.0)?</updateRate>", "<updateRate>0</updateRate>"),
        (r'xyz="[^"]*"', 'xyz="nan 0 0"'),
    ],
)
def test_a_robot_without_mass_rate_or_place_is_refused(
    tmp_path: Path, pattern: str, new: str
) -> None:
    text, count = re.subn(pattern, new, export_urdf())
    assert count > 0
    with pytest.raises(DescriptionError):
        read_robot(tmp_path, text)


def test_a_robot_in_grams_is_refused_with_its_mass_and_the_limit(tmp_path: Path) -> None:
    def make_grams(found: re.Match[str]) -> str:
        return f'<mass value="{1000.0 * float(found[1])}"'

    text = re.sub(r'<mass value="([^"]*)"', make_grams, export_urdf())
    complaint = (
        r"a mass of 5112\.2 kg on 0\.68 x 0\.83 m, more than the limit of 1\d{3}.* kg for that "
        r"size \(link 'base_link' alone: 3467\.2 kg\); masses are in kilograms"
    )
    with pytest.raises(DescriptionError, match=complaint):
        read_robot(tmp_path, text)


def test_angles_of_a_robot_that_can_only_be_degrees_are_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    text, count = re.subn(
        r'(<joint name="base_link_to_camera_link_joint".*?rpy=")[^"]*"',
        r'\g<1>0 90 -180"',
        export_urdf(),
        flags=re.S,
    )
    assert count == 1
    path.write_text(text)
    [told] = [one for one in load_robot(str(path)).warnings if "whole turn" in one]
    assert told == (
        "joint 'base_link_to_camera_link_joint' <origin rpy>: an angle of -180 rad is more than a "
        "whole turn, 6.283; angles are in radians: -180 degrees are -3.142"
    )
    assert not [one for one in load_robot().warnings if "whole turn" in one]


def test_a_body_that_was_left_without_its_mass_is_refused_though_its_camera_has_one(
    tmp_path: Path,
) -> None:
    text, count = re.subn(r'<mass value="3\.4672"', '<mass value="0"', export_urdf())
    assert count == 1
    with pytest.raises(DescriptionError, match=r"base_link.*0\.001 kg.*at least 0\.08"):
        read_robot(tmp_path, text)
