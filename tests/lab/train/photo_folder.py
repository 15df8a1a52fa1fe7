"""A folder of small labelled pictures in the layout of CWFID."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from tests.lab.train.drawn_images import drawn_image

MASK_RGB = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 0]], dtype=np.uint8)


def photo_folder(root: Path, count: int) -> Path:
    for name in ("images", "annotations"):
        (root / name).mkdir(parents=True)
    for index in range(count):
        image_rgb, label = drawn_image(np.random.default_rng(index))
        Image.fromarray(image_rgb).save(root / "images" / f"{index:03d}_image.png")
        mask = Image.fromarray(MASK_RGB[label])
        mask.save(root / "annotations" / f"{index:03d}_annotation.png")
    return root


def spoil(root: Path) -> list[str]:
    """Break four of the pairs; the files that a message has to name."""
    images, masks = root / "images", root / "annotations"
    (images / "000_image.png").write_bytes(b"")
    whole = (masks / "001_annotation.png").read_bytes()
    (masks / "001_annotation.png").write_bytes(whole[: len(whole) // 2])
    Image.new("RGB", (9, 9)).save(masks / "002_annotation.png")
    (masks / "003_annotation.png").unlink()
    purple = Image.open(masks / "004_annotation.png").convert("RGB")
    purple.paste((200, 0, 200), (0, 0, 5, 5))
    purple.save(masks / "004_annotation.png")
    return [
        "000_image.png", "001_annotation.png", "002_annotation.png", "003_image.png",
        "004_annotation.png",
    ]  # fmt: skip
