"""Labelled images on disk: drawn once, scene by scene, and read back by every later training."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np

from agribot.core.errors import AgribotError
from agribot.core.messages import ByteArray
from agribot.core.whole_file import make_at_once
from agribot.lab.train.fit import Progress
from agribot.lab.train.plant_truth import DrawnView, load_plants, save_plants

LabelledImage = tuple[ByteArray, ByteArray]
# Draws one scene and yields so many views of it, with plants where the set has them.
SceneDrawer = Callable[[np.random.Generator, int], Iterator[LabelledImage | DrawnView]]

ABOUT = "data.json"


class DataSet(msgspec.Struct, frozen=True, kw_only=True):
    """Where images lie and what they were drawn from.

    Scene k of a seed is always the same, so a bigger set only adds scenes. Training and test
    images never share a scene: `stream` keeps their random numbers apart. With `has_plants` the
    single plants of every image lie beside its classes.
    """

    folder: Path
    name: str
    stream: int
    seed: int
    views_per_scene: int
    has_plants: bool = False

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the paths of image, classes and, if there are any, single plants."""
        kinds = ("image.png", "label.png", "plants.npz")[: 3 if self.has_plants else 2]
        return tuple(self.folder / self.name / f"{index:06d}.{kind}" for kind in kinds)

    def draw(self, count: int, drawer: SceneDrawer, progress: Progress) -> None:
        """Draw what is missing of the first `count` images; safe to kill and to start again."""
        (self.folder / self.name).mkdir(parents=True, exist_ok=True)
        self._check_origin()
        for first in range(0, count, self.views_per_scene):
            indices = range(first, min(first + self.views_per_scene, count))
            if all(path.is_file() for index in indices for path in self.files(index)):
                continue
            scene = first // self.views_per_scene
            rng = np.random.default_rng([self.seed, self.stream, scene])
            views = drawer(rng, self.views_per_scene)
            for index, view in zip(indices, views, strict=False):
                paths = self.files(index)
                for path, pixels in zip(paths[:2], view[:2], strict=True):
                    _write_png(path, pixels)
                if self.has_plants:
                    assert isinstance(view, DrawnView)
                    save_plants(paths[2], view.plants)
            if scene % 10 == 0 or indices[-1] == count - 1:
                progress(f"{self.name}: {indices[-1] + 1}/{count} images in {self.folder}")

    def read(self, count: int) -> Iterator[LabelledImage]:
        from PIL import Image

        for index in range(count):
            image_path, label_path, *_ = self.files(index)
            with Image.open(image_path) as image, Image.open(label_path) as label:
                yield np.asarray(image.convert("RGB")), np.asarray(label)

    def read_views(self, count: int) -> Iterator[DrawnView]:
        """Read the first `count` images with their plants; only where there are any."""
        for index, (image_rgb, label) in enumerate(self.read(count)):
            yield DrawnView(image_rgb, label, load_plants(self.files(index)[2]))

    def _check_origin(self) -> None:
        """Refuse a folder that holds the images of another seed."""
        path = self.folder / self.name / ABOUT
        origin = {
            "seed": self.seed,
            "stream": self.stream,
            "views_per_scene": self.views_per_scene,
        }
        if not path.is_file():
            path.write_text(json.dumps(origin) + "\n", encoding="utf-8")
        elif (found := json.loads(path.read_text(encoding="utf-8"))) != origin:
            raise AgribotError(
                f"{path.parent} holds images of {found}, not of {origin}; give the same --seed or "
                "another data folder"
            )


def _write_png(path: Path, pixels: ByteArray) -> None:
    from PIL import Image

    def save(beside: Path) -> None:
        Image.fromarray(pixels).save(beside, format="PNG", compress_level=1)

    make_at_once(path, save)
