"""Labels of other tools become a set that a network learns from: `images/` and `masks/`.

A picture that cannot be used is named and left out. Labels that do not lie on the plants, or that
are of an unexplained class, make the set invalid: nothing is written.
"""

from __future__ import annotations

import io
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.errors import ConfigError, RecordingError, add_advice
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.classes import GREENER, NAMES
from agribot.lab.dataset.foreign.coco import is_coco, read_coco
from agribot.lab.dataset.foreign.cvat import read_cvat
from agribot.lab.dataset.foreign.label_studio import is_label_studio, read_label_studio
from agribot.lab.dataset.foreign.labelme import is_labelme, read_labelme
from agribot.lab.dataset.foreign.shapes import (
    LabelFileError,
    LabelledPicture,
    Polygon,
    check_inside,
    decode_json,
)
from agribot.lab.dataset.foreign.yolo import read_names, read_yolo
from agribot.lab.dataset.layouts import ENDING
from agribot.lab.dataset.picture_index import PictureIndex, index_beside
from agribot.lab.dataset.pictures import PictureError, read_picture
from agribot.lab.dataset.placement import PlacementTally

FORMATS = ("labelme", "coco", "cvat", "yolo", "label-studio")
SUFFIX = {"cvat": ".xml", "yolo": ".txt"}  # suffixes of the files in a folder; the others are .json
MAX_FILE_BYTES = 500_000_000
NAME_FILES = ("data.yaml", "dataset.yaml", "data.yml", "classes.txt", "obj.names")
# Beside the labels of a folder: names of classes, lists of pictures, and texts about the set, as of
# Roboflow. A file that is named in the command is read whatever its name.
NO_LABELS = re.compile(
    r"(?i)(classes|obj\.names|readme(\.\w+)*|licen[cs]e|notes|train|val|valid|test|autosplit_\w+)"
    r"(\.txt)?|data\.ya?ml|dataset\.ya?ml"
)
ANY = "*"
EXPORT = "export it anew"
EXAMPLE = "--classes crop=beet,maize weed=*"


class ImportReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result of an import; `shapes` counts those of each name in the tool.

    `without_area` are shapes that were left out of pictures that were taken.
    """

    folder: str
    pictures: int
    shapes: dict[str, int]
    unlabelled: tuple[str, ...]
    without_area: tuple[str, ...]
    problems: tuple[str, ...]


def read_class_names(words: Sequence[str]) -> dict[str, int]:
    """Read "crop=beet,maize" and "weed=*"; without words the names are those of the classes.

    Raises: ConfigError: no such class, or a name twice.
    """
    if not words:
        return dict(NAMES)
    meaning: dict[str, int] = {}
    for word in words:
        kind, _, names = word.partition("=")
        if kind not in NAMES or not names:
            raise ConfigError(
                f"--classes {word}: not classes; write CLASS=NAME,NAME with a class of "
                f"{', '.join(NAMES)}, as in {EXAMPLE}"
            )
        for name in names.split(","):
            if name.strip() in meaning:
                raise ConfigError(
                    f"--classes {word}: '{name.strip()}' is given twice; give it once"
                )
            meaning[name.strip()] = NAMES[kind]
    return meaning


class LabelFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file of labels, its pictures, and where these lie."""

    path: Path
    pictures: tuple[LabelledPicture, ...]


def list_label_files(inputs: Sequence[Path], tool: str) -> list[Path]:
    """List the files of all inputs; a folder gives those with the ending of the tool.

    Raises: ConfigError: an input does not exist, or a folder has no such file.
    """
    files: list[Path] = []
    for path in inputs:
        if not path.is_dir():
            if not path.is_file():
                raise ConfigError(f"{path} does not exist; check the path")
            files.append(path)
            continue
        suffixes = {SUFFIX.get(tool, ".json")} if tool != "auto" else {".json", ".xml", ".txt"}
        found = sorted(p for p in path.rglob("*") if p.suffix.lower() in suffixes)
        found = [one for one in found if not NO_LABELS.fullmatch(one.name)]
        if not found:
            raise ConfigError(
                f"{path} has no {' or '.join(sorted(suffixes))} file with labels; "
                "name the folder that has them"
            )
        files += found
    return list(dict.fromkeys(files))


def read_label_files(files: Sequence[Path], tool: str, problems: list[str]) -> Iterator[LabelFile]:
    """Read the files one after the other; one that cannot be used goes to `problems`."""
    for path in files:
        try:
            yield LabelFile(path=path, pictures=tuple(_read_file(path, tool)))
        except LabelFileError as error:
            problems.append(add_advice(f"{path}: {error}", EXPORT))


