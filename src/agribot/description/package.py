"""The files of this package, under the name that descriptions use for it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from agribot.core.errors import DescriptionError

PACKAGE = "agribot_description"
NEIGHBOURS = 4  # levels up from a file, in which a package it asks for may lie
# Variables that list folders with packages or models in them, or above them, by who sets them.
ROS_PATHS = ("ROS_PACKAGE_PATH",)
AMENT_PATH = "AMENT_PREFIX_PATH"
GAZEBO_PATHS = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
ROOT = Path(__file__).resolve().parent
_ARGUMENT = re.compile(r"\s+([A-Za-z_]\w*):=")


def list_robot_files() -> dict[str, Path]:
    """List the packaged robots by name: their top-level xacro files."""
    return {
        "agribot": ROOT / "urdf" / "agribot_sensors.urdf.xacro",
        "agribot-hoe": ROOT / "urdf" / "agribot_hoe.urdf.xacro",
        "agribot-point": ROOT / "urdf" / "agribot_point.urdf.xacro",
    }


def list_fixture_files() -> dict[str, Path]:
    """List what is packaged and stands, such as a pole with a receiver."""
    return {"entry_gate": ROOT / "urdf" / "entry_gate.urdf"}


def list_world_files() -> dict[str, Path]:
    """List the packaged worlds by name."""
    return {path.stem: path for path in sorted((ROOT / "worlds").glob("*.world"))}


def find_package_folder(package: str, asking_file: Path) -> Path | None:
    """Find the folder of `$(find package)` and `package://package` in `asking_file`.

    It is that of `find_named_package_folder`, else the one that holds the file's `urdf` folder.
    """
    named = find_named_package_folder(package, asking_file)
    if named is not None:
        return named
    for folder in asking_file.resolve().parents:
        if folder.name == "urdf":
            return folder.parent
    return ROOT if package == PACKAGE else None


def find_named_package_folder(package: str, asking_file: Path) -> Path | None:
    """Find the folder of a package that has its name.

    It is a folder above the file, else one beside those folders, else one in ROS_PACKAGE_PATH,
    AMENT_PREFIX_PATH or Gazebo's resource paths.
    """
    parents = asking_file.resolve().parents
    for folder in parents:
        if folder.name == package:
            return folder
    beside = [folder / package for folder in list(parents)[:NEIGHBOURS]]
    return next(
        (folder for folder in [*beside, *_list_environment_folders(package)] if folder.is_dir()),
        None,
    )


def list_resource_folders() -> tuple[Path, ...]:
    """List the folders in which Gazebo looks for models, in its order."""
    return tuple(path for name in GAZEBO_PATHS for path in _split_path_variable(name))


def read_search_paths() -> tuple[str, ...]:
    """Read the variables on which it depends where a package is found."""
    return tuple(os.environ.get(name, "") for name in (*ROS_PATHS, AMENT_PATH, *GAZEBO_PATHS))


def _list_environment_folders(package: str) -> Iterator[Path]:
    """Yield the folders of a package that the variables of ROS and Gazebo name."""
    for path in (path for name in ROS_PATHS for path in _split_path_variable(name)):
        if path.name == package:
            yield path
        for depth in ("", "*/", "*/*/"):
            yield from sorted(path.glob(depth + package))
    for prefix in _split_path_variable(AMENT_PATH):
        yield prefix / "share" / package
    for folder in list_resource_folders():
        yield folder / package


def _split_path_variable(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def split_arguments(robot: str) -> tuple[str, dict[str, str]]:
    """Split `x.xacro side:=left wheels:=4` into the robot and its xacro arguments, as ROS has them.

    A value lasts until the next argument, and so do blanks in a path.
    """
    name, *words = _ARGUMENT.split(robot)
    return name.strip(), {key: text.strip() for key, text in zip(*[iter(words)] * 2, strict=True)}


def find_packaged_or_file(
    kind: str, name_or_path: str, known: dict[str, Path], suffixes: tuple[str, str]
) -> Path:
    """Find a packaged file by its name, or any file, or a path with one of the suffixes.

    Raises: DescriptionError: neither; the message lists the known names.
    """
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in suffixes or path.is_file():
        return path
    raise DescriptionError(
        f"unknown {kind} '{name_or_path}'; known: {', '.join(sorted(known))}, "
        f"or a path to a {suffixes[0]} or {suffixes[1]} file"
    )
