"""What rows say of pictures whose rows and weeds are drawn by known geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.adapt.row_teacher import (
    find_cameras,
    label_by_rows,
    measure_green,
    see_rows,
    teach,
)
from agribot.lab.dataset.classes import UNLABELLED
from tests.autonomy.perceive.drawn_rows import draw_cover, draw_photograph, make_rows

ROWS = make_rows(0.5, -0.08, 0.5, 0.55)
SHAPE = (96, 128)


class BlindNetwork:
    """A network that knows no plant: greenness alone has to show the rows."""

    map_shape = SHAPE

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        soil = np.full(SHAPE, PlantClass.SOIL, np.uint8)
        scale_px = (image_rgb.shape[0] / SHAPE[0], image_rgb.shape[1] / SHAPE[1])
        return ClassMap(class_id=soil, confidence=np.full(SHAPE, 255, np.uint8), scale_px=scale_px)


def write_photographs(folder: Path, count: int, *, has_rows: bool) -> list[Path]:
    rng = np.random.default_rng(7)
    paths = [folder / f"{number}.png" for number in range(count)]
    for path in paths:
        rows = ROWS._replace(foot_ratio=rng.uniform(0.3, 0.7)) if has_rows else None
        cover = draw_cover(rows, rng, SHAPE, weeds=10 if has_rows else 150)
        Image.fromarray(draw_photograph(cover, rng)).save(path)
    return paths


def ignore(done: int) -> None:
    pass


def test_plants_on_a_row_are_crop_plants_between_are_weed_and_brown_is_soil() -> None:
    rng = np.random.default_rng(1)
    crops, weeds = draw_cover(ROWS, rng, weeds=0), draw_cover(None, rng, weeds=60)
    label = label_by_rows(measure_green(draw_photograph(np.maximum(crops, weeds), rng)), ROWS)
    off = ROWS.measure_off(*label.shape)
    assert np.mean(label[(crops > 0) & (off < 0.15)] == PlantClass.CROP) > 0.95
    assert np.mean(label[(weeds > 0) & (off > 0.4)] == PlantClass.WEED) > 0.8
    is_bare = (crops == 0) & (weeds == 0)
    assert np.mean(np.isin(label[is_bare], (PlantClass.SOIL, UNLABELLED))) > 0.95


def test_plants_at_the_edge_of_a_row_teach_nothing() -> None:
    everywhere = np.full(SHAPE, 0.2)
    off = ROWS.measure_off(*SHAPE)
    label = label_by_rows(everywhere, ROWS)
    assert (label[(off > 0.2) & (off < 0.36)] == UNLABELLED).all()
    assert (label[np.isnan(off)] == UNLABELLED).all()


def test_rows_are_seen_by_greenness_where_the_network_knows_no_plant(tmp_path: Path) -> None:
    paths = write_photographs(tmp_path, 8, has_rows=True)
    seen = see_rows(paths, BlindNetwork(), ignore)
    assert len(seen.rows) == 8
    taught = teach(seen, tmp_path / "taught", ignore)
    assert taught.pixel_ratio["crop"] > 0.02
    names = [path.name for path in sorted((tmp_path / "taught" / "masks").iterdir())]
    cameras = find_cameras(seen)
    assert list(cameras) == names
    for camera in cameras.values():
        assert camera.horizon_px == pytest.approx(-0.08 * 512, abs=15.0)
        assert camera.spacing_px == pytest.approx(512 * 0.55 * (2 / 3 + 0.08) / 1.08, rel=0.06)


def test_pictures_without_rows_are_refused_with_how_many_show_any(tmp_path: Path) -> None:
    paths = write_photographs(tmp_path, 8, has_rows=False)
    with pytest.raises(ConfigError, match=r"no rows to be seen: in \d of 8 pictures"):
        see_rows(paths, BlindNetwork(), ignore)


def test_few_pictures_are_refused_with_the_number_that_is_needed(tmp_path: Path) -> None:
    paths = write_photographs(tmp_path, 3, has_rows=True)
    with pytest.raises(ConfigError, match="3 pictures can be read, rows are found in 8 or more"):
        see_rows(paths, BlindNetwork(), ignore)


def test_a_picture_that_cannot_be_read_is_named_and_the_others_teach(tmp_path: Path) -> None:
    paths = write_photographs(tmp_path, 8, has_rows=True)
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"no picture")
    seen = see_rows([*paths, broken], BlindNetwork(), ignore)
    assert len(seen.rows) == 8
    assert len(seen.problems) == 1
    assert "broken.png" in seen.problems[0]