def _read_file(path: Path, tool: str) -> list[LabelledPicture]:
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise LabelFileError(f"is larger than {MAX_FILE_BYTES // 1_000_000} MB; export parts")
    data = path.read_bytes()
    if tool == "cvat" or (tool == "auto" and path.suffix.lower() == ".xml"):
        return read_cvat(data)
    if tool == "yolo" or (tool == "auto" and path.suffix.lower() == ".txt"):
        name = "/".join((*path.parts[-2:-1], path.stem))
        return [read_yolo(name, data, _find_names(path))]
    value = decode_json(data)
    for name, has_form, read in (
        ("labelme", is_labelme, read_labelme),
        ("coco", is_coco, read_coco),
        ("label-studio", is_label_studio, read_label_studio),
    ):
        if tool == name or (tool == "auto" and has_form(value)):
            return read(value)
    raise LabelFileError(f"is of no known format; say which with --format {'|'.join(FORMATS)}")


def _find_names(path: Path) -> dict[int, str]:
    for folder in path.parents[:3]:
        for name in NAME_FILES:
            if (folder / name).is_file():
                try:
                    return read_names(name, (folder / name).read_bytes())
                except LabelFileError as error:
                    raise LabelFileError(f"its names in {folder / name}: {error}") from error
    return {}


def import_labels(
    sources: Sequence[LabelFile],
    meaning: Mapping[str, int],
    out: Path,
    *,
    images: Path | None = None,
    keeps_empty: bool = False,
    keeps_misplaced: bool = False,
    problems: Sequence[str] = (),
    progress: Callable[[int], None] = lambda _done: None,
) -> ImportReport:
    """Write the set; `problems` are those found before.

    A picture without labels may not have been annotated: it is left out, unless `keeps_empty` says
    that there are no plants. So is one whose labels do not lie on its plants, unless
    `keeps_misplaced`.

    Raises: ConfigError: a class that `meaning` does not have, no usable picture, or too many whose
    labels do not lie on the plants. RecordingError: the folder cannot be written.
    """
    _check_names(sources, meaning)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"--out {out}: is there already; give a new folder")
    part = out.parent / f".{out.name}.part"
    writer = _Writer(part, meaning, list(problems))
    indexes = _Indexes(images)
    try:
        for done, (source, picture) in enumerate(_each(sources), 1):
            if picture.shapes or picture.problem or keeps_empty:
                writer.add(picture, indexes.find(source.path))
            else:
                writer.unlabelled.append(picture.file)
            progress(done)
        if not keeps_misplaced:
            writer.drop_misplaced(out)
        writer.check(out)
        part.rename(out)
    except OSError as error:
        raise RecordingError(
            f"cannot write {out}: {error.strerror}; choose another --out"
        ) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return writer.report(out)


class _Indexes:
    """The pictures beside files of labels, or those of the one folder that was given."""

    def __init__(self, images: Path | None) -> None:
        self._images = images
        self._found: dict[Path, PictureIndex] = {}

    def find(self, labels: Path) -> PictureIndex:
        place = self._images or labels.parent
        if place not in self._found:
            whole = PictureIndex((self._images,)) if self._images else index_beside(labels)
            self._found[place] = whole
        return self._found[place]


def _each(sources: Sequence[LabelFile]) -> Iterator[tuple[LabelFile, LabelledPicture]]:
    for source in sources:
        for picture in source.pictures:
            yield source, picture


def _check_names(sources: Sequence[LabelFile], meaning: Mapping[str, int]) -> None:
    counts = Counter(shape.name for _, one in _each(sources) for shape in one.shapes)
    unknown = [] if ANY in meaning else sorted(counts.keys() - meaning.keys())
    if unknown:
        raise ConfigError(
            f"the labels have classes without a meaning here: {', '.join(unknown)}; say what each "
            f"is, such as {EXAMPLE}"
        )


