"""Rows in photographs of a robot's front camera, against the lines that people drew along them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.lab.adapt.row_teacher import SeenRows, see_rows
from tests import nightly

DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "crdld-rows"
TOP_RATIO = 0.3  # of the height, above which lines do not count

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="AGRIBOT_DATA holds no crdld-rows/images")


@pytest.fixture(scope="module")
def paths() -> list[Path]:
    """List a quarter of the photographs; every fifth is kept for judging networks."""
    found = sorted((DATA / "images").glob("*.jpg"), key=lambda path: path.name)
    return [path for index, path in enumerate(found) if index % 5][::4]


@pytest.fixture(scope="module")
def seen(paths: list[Path]) -> SeenRows:
    return see_rows(paths, Segmenter("agribot-plants"), lambda done: None)


@nightly.by_day(
    "tests/autonomy/perceive/test_picture_rows.py"
    "::test_lines_of_rows_are_found_where_they_cross_the_lower_edge"
)
def test_rows_lie_on_the_lines_that_people_drew_in_nineteen_of_twenty_pictures(
    seen: SeenRows,
) -> None:
    off = []
    for path, rows in seen.rows.items():
        with Image.open(DATA / "labels" / path.name) as image:
            is_line = np.asarray(image.convert("L")) > 127
        is_line[: round(TOP_RATIO * len(is_line))] = False
        off.append(float(np.nanmedian(rows.measure_off(*is_line.shape)[is_line])))
    assert np.mean(np.array(off) < 0.2) >= 0.95
    assert np.median(off) < 0.08


@nightly.by_day(
    "tests/autonomy/perceive/test_picture_rows.py"
    "::test_pictures_of_rows_have_more_evidence_than_they_would_without_rows"
)
def test_nine_of_ten_real_pictures_show_rows(paths: list[Path], seen: SeenRows) -> None:
    assert len(seen.rows) >= 0.9 * len(paths)
