"""Search for the models and files that a world names by `model://`, `package://` or `file://`."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from urllib.parse import unquote

from agribot.core.errors import DescriptionError
from agribot.description.markup import read_xml
from agribot.description.package import (
    PACKAGE,
    ROOT,
    find_named_package_folder,
    list_resource_folders,
)

SCHEMES = re.compile(r"^(model|package|file|https?)://")
# Names of Gazebo's public models -> this package's model of the same kind.
ALIASES = {
    "pine_tree": "pine", "oak_tree": "oak", "house_1": "house", "house_2": "house",
    "house_3": "house", "asphalt_plane": "pavement_plane", "gas_station": "house",
    "stop_sign": "speed_limit_sign", "table_marble": "table", "cafe_table": "table",
}  # fmt: skip


# Words in the name of a model that no folder has -> this package's model of that kind. The first
# that fits counts.
KINDS_BY_WORD: tuple[tuple[frozenset[str], str], ...] = tuple(
    (frozenset(words.split()), kind)
    for words, kind in (
        ("walking walker pedestrian actor", "person_walking"),
        (
            "person people human man woman male female child girl boy visitor worker farmer "
            "operator standing",
            "person_standing",
        ),
        ("dog deer sheep goat cow calf pig horse wolf boar", "dog"),
        ("hare rabbit cat fox hen chicken", "hare"),
        ("pine fir spruce conifer", "pine"),
        ("tree oak birch maple beech", "oak"),
        ("house cottage farmhouse", "house"),
        ("lamp streetlight", "lamp_post"),
        ("pole mast", "telephone_pole"),
        ("sign signpost", "speed_limit_sign"),
        ("table desk bench", "table"),
    )
)
_WORDS = re.compile("[A-Z]?[a-z]+|[A-Z]+")


class ModelLibrary:
    """Models next to a world file first, then those of Gazebo's paths, then of the package."""

    def __init__(self, world_file: Path) -> None:
        self._world_file = world_file
        here = world_file.resolve().parent
        near = (here, here / "models", here.parent / "models")
        self.folders = (*near, *list_resource_folders(), ROOT / "models")
        self._read: dict[str, ET.Element | None] = {}
        self._ours: dict[str, ET.Element | None] = {}

    def find(self, uri: str) -> ET.Element | None:
        """Find the <model> element of a URI, or None if no folder has it.

        Raises: DescriptionError: the model's file is broken.
        """
        if uri not in self._read:
            self._read[uri] = self._load(uri)
        return self._read[uri]

    def find_stand_in(self, uri: str) -> ET.Element | None:
        """Find the packaged <model> of the kind whose folder a mesh's URI names, or None.

        Worlds that Gazebo saved contain the parts of every model, but not its meshes.
        """
        if not uri.startswith("model://"):
            return None
        name = parse_mesh_folder(uri)
        return self._find_packaged(name) or self.find_of_kind(name)

    def find_of_kind(self, name: str) -> ET.Element | None:
        """Find the packaged <model> that the words of a name suggest, or None: a person, a tree."""
        words = {word.lower() for word in _WORDS.findall(unquote(name))}
        kind = next((kind for known, kind in KINDS_BY_WORD if known & words), None)
        return None if kind is None else self._find_packaged(kind)

    def find_file(self, uri: str) -> Path | None:
        """Find the file of a URI or a relative path; None where it is not on this machine."""
        name = unquote(SCHEMES.sub("", uri)).strip()
        if name.startswith("/"):
            return Path(name) if os.path.isfile(name) else None
        inner = name.removeprefix(f"{PACKAGE}/")
        folders = (*self.folders, ROOT)
        if uri.startswith("package://"):
            package = find_named_package_folder(name.partition("/")[0], self._world_file)
            folders = folders if package is None else (package.parent, *folders)
        for folder in folders:
            for candidate in (folder / name, folder / inner):
                if os.path.isfile(candidate):  # False if the name is too long for the system
                    return candidate
        return None

    def _load(self, uri: str) -> ET.Element | None:
        name = parse_kind(uri)
        folder = next((f / name for f in self.folders if name and os.path.isdir(f / name)), None)
        if folder is None:
            return self._find_packaged(name)
        return read_xml(folder / _find_sdf_name(folder)).find("model")

    def _find_packaged(self, name: str) -> ET.Element | None:
        """Find the package's own model of this name or kind."""
        if name not in self._ours:
            # Worlds of the original AGRIBOT write CropWithWeed for crop_with_weed.
            known = ALIASES.get(name.lower().replace(" ", "_"), name)
            folders = sorted((ROOT / "models").iterdir())
            folder = next((folder for folder in folders if _is_same_name(folder.name, known)), None)
            found = (
                None if folder is None else read_xml(folder / _find_sdf_name(folder)).find("model")
            )
            self._ours[name] = found
        return self._ours[name]


def parse_kind(uri: str) -> str:
    """Return the name of a model in its URI: the last part of the path."""
    return SCHEMES.sub("", uri).strip().strip("/").rpartition("/")[2]


def parse_mesh_folder(uri: str) -> str:
    """Return the name of the model whose folder a mesh is in: the first part of the path."""
    return SCHEMES.sub("", uri).partition("/")[0]


def is_crop_with_weed(name: str) -> bool:
    """Return whether a model is the original's crop by its name, maybe with a number at its end."""
    return _is_same_name(re.sub(r"[\d_]*$", "", name), "crop_with_weed")


def _is_same_name(left: str, right: str) -> bool:
    first, second = (re.sub("[_ ]|%20", "", name).lower() for name in (left, right))
    return first == second


def _find_sdf_name(folder: Path) -> str:
    """Return the model's file: the newest that model.config names, else any .sdf."""
    config = folder / "model.config"
    if config.is_file():
        named = [element.text or "" for element in read_xml(config).findall("sdf")]
        there = [name.strip() for name in named if (folder / name.strip()).is_file()]
        if there:
            return there[-1]
    files = sorted(file.name for file in folder.glob("*.sdf"))
    if not files:
        raise DescriptionError(f"model folder {folder} holds no .sdf file; copy it anew")
    return files[-1]
