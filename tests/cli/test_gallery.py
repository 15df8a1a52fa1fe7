"""The gallery: one command, one picture, every tile of it showing something of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.fields import gallery
from agribot.cli.fields.gallery import CAPTION_PX, COLUMNS, GAP_PX, HEIGHT_PX, WIDTH_PX
from agribot.cli.main import main
from tests import nightly


@nightly.one_by_one("reduction", (3, 1), in_suite=1)
def test_every_tile_of_the_gallery_shows_something_else(
    reduction: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    width_px, height_px = WIDTH_PX // reduction, HEIGHT_PX // reduction
    monkeypatch.setattr(gallery, "WIDTH_PX", width_px)
    monkeypatch.setattr(gallery, "HEIGHT_PX", height_px)
    out = tmp_path / "new" / "folder" / "gallery.png"
    assert main(("world", "gallery", "-o", str(out))) == 0
    sheet = np.asarray(Image.open(out)).astype(float)
    rows = (sheet.shape[0] - GAP_PX) // (height_px + CAPTION_PX + GAP_PX)
    tiles = []
    for index in range(rows * COLUMNS):
        top = GAP_PX + index // COLUMNS * (height_px + CAPTION_PX + GAP_PX)
        left = GAP_PX + index % COLUMNS * (width_px + GAP_PX)
        tiles.append(sheet[top : top + height_px, left : left + width_px])
    assert len(tiles) == 12
    for index, tile in enumerate(tiles):
        assert tile.std() > 15.0, index
        assert 40.0 < tile.mean() < 215.0, index  # neither night nor glare
        assert all(np.abs(tile - other).mean() > 10.0 for other in tiles[:index]), index


def test_a_file_type_that_holds_no_picture_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "agribot.cli.fields.gallery.draw_gallery", lambda: np.zeros((4, 4, 3), np.uint8)
    )
    assert main(("world", "gallery", "-o", str(tmp_path / "gallery.world"))) == 2
    assert "ends in .png" in capsys.readouterr().err
