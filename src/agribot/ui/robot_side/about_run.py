"""What the page's server has to know of a run before it starts, read off the session."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urlparse

import msgspec

from agribot.app.magnetometer import has_magnetometer
from agribot.core.config import RunConfig, load
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import RobotSpec
from agribot.description.loader import export_urdf, load_robot
from agribot.description.package import (
    find_package_folder,
    find_packaged_or_file,
    list_robot_files,
    split_arguments,
)
from agribot.ui import wire
from agribot.ui.about import About
from agribot.ui.address import Address
from agribot.ui.ground import field_of
from agribot.ui.settings import show_settings

_MESH = re.compile(r'(<mesh\b[^>]*?filename=")([^"]+)(")')
PAGE_DIR = Path(__file__).parents[1] / "page"
MESH_SUFFIXES = {".stl", ".dae", ".obj", ".glb", ".gltf"}


def about_run(
    address: Address,
    port: int,
    config: RunConfig,
    robot: RobotSpec,
    urdf: str,
    field: wire.Field,
    run_dir: Path,
    recording: str = "",
) -> About:
    """All of it; `recording` is set where no robot runs and a recording is shown instead."""
    shown_urdf, meshes = urdf_for_page(urdf, config.robot)
    return About(
        host=address.host,
        port=port,
        names=address.names(),
        operator_token=address.operator_token,
        viewer_token=address.viewer_token,
        session_key=address.session_key,
        profile=config.profile,
        source="replay" if recording else config.platform,
        field=field,
        robot=shown_robot(robot, config),
        urdf=shown_urdf,
        meshes=meshes,
        settings=show_settings(config),
        rates=expected_rates_hz(robot, config),
        runs_dir=str(run_dir.resolve().parent),
        current=run_dir.resolve().name,
        home_dir=str(address.home),
        page_dir=str(PAGE_DIR),
        config=config,
        robot_spec=robot,
        recording=recording,
        lan_url=address.lan_url(port),
        tls_cert=address.tls_cert,
        tls_key=address.tls_key,
    )


def about_robot(address: Address, port: int, name: str) -> About:
    """Describe a robot by its description alone: nothing runs."""
    config = msgspec.structs.replace(load("farm"), robot=name)
    robot, urdf, field = load_robot(name), export_urdf(name), field_of(config, ())
    about = about_run(address, port, config, robot, urdf, field, Path())
    return msgspec.structs.replace(about, source="description")


def shown_robot(robot: RobotSpec, config: RunConfig) -> wire.Robot:
    drive, safety = robot.drive, config.safety
    return wire.Robot(
        name=robot.name,
        urdf_url="/robot/robot.urdf",
        footprint_body_m=footprint_body_m(robot),
        max_speed_mps=min(drive.max_speed_mps, safety.max_speed_mps),
        max_yaw_rate_radps=min(drive.max_yaw_rate_radps, safety.max_yaw_rate_radps),
        camera=_camera(robot),
        wheel_joints=_wheel_joints(robot),
        has_compass=has_magnetometer(robot, config),
        tool_width_m=None if robot.implement is None else round(robot.implement.width_m, 4),
    )


def footprint_body_m(robot: RobotSpec) -> list[wire.Vec2]:
    """Return the rectangle around the wheels on the ground, counter-clockwise from front left."""
    drive, wheels = robot.drive, robot.wheel_xy_body_m()
    front, rear = float(wheels[:, 0].max()), float(wheels[:, 0].min())
    left, right = float(wheels[:, 1].max()), float(wheels[:, 1].min())
    reach_m, half_m = drive.wheel_radius_m, drive.wheel_width_m / 2.0
    front, rear, left, right = front + reach_m, rear - reach_m, left + half_m, right - half_m
    return [(front, left), (rear, left), (rear, right), (front, right)]


def urdf_for_page(urdf: str, robot_name: str) -> tuple[str, dict[str, str]]:
    """Rewrite mesh names relative to the description, and find the file behind each."""
    name, _ = split_arguments(robot_name)
    file = find_packaged_or_file("robot", name, list_robot_files(), (".xacro", ".urdf"))
    meshes: dict[str, str] = {}

    def rename_mesh(match: re.Match[str]) -> str:
        uri = match[2]
        path = _mesh_path(uri, file)
        name = re.sub(r"[^\w./-]", "_", uri.partition("://")[2] or Path(uri).name).lstrip("/.")
        if path is not None and path.suffix.lower() in MESH_SUFFIXES:
            meshes[name] = str(path)
        return f"{match[1]}{name}{match[3]}"

    return _MESH.sub(rename_mesh, urdf), meshes


def _mesh_path(uri: str, asking_file: Path) -> Path | None:
    parts = urlparse(uri)
    if parts.scheme == "package":
        folder = find_package_folder(parts.netloc, asking_file)
        return None if folder is None else folder / parts.path.lstrip("/")
    if parts.scheme in {"", "file"}:
        return asking_file.parent / parts.path
    return None


def _camera(robot: RobotSpec) -> wire.CameraInfo | None:
    camera = robot.camera
    if camera is None:
        return None
    return wire.CameraInfo(
        width_px=camera.width_px,
        height_px=camera.height_px,
        hfov_rad=camera.hfov_rad,
        body_from_camera=[float(value) for value in robot.body_from_camera().ravel()],
    )


def _wheel_joints(robot: RobotSpec) -> list[str]:
    joints = {joint.child: joint.name for joint in robot.joints}
    return [joints.get(wheel, wheel) for wheel in WHEEL_NAMES]


def expected_rates_hz(robot: RobotSpec, config: RunConfig) -> dict[str, float]:
    """How often each sensor should speak, by the names of a batch."""
    rates = {
        "wheels": robot.drive.rate_hz,
        "imu": robot.imu.rate_hz,
        "gnss": robot.gnss.rate_hz,
    }
    if robot.mag is not None and has_magnetometer(robot, config):
        rates["mag"] = robot.mag.rate_hz
    if config.perception.enabled and robot.camera is not None:
        rates["frames"] = config.perception.camera_rate_hz
    return rates
