"""The crop/weed network at run time: an ONNX file, an image in, a class map out."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.stems import CELL_PX, SQUARE_PX, PlantMaps
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray

PIXEL_OUTPUTS = ("class_id", "confidence")
# Outputs for plants, with px per value; both or none.
PLANT_OUTPUTS = {"stem_score": SQUARE_PX, "way_px": CELL_PX}
PLANT_TYPES = ("tensor(uint8)", "tensor(float)")  # types of these outputs
CPU = "CPUExecutionProvider"
# Least confidence: the winner of three classes has at least a third of the probability, 85 of 255;
# less is NaN.
LEAST_CONFIDENCE = 80


def model_names() -> list[str]:
    """Names of the networks that come with the package."""
    folder = resources.files("agribot.autonomy.perceive") / "models"
    if not folder.is_dir():
        return []
    return sorted(
        f.name.removesuffix(".onnx") for f in folder.iterdir() if f.name.endswith(".onnx")
    )


def model_path(model: str | Path) -> Path:
    """Find the file of a packaged network's name, or of a path to an .onnx file.

    Raises: PerceptionError: there is no such file.
    """
    path = Path(model)
    if path.suffix != ".onnx":
        path = Path(str(resources.files("agribot.autonomy.perceive") / "models" / f"{model}.onnx"))
    if not path.is_file():
        known = ", ".join(model_names()) or "none"
        raise PerceptionError(
            f"model weights {path} do not exist; known names: {known}; give one of them or a "
            "path to an .onnx file, or make them: agribot train --data sim --out DIR"
        )
    return path


class _Card(msgspec.Struct, frozen=True):
    """The card beside a network's file."""

    most_doubt: float | None = None


def _read_card(path: Path) -> _Card:
    """Read the card of a network; one without a card, or with an older one, limits no doubt.

    Raises: PerceptionError: it cannot be read.
    """
    card = path.with_suffix(".json")
    if not card.is_file():
        return _Card()
    try:
        return msgspec.json.decode(card.read_bytes(), type=_Card)
    except (OSError, msgspec.DecodeError) as error:
        raise PerceptionError(
            f"{card}: is no card of a network ({error}); copy it again, or move it away"
        ) from error


class Segmenter:
    """Runs a network on the CPU, or on other ONNX Runtime providers where they exist.

    The same image gives the same answer, bit by bit, on one machine and provider. `map_shape` is
    (height, width) of its class maps; `finds_plants` is True if they have stems.
    """

    def __init__(
        self, model: str | Path, threads: int = 1, providers: tuple[str, ...] = (CPU,)
    ) -> None:
        self.path = path = model_path(model)
        self._session = _open_session(path, threads, providers)
        self._most_doubt = _read_card(path).most_doubt
        try:
            (image,) = self._session.get_inputs()
            outputs = {output.name: output for output in self._session.get_outputs()}
            height, width = outputs["class_id"].shape
            fits = image.type == "tensor(uint8)" and outputs["confidence"].shape == [height, width]
        except (ValueError, KeyError) as error:
            raise _misfit(path) from error
        if not fits or not isinstance(height, int) or not isinstance(width, int):
            raise _misfit(path)
        self._input_name = image.name
        self.map_shape = (height, width)
        self.finds_plants = not outputs.keys().isdisjoint(PLANT_OUTPUTS)
        if self.finds_plants and not _has_plant_maps(outputs, self.map_shape):
            raise _misfit(path)
        self._output_names = PIXEL_OUTPUTS + tuple(PLANT_OUTPUTS) * self.finds_plants

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        """Classify an image of (height, width, 3), of any size; a plant has one name."""
        named = name_plants(self.segment_pixels(image_rgb))
        return msgspec.structs.replace(named, most_doubt=self._most_doubt)

    def segment_pixels(self, image_rgb: ByteArray) -> ClassMap:
        """Classify as the network does, each pixel for itself."""
        if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or image_rgb.dtype != np.uint8:
            raise PerceptionError(
                f"image is {image_rgb.shape} {image_rgb.dtype}; give (height, width, 3) uint8"
            )
        feed = {self._input_name: np.ascontiguousarray(image_rgb)[None]}
        class_id, confidence, *maps = self._session.run(self._output_names, feed)
        height, width = self.map_shape
        if confidence.min() < LEAST_CONFIDENCE:
            raise _no_number(self.path)
        return ClassMap(
            class_id=class_id,
            confidence=confidence,
            scale_px=(image_rgb.shape[0] / height, image_rgb.shape[1] / width),
            plants=self._take_plants(*maps) if maps else None,
        )

    def _take_plants(self, stem_score: ByteArray, way_px: npt.NDArray[np.float32]) -> PlantMaps:
        if not np.isfinite(way_px).all():
            raise _no_number(self.path)
        return PlantMaps(stem_score=stem_score, way_px=way_px)


def _has_plant_maps(outputs: Mapping[str, Any], map_shape: tuple[int, int]) -> bool:
    """Whether the outputs of an ONNX session hold both plant maps, of whole cells."""
    height, width = map_shape
    found = [(outputs[name].type, outputs[name].shape) for name in PLANT_OUTPUTS if name in outputs]
    is_whole = height % CELL_PX == 0 and width % CELL_PX == 0
    shapes = [[2, height // px, width // px] for px in PLANT_OUTPUTS.values()]
    return is_whole and found == list(zip(PLANT_TYPES, shapes, strict=True))


def _misfit(path: Path) -> PerceptionError:
    return PerceptionError(
        f"{path} is no crop/weed network: it needs one uint8 image input and the outputs class_id "
        "and confidence of one fixed size (h, w); one that finds plants has also stem_score uint8 "
        f"of (2, h / {SQUARE_PX}, w / {SQUARE_PX}) and way_px float32 of (2, h / {CELL_PX}, "
        f"w / {CELL_PX}); export it with agribot train"
    )


def _no_number(path: Path) -> PerceptionError:
    return PerceptionError(
        f"{path} answers with no number: its weights hold NaN or infinity; train or export it again"
    )


def _open_session(path: Path, threads: int, providers: tuple[str, ...]) -> Any:
    import onnxruntime

    unknown = set(providers) - set(onnxruntime.get_available_providers())
    if unknown:
        available = ", ".join(onnxruntime.get_available_providers())
        raise PerceptionError(
            f"ONNX Runtime has no {', '.join(sorted(unknown))} here; available: {available}"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    # A waiting worker must not burn the core that the control loop needs.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    faults = onnxruntime.capi.onnxruntime_pybind11_state
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=list(providers))
    except (
        faults.InvalidProtobuf,
        faults.InvalidGraph,
        faults.InvalidArgument,
        faults.Fail,
        faults.NotImplemented,
        faults.RuntimeException,
    ) as error:
        reason = str(error).splitlines()[0]
        raise PerceptionError(
            f"{path} is not an ONNX file that runs here ({reason}); copy it again or make it: "
            "agribot train"
        ) from error
