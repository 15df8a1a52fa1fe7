"""Finding the models that a world includes by `model://name`."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

from agribot.description.package import ROOT
from agribot.errors import DescriptionError


def read_sdf(path: Path) -> ET.Element:
    """The top element of an SDF file.

    Raises: DescriptionError: no such file, or not well-formed; names the line.
    """
    try:
        return ET.parse(path).getroot()
    except FileNotFoundError as error:
        raise DescriptionError(f"{path} does not exist; check the path") from error
    except ET.ParseError as error:
        raise DescriptionError(f"{path}: not well-formed XML: {error}; mend that line") from error


class ModelLibrary:
    """Models next to a world file first, then those of the package."""

    def __init__(self, world_file: Path) -> None:
        here = world_file.resolve().parent
        self.folders = (here, here / "models", here.parent / "models", ROOT / "models")
        self._read: dict[str, ET.Element | None] = {}

    def find(self, uri: str) -> ET.Element | None:
        """The <model> element behind a URI, or None if no folder has it."""
        if uri not in self._read:
            self._read[uri] = self._load(uri)
        return self._read[uri]

    def _load(self, uri: str) -> ET.Element | None:
        name = uri.removeprefix("model://").strip("/")
        folder = next((f / name for f in self.folders if (f / name).is_dir()), None)
        if folder is None:
            # Worlds of the original AGRIBOT write CropWithWeed for crop_with_weed.
            folder = next((m for m in (ROOT / "models").iterdir() if _same(m.name, name)), None)
        if folder is None:
            return None
        return read_sdf(folder / _sdf_name(folder)).find("model")


def is_crop_with_weed(name: str) -> bool:
    """Whether a model's name is that of the original's crop, maybe with a number behind it."""
    return _same(re.sub(r"[\d_]*$", "", name), "crop_with_weed")


def _same(left: str, right: str) -> bool:
    return left.replace("_", "").lower() == right.replace("_", "").lower()


def _sdf_name(folder: Path) -> str:
    """The model's file: the newest that model.config names, else any .sdf."""
    config = folder / "model.config"
    if config.is_file():
        named = read_sdf(config).findtext("sdf")
        if named:
            return named.strip()
    files = sorted(file.name for file in folder.glob("*.sdf"))
    if not files:
        raise DescriptionError(f"model folder {folder} holds no .sdf file")
    return files[-1]