class _Writer:
    """Writes pair after pair, and measures whether the labels lie on what is green."""

    def __init__(self, folder: Path, meaning: Mapping[str, int], problems: list[str]) -> None:
        self.folder, self.meaning, self.problems = folder, meaning, problems
        self.keys: dict[str, Path] = {}
        self.shapes: dict[str, Counter[str]] = {}  # shapes of each written picture
        self.unlabelled: list[str] = []
        self.without_area: list[str] = []
        self._placement = PlacementTally()
        self._contrasts: list[float] = []
        shutil.rmtree(folder, ignore_errors=True)  # files of an import that was killed

    def add(self, picture: LabelledPicture, index: PictureIndex) -> None:
        try:
            if picture.problem:
                raise LabelFileError(picture.problem)
            path = index.find(picture.file)
            image_rgb = read_picture(path)
            label = paint(picture, image_rgb.shape[:2], self.meaning)
            key = self._write(path, label)
        except (LabelFileError, PictureError) as error:
            text = add_advice(str(error), EXPORT)
            self.problems.append(text if picture.file in text else f"{picture.file}: {text}")
            return
        self.without_area += [f"{path.name}: {reason}" for reason in picture.left_out]
        self.shapes[key] = Counter(shape.name for shape in picture.shapes)
        self._placement.add(key, image_rgb, label)
        self._measure(image_rgb, label)

    def _write(self, path: Path, label: ByteArray) -> str:
        key = ENDING.sub("", path.stem)
        if key in self.keys:
            if self.keys[key] == path:
                raise LabelFileError("is labelled twice; the first labels were taken")
            key = f"{path.parent.name}-{key}"
        if key in self.keys:
            raise LabelFileError("another picture has this name; rename one of them")
        self.keys[key] = path
        for name in ("images", "masks"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, self.folder / "images" / f"{key}{path.suffix.lower()}")
        (self.folder / "masks" / f"{key}.png").write_bytes(encode_mask(label))
        return key

    def _measure(self, image_rgb: ByteArray, label: ByteArray) -> None:
        stride = (slice(None, None, 4), slice(None, None, 4))
        green, small = excess_green(image_rgb[stride]), label[stride]
        plant, soil = small < PlantClass.SOIL, small == PlantClass.SOIL
        if not plant.any() or not soil.any():
            return
        self._contrasts.append(float(green[plant].mean() - green[soil].mean()))

    def drop_misplaced(self, out: Path) -> None:
        """Take out the pictures whose labels do not lie on their plants.

        Raises: ConfigError: there are too many of them.
        """
        self._placement.refuse(f"{out} was not written")
        for key, reason in self._placement.misplaced.items():
            path = self.keys.pop(key)
            del self.shapes[key]
            (self.folder / "images" / f"{key}{path.suffix.lower()}").unlink()
            (self.folder / "masks" / f"{key}.png").unlink()
            self.problems.append(f"{path.name}: its labels do not lie on its plants; {reason}")

    def report(self, out: Path) -> ImportReport:
        """Sum up what was written."""
        return ImportReport(
            folder=str(out),
            pictures=len(self.keys),
            shapes=dict(sum(self.shapes.values(), Counter())),
            unlabelled=tuple(self.unlabelled),
            without_area=tuple(self.without_area),
            problems=tuple(self.problems),
        )

    def check(self, out: Path) -> None:
        """Refuse a set that nothing can be learnt from.

        Raises: ConfigError: nothing was usable, or the labels do not lie on the plants.
        """
        if not self.keys:
            reason = self.problems[0] if self.problems else "none of the pictures is labelled"
            raise ConfigError(f"{out} was not written, no picture can be used; {reason}")
        if not self._contrasts:
            return
        greener = float(np.mean(self._contrasts))
        if greener < -GREENER:
            raise ConfigError(
                f"{out} was not written: what is called plant is less green than what is called "
                f"soil (by {-greener:.2f}); check --classes and that pictures and labels belong "
                "together"
            )


def paint(
    picture: LabelledPicture, shape: tuple[int, int], meaning: Mapping[str, int]
) -> ByteArray:
    """Paint the classes (height, width): soil, and the shapes in their order over it.

    Raises: LabelFileError: labels for another size, or out of the picture.
    """
    height, width = shape
    if picture.size_px is not None and picture.size_px != (width, height):
        is_turned = picture.size_px == (height, width)
        raise LabelFileError(
            f"is {width} x {height} pixels, its labels are for {picture.size_px[0]} x "
            f"{picture.size_px[1]}" + ("; one of them is turned on its side" if is_turned else "")
        )
    label = Image.new("L", (width, height), int(PlantClass.SOIL))
    scale = np.array([1.0, 1.0]) if picture.size_px else np.array([width, height], np.float64)
    for one in picture.shapes:
        kind = meaning.get(one.name, meaning.get(ANY, PlantClass.SOIL))
        if one.mask is not None:
            label.paste(int(kind), None, Image.fromarray(one.mask()))
        for polygon in one.polygons:
            _fill(label, check_inside(polygon * scale, (width, height)), int(kind))
    return np.asarray(label)


def _fill(label: Image.Image, polygon: Polygon, kind: int) -> None:
    # Pillow counts from the middle of the first pixel, labelling tools from its corner.
    corners = [(float(u), float(v)) for u, v in polygon - 0.5]
    ImageDraw.Draw(label).polygon(corners, fill=kind)


def encode_mask(label: ByteArray) -> bytes:
    """Encode classes (height, width) as an 8-bit grey PNG."""
    buffer = io.BytesIO()
    Image.fromarray(label).save(buffer, format="PNG", compress_level=4)
    return buffer.getvalue()
