"""Pictures in every form that cameras and programs write, and files that are not pictures."""

from __future__ import annotations

import io
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.lab.dataset.pictures import LARGEST_PX, PictureError, read_picture

RAMP = np.arange(0, 240, 20, dtype=np.uint8).reshape(3, 4)


def saved(picture: Image.Image, path: Path, **options: object) -> Path:
    picture.save(path, **options)  # type: ignore[arg-type]
    return path


def test_red_green_and_blue_come_back_as_they_are(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    for suffix in ("png", "tif", "bmp"):
        path = saved(Image.fromarray(pixels), tmp_path / f"a.{suffix}")
        np.testing.assert_array_equal(read_picture(path), pixels)


def test_grey_becomes_three_equal_channels(tmp_path: Path) -> None:
    found = read_picture(saved(Image.fromarray(RAMP), tmp_path / "grey.png"))
    np.testing.assert_array_equal(found, np.repeat(RAMP[..., None], 3, axis=2))


def test_sixteen_bits_keep_their_upper_eight(tmp_path: Path) -> None:
    deep = RAMP.astype(np.uint16) * 257
    for suffix in ("png", "tif"):
        found = read_picture(saved(Image.fromarray(deep), tmp_path / f"deep.{suffix}"))
        np.testing.assert_array_equal(found[..., 0], RAMP)


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_deep_pixels_at_the_lower_end_of_sixteen_bits_keep_their_upper_eight(
    tmp_path: Path, bits: int
) -> None:
    deep = (RAMP.astype(np.uint16) << (bits - 8)) | 1
    found = read_picture(saved(Image.fromarray(deep), tmp_path / "deep.png"))
    np.testing.assert_array_equal(found[..., 0], RAMP)


def test_eight_bit_values_in_a_sixteen_bit_file_stay(tmp_path: Path) -> None:
    found = read_picture(saved(Image.fromarray(RAMP.astype(np.uint16)), tmp_path / "wide.png"))
    np.testing.assert_array_equal(found[..., 0], RAMP)


def test_alpha_is_dropped(tmp_path: Path) -> None:
    pixels = np.full((2, 2, 4), (10, 20, 30, 0), np.uint8)
    found = read_picture(saved(Image.fromarray(pixels), tmp_path / "alpha.png"))
    np.testing.assert_array_equal(found, pixels[..., :3])


def test_cmyk_becomes_red_green_and_blue(tmp_path: Path) -> None:
    ink = Image.new("CMYK", (8, 8), (255, 0, 255, 0))  # cyan and yellow: green
    found = read_picture(saved(ink, tmp_path / "ink.jpg"))
    assert found.shape == (8, 8, 3)
    assert found[4, 4, 1] > 200
    assert found[4, 4, 0] < 60


def test_a_palette_gives_its_colours(tmp_path: Path) -> None:
    picture = Image.fromarray(np.full((4, 4, 3), (0, 255, 0), np.uint8)).convert("P")
    assert read_picture(saved(picture, tmp_path / "p.png"))[0, 0].tolist() == [0, 255, 0]


def test_a_phone_held_upright_gives_an_upright_picture(tmp_path: Path) -> None:
    pixels = np.zeros((16, 32, 3), np.uint8)
    pixels[:, :8] = 255  # the left of the file is the top of the scene
    exif = Image.Exif()
    exif[0x0112] = 6
    path = saved(Image.fromarray(pixels), tmp_path / "turned.png", exif=exif)
    found = read_picture(path)
    assert found.shape == (32, 16, 3)
    assert found[:8].min() == 255
    assert found[8:].max() == 0


def test_a_single_pixel_is_a_picture(tmp_path: Path) -> None:
    assert read_picture(saved(Image.new("RGB", (1, 1)), tmp_path / "1.png")).shape == (1, 1, 3)


def test_a_hundred_megapixels_are_read(tmp_path: Path) -> None:
    path = saved(Image.new("L", (10_000, 10_000)), tmp_path / "huge.tif")
    assert read_picture(path).shape == (10_000, 10_000, 3)


@pytest.mark.parametrize(
    ("side_px", "reason"), [(15_000, "cannot be decoded"), (16_000, "too many pixels")]
)
def test_what_is_refused_for_its_size_is_above_the_limit_that_is_stated(
    side_px: int, reason: str, tmp_path: Path
) -> None:
    path = saved(Image.new("1", (1, 1)), tmp_path / "stub.png")
    png = bytearray(path.read_bytes())
    png[16:24] = side_px.to_bytes(4, "big") * 2  # width and height
    png[29:33] = zlib.crc32(png[12:29]).to_bytes(4, "big")
    path.write_bytes(png)
    assert (side_px**2 > LARGEST_PX) == ("many" in reason)
    with pytest.raises(PictureError, match=reason):
        read_picture(path)


def jpeg(tmp_path: Path) -> bytes:
    data = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save(data, format="JPEG")
    return data.getvalue()


@pytest.mark.parametrize(
    ("name", "kept", "reason"),
    [("empty.jpg", 0, "empty"), ("cut.jpg", 900, "decoded"), ("stub.jpg", 12, "is not a picture")],
)
def test_a_broken_file_is_named_with_its_reason(
    name: str, kept: int, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(jpeg(tmp_path)[:kept])
    with pytest.raises(PictureError, match=reason) as error:
        read_picture(path)
    assert str(path) in str(error.value)


def test_text_a_folder_and_floating_point_are_refused(tmp_path: Path) -> None:
    text = tmp_path / "notes.png"
    text.write_text("weeds everywhere", encoding="utf-8")
    real = saved(Image.fromarray(np.zeros((4, 4), np.float32)), tmp_path / "real.tif")
    for path in (text, tmp_path, real, tmp_path / "gone.png"):
        with pytest.raises(PictureError, match=str(path)):
            read_picture(path)
