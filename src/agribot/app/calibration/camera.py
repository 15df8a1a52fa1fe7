"""Calibrate the camera's mount from pictures of a drive, and assess the row lines in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain, repeat
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.app.calibration.advice import format_advice
from agribot.app.calibration.figure import DriveSamples
from agribot.app.calibration.recorded_robot import read_measured_robot
from agribot.app.calibration.row_view import Glance, RowViewFit, fit_row_view
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.perceive.mount_fit import Look, MountFit, fit_mount, follow
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import CameraUnproven, NoPlantFollowed
from agribot.core.geo import rotation_from_rpy, rpy_from_rotation
from agribot.core.messages import Scene, SensorBatch, Vec3
from agribot.core.robot import RobotSpec
from agribot.record.replay import read_config, read_ticks

# Time after its start in which the filter learns its heading from the drive, s.
SETTLE_S = 5.0
# Largest deviation in size of a plant that is seen whole and alone from its usual one.
STEADY_RATIO = 0.15


class CameraResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `camera_*` is the pose of the camera in base_link.

    `settings` are for `agribot run --set`.
    """

    ok: bool
    reasons: tuple[str, ...]
    fit: MountFit
    camera_xyz_m: Vec3
    camera_rpy_rad: Vec3
    settings: tuple[str, ...]


class RowViewResult(msgspec.Struct, frozen=True, kw_only=True):
    ok: bool
    reasons: tuple[str, ...]
    fit: RowViewFit


class CameraDrive(NamedTuple):
    """The scenes of a drive, and the poses of the robot by its other sensors."""

    robot: RobotSpec
    config: RunConfig
    scenes: list[Scene]
    track: np.ndarray[tuple[int, ...], np.dtype[np.float64]]  # (N, 6): t, x, y, yaw, their stds

    def pose(self, t_s: float) -> tuple[float, float, float]:
        t, x, y, yaw = self.track[:, :4].T
        return float(np.interp(t_s, t, x)), float(np.interp(t_s, t, y)), float(
            np.interp(t_s, t, yaw)
        )  # fmt: skip

    @property
    def heading_std_rad(self) -> float:
        """Its best estimate, 1 sigma."""
        return float(np.quantile(self.track[:, 5], 0.1))

    @property
    def settled_scenes(self) -> list[Scene]:
        from_s = float(self.track[0, 0]) + SETTLE_S
        return [scene for scene in self.scenes if scene.t_s >= from_s]


def observe_recording(path: Path) -> CameraDrive:
    """Read the scenes of a recording and estimate the poses without them."""
    config = read_config(path)
    robot = read_measured_robot(path, config)
    return observe_ticks(((tick.batch, tick.scenes) for tick in read_ticks(path)), robot, config)


def observe_figure(driven: DriveSamples, robot: RobotSpec, config: RunConfig) -> CameraDrive:
    """Estimate the poses of a figure, without the start mark that the robot has left."""
    field = msgspec.structs.replace(config.field, start_map_m=None, start_yaw_deg=None)
    config = msgspec.structs.replace(config, field=field)
    shown = chain([tuple(driven.scenes)], repeat(()))
    return observe_ticks(zip(driven.batches, shown, strict=False), robot, config)


def observe_ticks(
    ticks: Iterable[tuple[SensorBatch, tuple[Scene, ...]]], robot: RobotSpec, config: RunConfig
) -> CameraDrive:
    """Collect scenes, and poses of a filter that uses no pictures, so that none proves itself.

    Raises: MissionError: no picture, or no pose.
    """
    localizer = Localizer(config.estimate, config.field, robot)
    scenes: list[Scene] = []
    track = []
    for batch, seen in ticks:
        scenes += seen
        e = localizer.update(batch)
        if e.ok:
            track.append((e.t_s, e.x_map_m, e.y_map_m, e.yaw_map_rad, e.pos_std_m, e.yaw_std_rad))
    if len(track) < 2 or not scenes:
        raise MissionError(CameraUnproven(len(scenes), len(track)))
    table = np.array(track)
    table[:, 3] = np.unwrap(table[:, 3])
    return CameraDrive(robot, config, sorted(scenes, key=lambda scene: scene.t_s), table)


