"""The simulated camera: a software renderer with depth, class and plant of every pixel."""

from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.renderer import CameraRenderer, Rendering

__all__ = ["Appearance", "CameraRenderer", "Rendering"]
