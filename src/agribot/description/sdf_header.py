"""The header of an SDF world: place on Earth, magnetic field, gravity, light and soil."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import get_args

import msgspec
import numpy as np

from agribot.core.geo import Datum
from agribot.core.messages import FloatArray, Row, Vec3
from agribot.core.world import Light, Relief, Soil, SoilClass, SoilStrength
from agribot.description.elements import SourceFile
from agribot.description.poses import make_yaw_rotation
from agribot.description.sdf_models import qualify_tag

# Yaw of the x axis from East in each of the orientations that SDF knows with z up.
FRAME_YAW_DEG = {"ENU": 0.0, "NWU": 90.0}
# Gazebo's default, which it writes into every world it saves, in some releases rounded. It
# belongs to no particular place, and is the same in the axes of every file.
GAZEBO_FIELD_T = (5.5645e-6, 2.28758e-5, -4.23884e-5)
ROUNDED_T = 5e-7
# Attributes of <agribot:relief> and the most that they may be.
RELIEF_LIMITS = {
    "seed": 2.0**31, "roughness_rms_m": 0.1, "clods_per_m2": 200.0, "clod_height_m": 0.1,
    "ridge_height_m": 0.5, "track_depth_m": 0.2, "track_gauge_m": 5.0, "track_width_m": 1.0,
}  # fmt: skip


class Header:
    """Everything but the models, with vectors and poses turned into the map frame."""

    def __init__(self, world: ET.Element, source: SourceFile) -> None:
        self._world = world
        self._source = source
        self.is_placed = True
        self.datum, heading_deg = self._read_place()
        self.map_from_world: FloatArray = make_yaw_rotation(math.radians(heading_deg))
        self.gravity_mps2 = -self._read_vec3("gravity", (0.0, 0.0, -9.8))[2]
        self.field_enu_t = self._read_field()
        self.light = self._read_light()
        self.soil = self._read_soil()
        self.strength = self._read_strength()
        self.relief = self._read_relief()

    def _read_number(self, path: str, default: float) -> float:
        element, value = self._world.find(path), default
        if element is not None:
            with self._source.attempt(element):
                value = self._source.parse_number(element.text, f"<{path}>")
        return value

    def _read_vec3(self, path: str, default: Vec3) -> Vec3:
        element, value = self._world.find(path), default
        if element is not None:
            with self._source.attempt(element):
                value = self._source.parse_vec3(element.text, f"<{path}>")
        return value

    def _read_field(self) -> Vec3:
        """Read the magnetic field, T; Gazebo's default is turned to true North."""
        written = self._read_vec3("magnetic_field", GAZEBO_FIELD_T)
        if not _is_gazebos(written):
            return self._turn_to_map(written)
        if self._world.find("magnetic_field") is not None:
            self._source.warn(
                "<magnetic_field> is Gazebo's default, that of no place; it is taken to point to "
                "true North"
            )
        return 0.0, math.hypot(*GAZEBO_FIELD_T[:2]), GAZEBO_FIELD_T[2]

    def _turn_to_map(self, vector: Vec3) -> Vec3:
        """Turn a direction of the file into the map frame."""
        east, north, up = (self.map_from_world[:3, :3] @ np.array(vector)).tolist()
        return east, north, up

    def _read_place(self) -> tuple[Datum, float]:
        """Read the datum, and the yaw of the file's x axis from East in degrees."""
        reference = self._read_hector_reference()
        if reference is not None:
            return reference
        if self._world.find("spherical_coordinates") is None:
            return self._assume_place()
        frame = self._world.findtext("spherical_coordinates/world_frame_orientation", "ENU").strip()
        if frame not in FRAME_YAW_DEG:
            raise self._source.fail(
                "<world_frame_orientation>", f"'{frame}' is not read; use ENU and heading_deg"
            )
        latitude_deg = self._read_number("spherical_coordinates/latitude_deg", 0.0)
        longitude_deg = self._read_number("spherical_coordinates/longitude_deg", 0.0)
        if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
            raise self._source.fail(
                "<spherical_coordinates>",
                f"{latitude_deg:g}, {longitude_deg:g} is no place on Earth; latitudes end at 90, "
                "longitudes at 180 degrees",
            )
        datum = Datum(
            lat_deg=latitude_deg,
            lon_deg=longitude_deg,
            alt_m=self._read_number("spherical_coordinates/elevation", 0.0),
        )
        heading_deg = self._read_number("spherical_coordinates/heading_deg", 0.0)
        return datum, heading_deg + FRAME_YAW_DEG[frame]

    def _assume_place(self) -> tuple[Datum, float]:
        """Leave the place to the settings, and turn x by the compass where the file allows it."""
        self.is_placed = False
        field_t = self._read_vec3("magnetic_field", GAZEBO_FIELD_T)
        heading_deg, why = 0.0, "x points East"
        if math.hypot(*field_t[:2]) > 0.0 and not _is_gazebos(field_t):
            heading_deg = 90.0 - round(math.degrees(math.atan2(field_t[1], field_t[0])), 6)
            why = f"x points {heading_deg:.4g} degrees from East, as <magnetic_field> says"
        self._source.warn(
            f"no <spherical_coordinates>: the map lies at field.datum, and {why}; add the tag, "
            "with its <heading_deg>, to change this"
        )
        return Datum(lat_deg=0.0, lon_deg=0.0), heading_deg

    def _read_hector_reference(self) -> tuple[Datum, float] | None:
        """Read the place in the GPS plugin of a robot in old worlds, with x to the North."""
        for plugin in self._world.iter("plugin"):
            tags = {element.tag.lower(): element.text for element in plugin}
            if "ros_gps" not in plugin.get("filename", "") or "referencelatitude" not in tags:
                continue
            latitude, longitude, compass = (
                self._source.parse_number(tags.get(name, "0"), f"GPS plugin <{name}>")
                for name in ("referencelatitude", "referencelongitude", "referenceheading")
            )
            return Datum(lat_deg=latitude, lon_deg=longitude), 90.0 - compass
        return None

    def _read_soil(self) -> Soil:
        element, ratios = self._world.find(qualify_tag("soil")), {}
        for name, text in {} if element is None else element.attrib.items():
            where = f"<agribot:soil> {name}"
            if name not in Soil.__struct_fields__:
                raise self._source.fail(where, f"unknown; use {', '.join(Soil.__struct_fields__)}")
            ratios[name] = self._source.parse_number(text, where)
            self._source.check_within(where, ratios[name], 0.0, 1.0)
        return Soil(**ratios)

    def _read_strength(self) -> SoilStrength:
        element, strength = self._world.find(qualify_tag("strength")), SoilStrength()
        for name, text in {} if element is None else element.attrib.items():
            where = f"<agribot:strength> {name}"
            if name not in SoilStrength.__struct_fields__:
                known = ", ".join(SoilStrength.__struct_fields__)
                raise self._source.fail(where, f"unknown; use {known}")
            value: str | float = text.strip()
            if name == "moisture_ratio":
                value = self._source.parse_number(text, where)
                self._source.check_within(where, value, 0.0, 1.0)
            elif value not in get_args(SoilClass):
                known = ", ".join(get_args(SoilClass))
                raise self._source.fail(where, f"'{value}' is unknown; use {known}")
            strength = msgspec.structs.replace(strength, **{name: value})
        return strength

    def _read_relief(self) -> Relief:
        """Read the relief with its rows; ridges and tracks need at least one row."""
        element, numbers = self._world.find(qualify_tag("relief")), {}
        if element is None:
            return Relief()
        for name, text in element.attrib.items():
            where = f"<agribot:relief> {name}"
            if name not in RELIEF_LIMITS:
                raise self._source.fail(where, f"unknown; use {', '.join(RELIEF_LIMITS)}")
            numbers[name] = self._source.parse_number(text, where)
            self._source.check_within(where, numbers[name], 0.0, RELIEF_LIMITS[name])
        rows = [
            self._read_relief_row(row, index)
            for index, row in enumerate(element.findall(qualify_tag("row")))
        ]
        if not rows and (numbers.get("ridge_height_m") or numbers.get("track_depth_m")):
            raise self._source.fail(
                "<agribot:relief>",
                "ridge_height_m and track_depth_m need rows; add "
                '<agribot:row start="X Y" end="X Y"/> inside, or leave them out',
            )
        seed = int(numbers.pop("seed", 0.0))
        return Relief(seed=seed, rows=tuple(rows), **numbers)

    def _read_relief_row(self, row: ET.Element, index: int) -> Row:
        ends = []
        for name in ("start", "end"):
            x, y = self._source.parse_numbers(row.get(name, ""), 2, f"<agribot:row> {name}")[:2]
            x_m, y_m, _z = self._turn_to_map((x, y, 0.0))
            ends.append((x_m, y_m))
        bend = self._source.parse_number(row.get("curvature_radpm", "0"), "<agribot:row>")
        return Row(index=index, start_map_m=ends[0], end_map_m=ends[1], curvature_radpm=bend)

    def _read_light(self) -> Light:
        suns = [e for e in self._world.findall("light") if e.get("type") == "directional"]
        light = Light()
        if suns:
            with self._source.attempt(suns[0]):
                light = self._read_sun(suns[0])
        return light

    def _read_sun(self, sun: ET.Element) -> Light:
        from_sun = self._source.parse_vec3(sun.findtext("direction", "0 0 -1"), "<direction>")
        if from_sun[2] >= 0.0:
            raise self._source.fail(
                "<light> <direction>", f"the sun shines upwards, z = {from_sun[2]:g}; give z < 0"
            )
        east, north, up = (
            -np.array(self._turn_to_map(from_sun)) / np.linalg.norm(from_sun)
        ).tolist()
        return Light(
            to_sun=(east, north, up),
            diffuse=self._read_grey(sun.findtext("diffuse"), Light().diffuse),
            ambient=self._read_grey(self._world.findtext("scene/ambient"), Light().ambient),
        )

    def _read_grey(self, text: str | None, default: float) -> float:
        if text is None:
            return default
        colour = self._source.parse_numbers(" ".join(text.split()[:3]), 3, "<light>")
        return round(sum(colour) / 3.0, 9)


def _is_gazebos(field_t: Vec3) -> bool:
    """Return whether a magnetic field is Gazebo's default."""
    return bool(np.allclose(field_t, GAZEBO_FIELD_T, rtol=0.0, atol=ROUNDED_T))
