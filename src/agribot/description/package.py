"""The files of this package, under the name that descriptions call them by."""

from __future__ import annotations

from pathlib import Path

from agribot.errors import DescriptionError

PACKAGE = "agribot_description"
NEIGHBOURS = 4  # levels up from a file, in which a package it asks for may lie
ROOT = Path(__file__).resolve().parent


def robot_files() -> dict[str, Path]:
    """The packaged robots by name: their top-level xacro files."""
    return {"agribot": ROOT / "urdf" / "agribot_sensors.urdf.xacro"}


def world_files() -> dict[str, Path]:
    """The packaged worlds by name."""
    return {path.stem: path for path in sorted((ROOT / "worlds").glob("*.world"))}


def package_folder(package: str, asking_file: Path) -> Path | None:
    """Folder that `$(find package)` and `package://package` mean in `asking_file`.

    That is the folder above the file that bears the package's name, else one of that name
    beside those folders, else the one that holds the file's `urdf` folder, else (for our own
    package) this one.
    """
    parents = asking_file.resolve().parents
    for folder in parents:
        if folder.name == package:
            return folder
    for folder in list(parents)[:NEIGHBOURS]:
        if (folder / package).is_dir():
            return folder / package
    for folder in parents:
        if folder.name == "urdf":
            return folder.parent
    return ROOT if package == PACKAGE else None


def packaged_or_file(
    kind: str, name_or_path: str, known: dict[str, Path], suffixes: tuple[str, str]
) -> Path:
    """A packaged file by its name, or any path with one of the suffixes.

    Raises: DescriptionError: neither; the message lists the known names.
    """
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in suffixes:
        return path
    raise DescriptionError(
        f"unknown {kind} '{name_or_path}'; known: {', '.join(sorted(known))}, "
        f"or a path to a {suffixes[0]} or {suffixes[1]} file"
    )
