"""A trained network as one ONNX file: bytes of an image in, classes, confidence, plants out.

Resize, normalisation, softmax and argmax are part of the graph, so that every program that
runs the file gets the same answer.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import msgspec
import torch
from torch import Tensor, nn
from torch.nn import functional

from agribot.autonomy.perceive.segmenter import PIXEL_OUTPUTS, PLANT_OUTPUTS
from agribot.core.messages import PlantClass
from agribot.lab.train.calibration import AS_TRAINED, Temperatures
from agribot.lab.train.evaluate import CLASS_NAMES
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.plant_network import PlantNet
from agribot.lab.train.plant_targets import WAY, WAY_UNIT_PX, join_heat
from agribot.lab.train.precision import store_as_fp16
from agribot.lab.train.resizing import name_output_sizes

# Size of the network, not of the camera: the graph resizes every picture.
INPUT_HEIGHT_PX, INPUT_WIDTH_PX = 480, 640
OPSET = 18
# Key of weed's, crop's and soil's temperatures in the metadata of a file.
TEMPERATURES = "temperatures"

Features = Callable[[Tensor], Tensor]


class DeployedNet(nn.Module):
    """(1, H, W, 3) uint8 to class (h, w) uint8 and confidence (h, w) uint8, 255 = certain.

    `temperatures` divide the logits of the confidence; see `agribot.lab.train.calibration`.
    """

    def __init__(
        self,
        network: nn.Module,
        height_px: int,
        width_px: int,
        features: Features = centred_rgb,
        temperatures: Temperatures = AS_TRAINED,
    ) -> None:
        super().__init__()
        self.network = network
        self.features = features
        self.size_px = (height_px, width_px)
        self.temperatures = temperatures

    def resize(self, image_rgb: Tensor) -> Tensor:
        """(1, H, W, 3) uint8 to the input of the network."""
        x = image_rgb.permute(0, 3, 1, 2).to(torch.float32)
        x = functional.interpolate(x, size=self.size_px, mode="bilinear", align_corners=False)
        return self.features(x)

    def logits(self, image_rgb: Tensor) -> Tensor:
        """(1, H, W, 3) uint8 to (1, 3, h, w)."""
        return self.enlarge(self.network(self.resize(image_rgb)))

    def enlarge(self, logits: Tensor) -> Tensor:
        """Logits of the network to (1, 3, h, w)."""
        if logits.shape[-1] != self.size_px[1]:
            logits = functional.interpolate(
                logits, scale_factor=2.0, mode="bilinear", align_corners=False
            )
        return logits

    def forward(self, image_rgb: Tensor) -> tuple[Tensor, ...]:
        return self.classify(self.logits(image_rgb))

    def classify(self, logits: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (1, 3, h, w) to class and confidence, (h, w) uint8."""
        # Class by class: the operators that reduce over three channels cost 1 ms more in all.
        weed, crop, soil = torch.split(logits[0], 1)
        plant = torch.maximum(weed, crop)
        best = torch.maximum(plant, soil)
        is_soil, is_crop = soil > plant, crop > weed
        divisor = self._choose_divisor(is_soil, is_crop)
        shares = [((logit - best) / divisor).exp() for logit in (weed, crop, soil)]
        confidence = 255.0 / (shares[0] + shares[1] + shares[2])
        plant_id = is_crop.to(torch.uint8) * int(PlantClass.CROP)  # else 0, a weed
        class_id = plant_id.masked_fill(is_soil, int(PlantClass.SOIL))
        return class_id[0], confidence[0].round().to(torch.uint8)

    def _choose_divisor(self, is_soil: Tensor, is_crop: Tensor) -> Tensor | float:
        """Choose the temperature of each pixel; a number, which costs nothing, where it can be."""
        weed, crop, soil = msgspec.structs.astuple(self.temperatures)
        if weed == crop == soil:
            return float(soil)
        return torch.where(is_soil, soil, torch.where(is_crop, crop, weed))


