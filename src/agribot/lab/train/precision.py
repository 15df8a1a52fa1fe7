"""Smaller numbers in a network's file: 8 bits (static, calibrated on pictures) or 16-bit floats."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray

CALIBRATION_IMAGES = 32
HALF = "_fp16"  # suffix of weights that are stored in 16 bits

T = TypeVar("T")


def sample_pictures(pictures: Sequence[T]) -> Sequence[T]:
    """Take as many as the ranges of 8-bit numbers need, from the whole of a list."""
    return pictures[:: max(1, len(pictures) // CALIBRATION_IMAGES)][:CALIBRATION_IMAGES]


def quantise_to_int8(source: Path, target: Path, pictures: Iterable[ByteArray]) -> None:
    """Quantise convolutions and what lies between them; ranges come from the pictures.

    What stands around the network stays as it is: colours in, classes and probabilities out.

    Raises: PerceptionError: it has 8-bit numbers already.
    """
    import onnx
    from onnxruntime.quantization import QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.calibrate import CalibrationDataReader
    from onnxruntime.quantization.shape_inference import quant_pre_process

    _refuse_eight_bits(onnx.load(str(source)))
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


def store_as_fp16(path: Path) -> None:
    """Store the weights of convolutions as 16-bit floats, from which 32-bit ones are made at load.

    The file has half its size, and the network computes as before: only the weights are rounded.
    """
    import onnx

    model = onnx.load(str(path))
    names = {node.input[1] for node in model.graph.node if node.op_type == "Conv"}
    for value in [one for one in model.graph.initializer if one.name in names]:
        whole, half = value.name, f"{value.name}{HALF}"
        weights = onnx.numpy_helper.to_array(value).astype(np.float16)
        value.CopyFrom(onnx.numpy_helper.from_array(weights, half))
        cast = onnx.helper.make_node("Cast", [half], [whole], to=onnx.TensorProto.FLOAT)
        model.graph.node.insert(0, cast)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def convert_to_fp16(source: Path, target: Path) -> None:
    """Store weights and sums as 16-bit floats: half the file; gains time only on a GPU.

    Raises: PerceptionError: it has 8-bit numbers, or cannot be converted.
    """
    import onnx
    from onnxruntime.transformers.float16 import convert_float_to_float16

    model = onnx.load(str(source))
    _refuse_eight_bits(model)
    try:
        half = convert_float_to_float16(model, keep_io_types=True, op_block_list=["Resize"])
    except ValueError as error:
        raise PerceptionError(f"{source}: cannot be made 16-bit ({error}); try int8") from error
    onnx.save(half, str(target))


def _refuse_eight_bits(model: Any) -> None:
    if any(node.op_type == "QuantizeLinear" for node in model.graph.node):
        raise PerceptionError(
            "the network has 8-bit numbers already, and they cannot be converted; give the file "
            "that it came from, such as NAME-fp32.onnx of agribot train"
        )