def calibrate_camera(seen: CameraDrive, *, one_way: bool = False) -> CameraResult:
    """Fit the camera's mount to plants that were followed through several pictures.

    `one_way`: the robot faced one direction all the time, so that an error of its own heading looks
    like a turned camera. Over both directions of rows it cancels.

    Raises: MissionError: no plant was followed; DescriptionError: a robot without camera.
    """
    robot = seen.robot
    scenes = [scene for scene in seen.settled_scenes if scene.plants]
    looks = drop_unsteady([Look(s.t_s, seen.pose(s.t_s), s.plants) for s in scenes])
    fit = fit_mount(looks, robot.body_from_camera())
    if fit is None or robot.camera is None:
        raise MissionError(NoPlantFollowed(len(looks)))
    yaw_std_rad = math.hypot(fit.yaw_std_rad, seen.heading_std_rad if one_way else 0.0)
    fit = msgspec.structs.replace(fit, yaw_std_rad=yaw_std_rad)
    base_from_link = robot.base_from_link(robot.camera.link)
    turned = rotation_from_rpy(fit.roll_rad, fit.pitch_rad, fit.yaw_rad) @ base_from_link[:3, :3]
    x_m, y_m, z_m = base_from_link[:3, 3].tolist()
    rpy_rad, height_m = rpy_from_rotation(turned), z_m + robot.base_height_m + fit.height_m
    reasons = fit.complaints()
    return CameraResult(
        ok=not reasons, reasons=reasons, fit=fit, camera_xyz_m=(x_m, y_m, z_m + fit.height_m),
        camera_rpy_rad=rpy_rad,
        settings=(
            f"calibration.camera_height_m={height_m:.4f}",
            f"calibration.camera_rpy_rad=[{','.join(f'{value:.5f}' for value in rpy_rad)}]",
        ),
    )  # fmt: skip


def drop_unsteady(looks: Sequence[Look]) -> list[Look]:
    """Drop the sightings of a plant in which its size differs from its usual one.

    Its leaves touch those of another there, or the edge of the picture cuts it: what is seen is
    not its middle.
    """
    usual_m2: dict[int, float] = {}
    for track in follow(looks):
        median_m2 = float(np.median([sight.plant.area_m2 for sight in track]))
        usual_m2 |= {id(sight.plant): median_m2 for sight in track}
    return [
        look._replace(
            plants=tuple(
                plant
                for plant in look.plants
                if abs(plant.area_m2 / usual_m2.get(id(plant), math.inf) - 1.0) <= STEADY_RATIO
            )
        )
        for look in looks
    ]


def assess_row_view(seen: CameraDrive) -> RowViewResult:
    """Compare the row lines in pictures with the rows of the field.

    Raises: MissionError: no picture within a row showed its line.
    """
    t_s, pos_std_m, yaw_std_rad = seen.track[:, 0], seen.track[:, 4], seen.track[:, 5]
    glances = [
        Glance(
            seen.pose(s.t_s), s.row_line, float(np.interp(s.t_s, t_s, pos_std_m)),
            float(np.interp(s.t_s, t_s, yaw_std_rad)),
        )
        for s in seen.settled_scenes
    ]  # fmt: skip
    fit = fit_row_view(glances, seen.config.field)
    reasons = fit.complaints()
    return RowViewResult(ok=not reasons, reasons=reasons, fit=fit)


def format_camera(result: CameraResult) -> str:
    fit = result.fit
    lines = [
        f"against its description the camera is {name} by {value:+.2f} +- {std:.2f} {unit}"
        for name, value, std, unit in (
            ("pitched down", math.degrees(fit.pitch_rad), math.degrees(fit.pitch_std_rad), "deg"),
            ("turned left", math.degrees(fit.yaw_rad), math.degrees(fit.yaw_std_rad), "deg"),
            ("rolled right", math.degrees(fit.roll_rad), math.degrees(fit.roll_std_rad), "deg"),
            ("raised", 100.0 * fit.height_m, 100.0 * fit.height_std_m, "cm"),
        )
    ]
    lines.append(
        f"{fit.tracks} plants in {fit.looks} sights keep their places to {100 * fit.scatter_m:.1f} "
        f"cm, as described to {100 * fit.scatter_before_m:.1f} cm"
    )
    described = (
        "or set in the xacro files of the robot:",
        f'  <xacro:arg name="camera_xyz" default="{_format_numbers(result.camera_xyz_m)}"/>',
        f'  <xacro:arg name="camera_rpy" default="{_format_numbers(result.camera_rpy_rad)}"/>',
    )
    lines += format_advice(result.settings, result.reasons, described)
    return "\n".join(lines) + "\n"


def format_row_view(result: RowViewResult) -> str:
    fit = result.fit
    lines = [
        f"rows seen in {fit.lines} of {fit.pictures} pictures taken inside rows",
        f"offset: {100 * fit.offset_bias_m:+.1f} +- {100 * fit.offset_bias_std_m:.1f} cm on "
        f"average, scatter {100 * fit.offset_scatter_m:.1f} cm, stated "
        f"{100 * fit.offset_stated_m:.1f} cm",
        f"heading: {math.degrees(fit.heading_bias_rad):+.2f} +- "
        f"{math.degrees(fit.heading_bias_std_rad):.2f} degrees on average, scatter "
        f"{math.degrees(fit.heading_scatter_rad):.2f}, stated "
        f"{math.degrees(fit.heading_stated_rad):.2f}",
    ]
    if result.ok:
        lines.append("the rows stand where the camera sees them")
    return "\n".join([*lines, *(f"not good: {reason}" for reason in result.reasons)]) + "\n"


def _format_numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.4f}" for value in values)
