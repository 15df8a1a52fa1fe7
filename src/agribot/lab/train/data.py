"""Labelled images on disk: drawn once, scene by scene, and read back by every later training."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np

from agribot.app.workers import Stop, results, usable_cpus
from agribot.core.errors import AgribotError
from agribot.core.messages import ByteArray
from agribot.core.whole_file import make_at_once
from agribot.lab.train.plant_truth import DrawnView, PlantTruth, load_plants, save_plants

LabelledImage = tuple[ByteArray, ByteArray]
# Draws one scene and yields the given number of views, with plants where the set has them.
SceneDrawer = Callable[[np.random.Generator, int], Iterator[LabelledImage | DrawnView]]

ABOUT = "data.json"
READERS, READ_AT_ONCE = min(16, usable_cpus()), 256


class DataSet(msgspec.Struct, frozen=True, kw_only=True):
    """Folder of images and their origin.

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

    def draw(
        self,
        count: int,
        drawer: SceneDrawer,
        progress: Callable[[str], None],
        workers: int = 1,
    ) -> None:
        """Draw what is missing of the first `count` images; safe to kill and to start again.

        More than one of `workers` are processes: `drawer` can be pickled then.
        """
        (self.folder / self.name).mkdir(parents=True, exist_ok=True)
        self._check_origin()
        jobs = [
            _SceneJob(images=self, scene=first // self.views_per_scene, count=count, drawer=drawer)
            for first in range(0, count, self.views_per_scene)
            if not self._is_drawn(range(first, min(first + self.views_per_scene, count)))
        ]
        for done, _ in enumerate(results(_draw_scene, jobs, workers, lambda: False), 1):
            if done % 10 == 0 or done == len(jobs):
                progress(f"{self.name}: {done}/{len(jobs)} scenes drawn, in {self.folder}")

    def _is_drawn(self, indices: range) -> bool:
        return all(path.is_file() for index in indices for path in self.files(index))

    def draw_scene(self, scene: int, count: int, drawer: SceneDrawer) -> None:
        """Draw those of the first `count` images that are of one scene."""
        first = scene * self.views_per_scene
        rng = np.random.default_rng([self.seed, self.stream, scene])
        views = drawer(rng, self.views_per_scene)
        indices = range(first, min(first + self.views_per_scene, count))
        for index, view in zip(indices, views, strict=False):
            paths = self.files(index)
            for path, pixels in zip(paths[:2], view[:2], strict=True):
                _write_png(path, pixels)
            if self.has_plants:
                assert isinstance(view, DrawnView)
                save_plants(paths[2], view.plants)

    def read(self, count: int) -> Iterator[LabelledImage]:
        """Read the first `count` images."""
        for image_rgb, label, _ in self._read_ahead(count, has_plants=False):
            yield image_rgb, label

    def read_views(self, count: int) -> Iterator[DrawnView]:
        """Read the first `count` images with their plants; only where there are any."""
        for image_rgb, label, plants in self._read_ahead(count, has_plants=True):
            assert plants is not None
            yield DrawnView(image_rgb, label, plants)

    def _read_ahead(
        self, count: int, *, has_plants: bool
    ) -> Iterator[tuple[ByteArray, ByteArray, PlantTruth | None]]:
        """Read images in their order, some at once."""

        def read(index: int) -> tuple[ByteArray, ByteArray, PlantTruth | None]:
            image_path, label_path, *plants_path = self.files(index)
            plants = load_plants(plants_path[0]) if has_plants else None
            return _read_png(image_path), _read_png(label_path), plants

        with ThreadPoolExecutor(READERS) as pool:
            for first in range(0, count, READ_AT_ONCE):
                yield from pool.map(read, range(first, min(first + READ_AT_ONCE, count)))

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


class _SceneJob(msgspec.Struct, frozen=True, kw_only=True):
    images: DataSet
    scene: int
    count: int
    drawer: SceneDrawer


def _draw_scene(job: _SceneJob, stop: Stop) -> None:
    job.images.draw_scene(job.scene, job.count, job.drawer)


def _read_png(path: Path) -> ByteArray:
    from PIL import Image

    with Image.open(path) as picture:
        return np.asarray(picture)


def _write_png(path: Path, pixels: ByteArray) -> None:
    from PIL import Image

    def save(beside: Path) -> None:
        Image.fromarray(pixels).save(beside, format="PNG", compress_level=1)

    make_at_once(path, save)
