"""The model card: what a network was trained on, how, and how good it is."""

from __future__ import annotations

import hashlib
import platform
import time
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass
from agribot.lab.plant_scores import PlantScores
from agribot.lab.plant_table import format_table
from agribot.lab.rows.figures import RowFigures
from agribot.lab.train.calibration import Calibration, Temperatures
from agribot.lab.train.efficientnet import PACKAGE, VERSION
from agribot.lab.train.evaluate import CLASS_NAMES, Scores
from agribot.lab.train.fit import TrainingPlan
from agribot.lab.train.start import IMAGENET

LICENSE = "Apache-2.0"
SIM_LIMITS = (
    "trained on simulated images only. How it does on photographs of a field was not measured."
)


class HeldOut(msgspec.Struct, frozen=True, kw_only=True):
    """The scores of a training of the same recipe on images that were kept from it."""

    command: str
    steps: int
    train_images: int
    input_height_px: int
    input_width_px: int
    test: dict[str, Scores]
    calibration: Calibration | None = None


class ModelCard(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    license: str
    data: str
    command: str
    plan: TrainingPlan
    train_images: int
    parameters: int
    input_height_px: int
    input_width_px: int
    file_bytes: int
    sha256: str
    cpu_ms_per_frame: float
    cpu_ms_conditions: str
    training_cpu_min: float
    training_device: str = ""  # the GPU, if it was trained on one
    test: dict[str, Scores]
    # Scores of single plants, by scene of `agribot bench plants`.
    plants: dict[str, PlantScores] = {}
    rows: RowFigures | None = None  # figures of photographs with labelled crop rows
    kept_temperatures: Temperatures | None = None  # with the classes of weights it began with
    limits: str = SIM_LIMITS
    chosen_blind: bool = True  # no setting, such as the input size, was chosen by the test sets
    precision: str = "fp32"  # precision of the numbers in the file
    # Largest doubt of a picture it knows (perceive/doubt.py); None: no limit.
    most_doubt: float | None = None
    calibration: Calibration | None = None  # None: confidences are the softmax of the logits
    # Scores of a split where no data is left to judge these very weights on.
    held_out: HeldOut | None = None
    changed_since: str = ""  # differences of the same command today
    exported_from: str = ""  # SHA-256 of the file that was trained, whose scores these are

    def write(self, onnx_path: Path) -> None:
        """Put the card beside the weights, as JSON and as Markdown."""
        text = msgspec.json.format(msgspec.json.encode(self), indent=2)
        onnx_path.with_suffix(".json").write_bytes(text + b"\n")
        onnx_path.with_suffix(".md").write_text(self.markdown(), encoding="utf-8")

    def markdown(self) -> str:
        test = self.test if self.held_out is None else self.held_out.test
        tables = "\n\n".join(_format_scores(name, scores) for name, scores in test.items())
        if self.plants:
            tables += f"\n\n{_format_plants(self.plants)}"
        if self.rows is not None:
            tables += f"\n\n{self.rows.markdown()}"
        return f"""# {self.name}

Crop/weed segmentation: every pixel of a camera image is weed ({int(PlantClass.WEED)}), \
crop ({int(PlantClass.CROP)}) or soil ({int(PlantClass.SOIL)}).

- Licence of the weights: {self.license}
- Data: {self.data}
- Training images: {self.train_images}
- Command: `{self.command}`{self._change()}
- Begun with: {self._beginning()}{self._weighting()}
- Optimiser steps: {self.plan.steps}, seed {self.plan.seed}, {self._effort()}
- Parameters: {self.parameters:,}; file {self.file_bytes / 1e6:.2f} MB in {self.precision}, \
SHA-256 `{self.sha256}`
- Network resolution: {self.input_width_px} x {self.input_height_px}; the graph takes uint8 images \
of any size
- Speed: {self.cpu_ms_per_frame:.1f} ms CPU time per frame ({self.cpu_ms_conditions})
- Confidence: {self._sureness()}{self._doubt()}

{self._origin()}

{tables}

Limits: {self.limits}
"""

    def _beginning(self) -> str:
        start = self.plan.start
        if start == IMAGENET:
            return f"an encoder with the ImageNet weights of {PACKAGE} {VERSION} (Apache-2.0)"
        return f"the weights of {start}" if start else "random weights"

    def _weighting(self) -> str:
        """Say where the weights of the classes come from, where the labels gave them."""
        words = self.plan.class_weighting
        return f"\n- {words[:1].upper()}{words[1:]}" if words else ""

    def _effort(self) -> str:
        gpu = f" beside one {self.training_device}" if self.training_device else ""
        return f"{self.training_cpu_min:.1f} CPU-minutes{gpu}"

    def _change(self) -> str:
        changed = f"\n- Changed since: {self.changed_since}" if self.changed_since else ""
        if not self.exported_from:
            return changed
        return f"{changed}\n- Exported from: SHA-256 `{self.exported_from}`, whose scores these are"

    def _doubt(self) -> str:
        """Describe the pictures whose result the robot rejects, where there is a limit."""
        if self.most_doubt is None:
            return ""
        return f"\n- Doubt: pictures with more than {self.most_doubt:.3g} count as unknown"

    def _sureness(self) -> str:
        if self.kept_temperatures is not None:
            return (
                f"softmax of the logits over {_name_temperatures(self.kept_temperatures)} of the "
                "weights it began with, whose classes it keeps"
            )
        if self.calibration is not None:
            return f"softmax of the logits over {_describe_calibration(self.calibration)}"
        found = self.held_out.calibration if self.held_out else None
        if found is not None:
            return (
                f"softmax of the logits over {_describe_calibration(found)}; temperatures and "
                "errors are those of the training that held images out"
            )
        return "softmax of the logits, no temperature: no image was set aside to find one"

    def _origin(self) -> str:
        """Describe where the scores come from."""
        pooled = (
            "from one confusion matrix over all pixels of a test set, at the resolution of the "
            "labels"
        )
        choosing = " or for choosing a setting" if self.chosen_blind else ""
        other = self.held_out
        if other is None:
            untouched = f"No test image was used for training{choosing}."
            return f"Scores come {pooled}. {untouched}" if self.test else "No scores were measured."
        return (
            f"These weights were trained on all {self.train_images} images: none is left to judge "
            "them on, and how good they are on other images was not measured. The scores are those "
            f"of another training by the same recipe, on {other.train_images} of the images for "
            f"{other.steps} steps, judged at {other.input_width_px} x {other.input_height_px} on "
            f"images that it never saw; they come {pooled}. That training: `{other.command}`"
        )


def _name_temperatures(values: Temperatures) -> str:
    if values.weed == values.crop == values.soil:
        return f"the temperature {values.soil:g}"
    return (
        f"the temperatures {values.weed:g} of pixels taken for weed, {values.crop:g} of crop and "
        f"{values.soil:g} of soil"
    )


def _describe_calibration(found: Calibration) -> str:
    where = "these, each judged by the others" if found.is_by_turns else "test images"
    text = f"{_name_temperatures(found.temperatures)}, found on {found.images} images set aside"
    if found.error_after is None:
        return f"{text}; their gain was not measured: that takes a second image"
    before, after = found.plant_error_before, found.plant_error_after
    if after is None:
        plants = ""
    elif before is None:
        plants = f", {after:.4f} over the pixels taken for plants"
    else:
        plants = f", {before:.4f} and {after:.4f} over the pixels taken for plants"
    return (
        f"{text}; expected calibration error on {where} {found.error_before:.4f} without, "
        f"{found.error_after:.4f} with{plants}"
    )


def _format_scores(name: str, scores: Scores) -> str:
    lines = [
        f"## {name}: {scores.images} images, mean IoU {scores.miou:.3f}",
        "",
        "| class | IoU | precision | recall | F1 |",
        "|---|---|---|---|---|",
    ]
    for label in CLASS_NAMES:
        values = (s[label] for s in (scores.iou, scores.precision, scores.recall, scores.f1))
        cells = ("–" if value is None else f"{value:.3f}" for value in values)
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _format_plants(plants: dict[str, PlantScores]) -> str:
    return (
        "## Single plants\n\n"
        "By `agribot bench plants`, on fields that are drawn for it alone, seen from the robot's "
        f"own camera.\n\n{format_table(plants).rstrip()}"
    )


def measure_cpu_ms_per_frame(segmenter: Segmenter, frames: int = 20) -> float:
    """Measure the median CPU time of one 640 x 480 frame on this machine."""
    image_rgb = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    segmenter.segment(image_rgb)
    times_ms = []
    for _ in range(frames):
        started_s = time.process_time()
        segmenter.segment(image_rgb)
        times_ms.append(1e3 * (time.process_time() - started_s))
    return float(np.median(times_ms))


def describe_speed_conditions(threads: int) -> str:
    return (
        f"640 x 480 input, ONNX Runtime {version('onnxruntime')}, {threads} thread, "
        f"{platform.machine()} CPU"
    )


def hash_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_held_out(path: Path, plan: TrainingPlan) -> HeldOut:
    """Read the scores of a training by the same recipe, with images held out, from its card.

    Raises: ConfigError: no card, no held-out images, or another recipe.
    """
    try:
        card = msgspec.json.decode(path.read_bytes(), type=ModelCard)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(
            f"--scores-from {path}: not the .json of a model card: {error}; name one "
            "beside its .onnx"
        ) from error
    if not card.test:
        raise ConfigError(f"--scores-from {path}: that training held no images out; use --fold")
    same = msgspec.structs.replace(card.plan, steps=plan.steps, data=plan.data)
    if plan.class_weighting and card.plan.class_weighting:  # each from its own pictures
        same = msgspec.structs.replace(
            same, class_weights=plan.class_weights, class_weighting=plan.class_weighting
        )
    if same != plan or card.plan.data.split()[:1] != plan.data.split()[:1]:
        raise ConfigError(
            f"--scores-from {path}: another recipe ({card.plan}); only steps and fold may differ"
        )
    return HeldOut(
        command=card.command,
        steps=card.plan.steps,
        train_images=card.train_images,
        input_height_px=card.input_height_px,
        input_width_px=card.input_width_px,
        test=card.test,
        calibration=card.calibration,
    )
