"""Networks by name: their files, their cards, and the same network at another input size."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.errors import ConfigError, explain_os_error
from agribot.core.whole_file import write_at_once

STRIDE_PX = 32


def read_size(text: str, multiple_px: int = 1) -> tuple[int, int]:
    """Read (height, width) from "WIDTHxHEIGHT".

    Raises: ConfigError: not two whole numbers, or no multiples.
    """
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.isdigit() and int(word) for word in words):
        raise ConfigError(
            f"size {text}: not a size; write width and height in pixels, as in 512x384"
        )
    width_px, height_px = (int(word) for word in words)
    if width_px % multiple_px or height_px % multiple_px:
        raise ConfigError(f"size {text}: out of step; give multiples of {multiple_px} pixels")
    return height_px, width_px


def open_network(
    model: str | Path, threads: int = 1, size: str | None = None, providers: str = "cpu"
) -> Segmenter:
    """Open a network by its name or file, at another input size if one is given.

    Raises: PerceptionError: no such network; ConfigError: an impossible size.
    """
    chosen = {
        "cpu": ("CPUExecutionProvider",),
        "cuda": ("CUDAExecutionProvider", "CPUExecutionProvider"),
        "tensorrt": (
            "TensorrtExecutionProvider",
            "CUDAExecutionProvider",
            "CPUExecutionProvider",
        ),
    }[providers]
    as_it_is = Segmenter(model, threads, chosen)
    if size is None:
        return as_it_is
    from agribot.lab.train.resizing import resize_network

    height_px, width_px = read_size(size, STRIDE_PX)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "resized.onnx"
        path.write_bytes(resize_network(model_path(model), height_px, width_px))
        return Segmenter(path, threads, chosen)


def write_network(made: Path, target: Path) -> None:
    """Put a finished file where it was asked for, whole or not at all.

    Raises: RecordingError: it cannot be written.
    """
    with explain_os_error(f"cannot write {target}", "make room, or choose another -o"):
        write_at_once(target, made.read_bytes())


def read_card(model: str | Path) -> dict[str, Any]:
    """Read the card beside the weights; empty without a card."""
    path = model_path(model).with_suffix(".json")
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return card if isinstance(card, dict) else {}
