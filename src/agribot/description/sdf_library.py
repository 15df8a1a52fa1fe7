"""Finding the models and files that a world names by `model://`, `package://` or `file://`."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from urllib.parse import unquote

from agribot.description.markup import read_xml
from agribot.description.package import PACKAGE, ROOT
from agribot.errors import DescriptionError

SCHEMES = re.compile(r"^(model|package|file|https?)://")
# Names of Gazebo's public models -> what this package has of the kind.
ALIASES = {
    "pine_tree": "pine", "oak_tree": "oak", "house_1": "house", "house_2": "house",
    "house_3": "house", "asphalt_plane": "pavement_plane", "gas_station": "house",
}  # fmt: skip


class ModelLibrary:
    """Models next to a world file first, then those of the package."""

    def __init__(self, world_file: Path) -> None:
        here = world_file.resolve().parent
        self.folders = (here, here / "models", here.parent / "models", ROOT / "models")
        self._read: dict[str, ET.Element | None] = {}

    def find(self, uri: str) -> ET.Element | None:
        """The <model> element behind a URI, or None if no folder has it.

        Raises: DescriptionError: the model's file is broken.
        """
        if uri not in self._read:
            self._read[uri] = self._load(uri)
        return self._read[uri]

    def file(self, uri: str) -> Path | None:
        """The file behind a URI or a relative path; None where it is not on this machine."""
        name = unquote(SCHEMES.sub("", uri)).strip()
        if name.startswith("/"):
            return Path(name) if Path(name).is_file() else None
        inner = name.removeprefix(f"{PACKAGE}/")
        for folder in (*self.folders, ROOT):
            for candidate in (folder / name, folder / inner):
                if candidate.is_file():
                    return candidate
        return None

    def _load(self, uri: str) -> ET.Element | None:
        name = kind_of(uri)
        folder = next((f / name for f in self.folders if name and (f / name).is_dir()), None)
        if folder is None:
            # Worlds of the original AGRIBOT write CropWithWeed for crop_with_weed.
            known = ALIASES.get(name.lower(), name)
            folder = next((m for m in (ROOT / "models").iterdir() if _same(m.name, known)), None)
        if folder is None:
            return None
        return read_xml(folder / _sdf_name(folder)).find("model")


def kind_of(uri: str) -> str:
    """The name of a model in its URI: the last part of the path."""
    return SCHEMES.sub("", uri).strip().strip("/").rpartition("/")[2]


def is_crop_with_weed(name: str) -> bool:
    """Whether a model's name is that of the original's crop, maybe with a number behind it."""
    return _same(re.sub(r"[\d_]*$", "", name), "crop_with_weed")


def _same(left: str, right: str) -> bool:
    return left.replace("_", "").lower() == right.replace("_", "").lower()


def _sdf_name(folder: Path) -> str:
    """The model's file: the newest that model.config names, else any .sdf."""
    config = folder / "model.config"
    if config.is_file():
        named = [element.text or "" for element in read_xml(config).findall("sdf")]
        there = [name.strip() for name in named if (folder / name.strip()).is_file()]
        if there:
            return there[-1]
    files = sorted(file.name for file in folder.glob("*.sdf"))
    if not files:
        raise DescriptionError(f"model folder {folder} holds no .sdf file")
    return files[-1]
