"""Input size and precision of a network, chosen by what they cost here and how well they judge."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.messages import ByteArray
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import evaluate
from agribot.lab.train.networks import STRIDE_PX, write_network
from agribot.lab.train.precision import quantise_to_int8
from agribot.lab.train.resizing import resize_network

SIZE_RATIOS = (0.5, 0.625, 0.8, 1.0, 1.25)
FLOAT, EIGHT_BITS = "fp32", "int8"

Progress = Callable[[str], None]
MeasureCost = Callable[[Segmenter], float]


class Candidate(NamedTuple):
    """A file at one size and precision: CPU time of a picture of its size, and mean IoU."""

    path: Path
    height_px: int
    width_px: int
    precision: str
    cpu_ms: float
    miou: float

    def describe(self) -> str:
        return (
            f"{self.width_px}x{self.height_px} {self.precision}: {self.cpu_ms:.1f} ms CPU per "
            f"frame, mIoU {self.miou:.4f}"
        )


class Trial:
    """Tries a network on labelled pictures (`pairs`, which can be read again and again)."""

    def __init__(
        self,
        source: Path,
        folder: Path,
        pairs: Iterable[LabelledImage],
        measure_cost: MeasureCost,
        progress: Progress,
    ) -> None:
        self._source, self._folder, self._pairs = source, folder, pairs
        self._measure_cost, self._progress = measure_cost, progress
        self.tried: list[Candidate] = []

    def try_sizes(self) -> None:
        """Try the sizes about the network's own."""
        for height_px, width_px in list_sizes(Segmenter(self._source).map_shape):
            path = self._folder / f"{width_px}x{height_px}.onnx"
            path.write_bytes(resize_network(self._source, height_px, width_px))
            self._judge(path, FLOAT)

    def try_eight_bits(self, one: Candidate, pictures: Iterable[ByteArray]) -> None:
        """Try 8-bit numbers at the size of a candidate, their ranges from these pictures."""
        path = one.path.with_name(f"{one.path.stem}-{EIGHT_BITS}.onnx")
        quantise_to_int8(one.path, path, pictures)
        self._judge(path, EIGHT_BITS)

    def _judge(self, path: Path, precision: str) -> None:
        segmenter = Segmenter(path)
        found = evaluate(lambda image_rgb: classify(segmenter, image_rgb).class_id, self._pairs)
        height_px, width_px = segmenter.map_shape
        cost_ms = self._measure_cost(segmenter)
        self.tried.append(Candidate(path, height_px, width_px, precision, cost_ms, found.miou))
        self._progress(self.tried[-1].describe())


def list_sizes(own_px: tuple[int, int]) -> list[tuple[int, int]]:
    """List sizes (height, width) from half of a network's own to a quarter more, strides apart."""
    sizes = [
        (_round_to_stride(ratio * own_px[0]), _round_to_stride(ratio * own_px[1]))
        for ratio in SIZE_RATIOS
    ]
    return list(dict.fromkeys(sizes))


def _round_to_stride(size_px: float) -> int:
    return max(1, round(size_px / STRIDE_PX)) * STRIDE_PX


def choose_candidate(tried: Sequence[Candidate], most_loss: float) -> Candidate:
    """Choose the cheapest whose mean IoU is at most `most_loss` below the best."""
    best = max(one.miou for one in tried)
    good = [one for one in tried if one.miou >= best - most_loss]
    return min(good, key=lambda one: one.cpu_ms)


def choose_export(
    trial: Trial, most_loss: float, pictures: Iterable[ByteArray] | None, target: Path
) -> Candidate:
    """Try sizes, then 8 bits at the best of them, and copy the file that is chosen to `target`.

    `pictures` set the ranges of 8-bit numbers; None: these are not tried.
    """
    trial.try_sizes()
    if pictures is not None:
        trial.try_eight_bits(choose_candidate(trial.tried, most_loss), pictures)
    chosen = choose_candidate(trial.tried, most_loss)
    write_network(chosen.path, target)
    return chosen
