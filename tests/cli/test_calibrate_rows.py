"""`agribot calibrate camera --rows` as a person types it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.app.calibration import row_mount
from agribot.cli.main import main
from tests.autonomy.perceive.drawn_rows import draw_cover, draw_photograph, make_rows
from tests.lab.dataset.test_label_by_rows import record

SEEN = make_rows(across=0.5, down=-0.15, foot=0.5, spacing=0.6)


def write_pictures(folder: Path, count: int, *, has_rows: bool = True) -> Path:
    folder.mkdir()
    rng = np.random.default_rng(2)
    for k in range(count):
        rows = SEEN._replace(
            across_ratio=rng.uniform(0.4, 0.6), foot_ratio=rng.uniform(0.3, 0.7)
        )  # fmt: skip
        cover = draw_cover(rows if has_rows else None, rng, weeds=40 if has_rows else 200)
        Image.fromarray(draw_photograph(cover, rng)).save(folder / f"{k}.png")
    return folder


def calibrate(*words: str) -> int:
    return main(["calibrate", "camera", "--rows", *words])


def test_pictures_of_rows_tell_height_and_pitch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_pictures(tmp_path / "rows", 8)
    words = ["--pictures", str(folder), "--row-spacing", "0.5", "--lens-deg", "60", "--json"]
    assert calibrate(*words) == 0
    printed = capsys.readouterr()
    fit = json.loads(printed.out)["fit"]
    # The horizon lies 0.65 of the picture's height over its middle; the picture is 192 px high.
    focal_px = 128.0 / np.tan(np.radians(30.0))
    pitch_rad = np.arctan(0.65 * 192.0 / focal_px)
    assert abs(fit["pitch_rad"] - pitch_rad) < 2.0 * fit["pitch_std_rad"]
    # Rows are 0.6 of 256 px apart at the lower edge, 1.15 of 192 px below the horizon.
    over_leaves_m = 0.5 * np.cos(pitch_rad) * 1.15 * 192.0 / (0.6 * 256.0)
    assert abs(fit["height_m"] - over_leaves_m - 0.08) < 2.0 * fit["height_std_m"]
    assert "calibration.camera_height_m" in printed.err


def test_pictures_without_rows_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_pictures(tmp_path / "weeds", 8, has_rows=False)
    assert calibrate("--pictures", str(folder), "--row-spacing", "0.5", "--lens-deg", "60") == 1
    assert "do not use it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "either --pictures DIR or --recording FILE"),
        (["--pictures", "none"], "--pictures none: holds no pictures"),
        (["--pictures", "none", "--row-spacing", "9"], "--row-spacing 9: out of range"),
        (["--pictures", "none", "--row-spacing", "nan"], "--row-spacing nan: out of range"),
        (["--pictures", "none", "--lens-deg", "5"], "--lens-deg 5: out of range"),
    ],
)
def test_what_is_missing_is_named(
    words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(*words) == 2
    assert reason in capsys.readouterr().err


def test_pictures_without_a_row_spacing_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_pictures(tmp_path / "rows", 1)
    assert calibrate("--pictures", str(folder)) == 2
    assert "give --row-spacing M" in capsys.readouterr().err


def test_pictures_need_the_option_that_reads_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "camera", "--pictures", "photographs"]) == 2
    assert "--pictures goes with --rows" in capsys.readouterr().err


def test_a_recording_says_how_far_apart_rows_are_and_what_its_camera_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_pictures(tmp_path / "rows", 2)
    images_rgb = [np.asarray(Image.open(path)) for path in sorted(folder.iterdir())]
    record(tmp_path / "run.mcap", images_rgb)
    assert calibrate("--recording", str(tmp_path / "run.mcap"), "--json") == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out)["fit"]["pictures"] == 2
    assert "2 pictures, at least 8 are needed" in printed.err


def test_many_pictures_are_looked_at_evenly() -> None:
    chosen = row_mount.choose_evenly(range(480))
    assert chosen == list(range(0, 480, 10))
    assert row_mount.choose_evenly(range(3)) == [0, 1, 2]
