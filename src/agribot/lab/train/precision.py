"""Smaller numbers in a network's file: 8 bits (static, calibrated on pictures) or 16-bit floats."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray

CALIBRATION_IMAGES = 32

T = TypeVar("T")


def sample_pictures(pictures: Sequence[T]) -> Sequence[T]:
    """Take as many as the ranges of 8-bit numbers need, from the whole of a list."""
    return pictures[:: max(1, len(pictures) // CALIBRATION_IMAGES)][:CALIBRATION_IMAGES]


def quantise_to_int8(source: Path, target: Path, pictures: Iterable[ByteArray]) -> None:
    """Quantise convolutions and what lies between them; ranges come from the pictures.

    What stands around the network stays as it is: colours in, classes and probabilities out.
    """
    import onnx
    from onnxruntime.quantization import QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.calibrate import CalibrationDataReader
    from onnxruntime.quantization.shape_inference import quant_pre_process

    images = iter(pictures)

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def get_next(self) -> dict[str, ByteArray] | None:
            image_rgb = next(images, None)
            return None if image_rgb is None else {"image_rgb": image_rgb[None]}

    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        quantize_static(
            str(prepared),
            str(target),
            Reader(),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            op_types_to_quantize=["Conv", "Add", "Relu", "Clip"],
            nodes_to_exclude=[
                node.name
                for node in onnx.load(str(prepared)).graph.node
                if not node.name.startswith("/network/")
            ],
        )


def convert_to_fp16(source: Path, target: Path) -> None:
    """Store weights and sums as 16-bit floats: half the file; gains time only on a GPU."""
    import onnx
    from onnxruntime.transformers.float16 import convert_float_to_float16

    model = onnx.load(str(source))
    try:
        half = convert_float_to_float16(model, keep_io_types=True, op_block_list=["Resize"])
    except ValueError as error:
        raise PerceptionError(f"{source}: cannot be made 16-bit ({error})") from error
    onnx.save(half, str(target))
