"""A new folder of pictures and the labels that their rows make, as training reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.whole_file import write_at_once
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.dataset.importing import encode_mask


class TaughtSet:
    """Writes pictures to `out`/images and their classes to `out`/masks; counts the pixels."""

    def __init__(self, out: Path) -> None:
        """Raise: ConfigError: the folder holds files."""
        if out.exists() and any(out.iterdir()):
            raise ConfigError(f"--out {out} is no empty folder; give a new one, or empty it")
        self._out = out
        self._counts = np.zeros(256, dtype=np.int64)

    def add(self, name: str, picture: bytes, label: ByteArray) -> None:
        """Write a picture as the file that it is, under its name, and its label (H, W)."""
        for folder in ("images", "masks"):
            (self._out / folder).mkdir(parents=True, exist_ok=True)
        mask = (self._out / "masks" / name).with_suffix(".png")
        write_at_once(mask, encode_mask(label))
        write_at_once(self._out / "images" / name, picture)
        self._counts += np.bincount(label.ravel(), minlength=256)

    @property
    def pixel_ratio(self) -> dict[str, float]:
        """Shares of the pixels written, by class; `ignore` are those without one."""
        shares = (self._counts / self._counts.sum()).tolist()
        named = {kind.name.lower(): shares[kind] for kind in PlantClass}
        return {**named, "ignore": shares[UNLABELLED]}