class DeployedPlantNet(DeployedNet):
    """As `DeployedNet`, of a network that finds plants, with two more outputs.

    Stem scores of weeds and crops (2, h / SQUARE_PX, w / SQUARE_PX) uint8, 255 = certain, and the
    way from each cell to the stem of its plant (2, h / CELL_PX, w / CELL_PX) float32, right and
    down, px.
    """

    def forward(self, image_rgb: Tensor) -> tuple[Tensor, ...]:
        logits, maps = self.network(self.resize(image_rgb))
        score = (255.0 * join_heat(maps)[0].sigmoid()).round().to(torch.uint8)
        return (*self.classify(self.enlarge(logits)), score, maps[0, WAY] * WAY_UNIT_PX)

    def logits(self, image_rgb: Tensor) -> Tensor:
        return self.enlarge(self.network(self.resize(image_rgb))[0])


def make_deployed(
    network: nn.Module,
    height_px: int,
    width_px: int,
    features: Features = centred_rgb,
    temperatures: Temperatures = AS_TRAINED,
) -> DeployedNet:
    """Make the graph that is deployed of a network, with stems if it finds them."""
    kind = DeployedPlantNet if isinstance(network, PlantNet) else DeployedNet
    return kind(network, height_px, width_px, features, temperatures)


def export_onnx(
    network: nn.Module,
    path: Path,
    height_px: int = INPUT_HEIGHT_PX,
    width_px: int = INPUT_WIDTH_PX,
    antialias: bool = False,
    features: Features = centred_rgb,
    temperatures: Temperatures = AS_TRAINED,
) -> None:
    """Write the deployable graph; batch norms are folded into the convolutions by the exporter.

    The weights of a network that finds plants are stored in 16 bits.
    `antialias` widens the filter of the input's resize with its reduction: for photographs that
    are much larger than the network's input.
    """
    finds_plants = isinstance(network, PlantNet)
    deployed = make_deployed(network, height_px, width_px, features, temperatures).eval()
    outputs = PIXEL_OUTPUTS + tuple(PLANT_OUTPUTS) * finds_plants
    example = torch.zeros((1, 480, 640, 3), dtype=torch.uint8)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # the TorchScript exporter is deprecated but dependency-free
        torch.onnx.export(
            deployed,
            (example,),
            str(path),
            opset_version=OPSET,
            input_names=["image_rgb"],
            output_names=list(outputs),
            dynamic_axes={"image_rgb": {1: "height_px", 2: "width_px"}},
            dynamo=False,
        )
    _describe(path, (height_px, width_px), antialias, temperatures)
    if finds_plants:  # the largest file of the package
        store_as_fp16(path)


def _describe(
    path: Path, size_px: tuple[int, int], antialias: bool, temperatures: Temperatures
) -> None:
    """Write the output size, which the exporter leaves open, the classes and the temperatures."""
    import onnx

    model = onnx.load(str(path))
    name_output_sizes(model, *size_px)
    if antialias:  # the exporter knows the operator but not this attribute of it
        resize = next(node for node in model.graph.node if node.op_type == "Resize")
        resize.attribute.append(onnx.helper.make_attribute("antialias", 1))
    about = {
        "classes": ",".join(CLASS_NAMES),
        TEMPERATURES: ",".join(f"{value:g}" for value in msgspec.structs.astuple(temperatures)),
    }
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def read_temperatures(path: Path) -> Temperatures:
    """Read by what a file divides the logits of its confidence; 1 where it does not say."""
    import onnx

    about = {entry.key: entry.value for entry in onnx.load(str(path)).metadata_props}
    one = about.get("temperature", "1")  # for all three, in a file of before
    weed, crop, soil = map(float, about.get(TEMPERATURES, f"{one},{one},{one}").split(","))
    return Temperatures(weed=weed, crop=crop, soil=soil)
