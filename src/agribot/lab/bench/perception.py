"""What a picture costs from end to end: resize, network and class map, without decoding."""

from __future__ import annotations

import os
import platform
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

HEIGHT_PX, WIDTH_PX = 384, 512
PICTURE_SHAPE = (480, 640, 3)  # shape of the robot's camera
# Network of the original; it comes last: everything else is compared with it.
ORIGINAL = "original-bonnet"
INT8 = " int8"
NETWORKS = (
    "agribot-sim",
    "agribot-plants",
    "agribot-s",
    "agribot-s" + INT8,
    "agribot-m",
    "agribot-m" + INT8,
    "original-unet",
    ORIGINAL,
)
CALIBRATION_IMAGES = 2  # images of noise: enough to time, not to be accurate


def time_networks(
    networks: tuple[str, ...] = NETWORKS,
    threads: int = 2,
    frames: int = 30,
    size_px: tuple[int, int] = (HEIGHT_PX, WIDTH_PX),
) -> dict[str, Any]:
    """Time all networks in turn, frame by frame, so that a busy machine slows them alike.

    Weights are random: they do not change the time. Per network: wall and CPU milliseconds,
    frames per second at the best wall time, which other programs disturb least, and the CPU
    time of the original's Bonnet in the same run over its own.
    """
    names = (*(name for name in networks if name != ORIGINAL), ORIGINAL)
    with tempfile.TemporaryDirectory() as folder:
        segmenters = {name: _open_segmenter(name, Path(folder), size_px, threads) for name in names}
        wall_ms, cpu_ms = _time_frames(segmenters, frames)
    original_ms = float(np.median(cpu_ms[ORIGINAL]))
    rows = []
    for name in names:
        wall = float(np.median(wall_ms[name]))
        rows.append(
            {
                "network": name,
                "wall_ms": wall,
                "wall_p95_ms": float(np.percentile(wall_ms[name], 95)),
                "wall_best_ms": min(wall_ms[name]),
                "cpu_ms": float(np.median(cpu_ms[name])),
                "fps": 1e3 / min(wall_ms[name]),
                "times_as_fast": original_ms / float(np.median(cpu_ms[name])),
            }
        )
    return {
        "height_px": size_px[0],
        "width_px": size_px[1],
        "threads": threads,
        "cpus": os.cpu_count(),
        "machine": platform.machine(),
        "frames": frames,
        "weights": "random",
        "networks": rows,
    }


def format_table(result: dict[str, Any]) -> str:
    """Format the result as lines of text."""
    lines = [
        f"{result['width_px']} x {result['height_px']}, {result['threads']} threads, random "
        f"weights, median of {result['frames']} frames",
        f"{'network':16} {'wall ms':>8} {'best ms':>8} {'CPU ms':>8} {'fps':>7} {'faster':>7}",
    ]
    lines += [
        f"{row['network']:16} {row['wall_ms']:8.1f} {row['wall_best_ms']:8.1f} "
        f"{row['cpu_ms']:8.1f} {row['fps']:7.1f} {row['times_as_fast']:6.1f}x"
        for row in result["networks"]
    ]
    return "\n".join(lines)


def _open_segmenter(name: str, folder: Path, size_px: tuple[int, int], threads: int) -> Any:
    import torch

    from agribot.autonomy.perceive.segmenter import Segmenter
    from agribot.lab.train.architectures import find_architecture
    from agribot.lab.train.export import export_onnx

    torch.manual_seed(0)
    known = find_architecture(name.removesuffix(INT8))
    path = folder / f"{name}.onnx"
    export_onnx(known.build().eval(), path, *size_px, features=known.features)
    if name.endswith(INT8):
        from agribot.lab.train.precision import quantise_to_int8

        whole, path = path, folder / "quantised" / path.name
        path.parent.mkdir(exist_ok=True)
        noise = np.random.default_rng(1)
        pictures = [
            noise.integers(0, 256, PICTURE_SHAPE, dtype=np.uint8) for _ in range(CALIBRATION_IMAGES)
        ]
        quantise_to_int8(whole, path, pictures)
    return Segmenter(path, threads)


def _time_frames(
    segmenters: dict[str, Any], frames: int
) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Time each frame of each network in wall and CPU ms, after a first one that warms up."""
    image_rgb = np.random.default_rng(0).integers(0, 256, PICTURE_SHAPE, dtype=np.uint8)
    wall_ms: dict[str, list[float]] = {name: [] for name in segmenters}
    cpu_ms: dict[str, list[float]] = {name: [] for name in segmenters}
    for turn in range(frames + 1):
        for name, segmenter in segmenters.items():
            started_s, cpu_started_s = time.perf_counter(), time.process_time()
            segmenter.segment(image_rgb)
            if turn:
                wall_ms[name].append(1e3 * (time.perf_counter() - started_s))
                cpu_ms[name].append(1e3 * (time.process_time() - cpu_started_s))
    return wall_ms, cpu_ms
