"""Resize a network's input: it is convolutional, only its graph names a size."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agribot.autonomy.perceive.segmenter import PLANT_OUTPUTS
from agribot.core.errors import PerceptionError

if TYPE_CHECKING:
    import onnx


def resize_network(path: Path, height_px: int, width_px: int) -> bytes:
    """Return the file with its first resize and its outputs at (height_px, width_px).

    Raises: PerceptionError: the file is no graph of ours.
    """
    import onnx

    model = onnx.load(str(path))
    resize = next((node for node in model.graph.node if node.op_type == "Resize"), None)
    if resize is None or len(resize.input) < 4 or not resize.input[3]:
        raise PerceptionError(f"{path} resizes no input; only networks of agribot train do")
    sizes = np.array([1, 3, height_px, width_px], dtype=np.int64)
    constant = onnx.helper.make_node(
        "Constant",
        [],
        ["input_size"],
        value=onnx.numpy_helper.from_array(sizes, "input_size"),
    )
    resize.input[3] = "input_size"
    model.graph.node.insert(0, constant)
    name_output_sizes(model, height_px, width_px)
    del model.graph.value_info[:]
    data: bytes = model.SerializeToString()
    return data


def name_output_sizes(model: onnx.ModelProto, height_px: int, width_px: int) -> None:
    """Write the sizes of all outputs of a network whose input is resized to these."""
    for output in model.graph.output:
        *_, rows, columns = output.type.tensor_type.shape.dim
        step_px = PLANT_OUTPUTS.get(output.name, 1)
        rows.dim_value, columns.dim_value = height_px // step_px, width_px // step_px
