"""Pictures that show nothing to go by: too dark, out of focus, or of unknown plants."""

from __future__ import annotations

from agribot.core.facts import PictureUnfit
from agribot.core.messages import Scene

PICTURES = 3  # one after the other, before it counts, and before it is over


class FitnessWatch:
    """Call `hear` with every scene; `fault` then names why the tool must not work by them."""

    def __init__(self) -> None:
        self._unfit = self._fit = 0
        self.fault: PictureUnfit | None = None

    def hear(self, scene: Scene) -> None:
        self._unfit = self._unfit + 1 if scene.unfit else 0
        self._fit = 0 if scene.unfit else self._fit + 1
        if self._unfit >= PICTURES:
            cause = scene.unfit_fact
            self.fault = PictureUnfit(cause=cause) if cause else PictureUnfit(scene.unfit)
        elif self._fit >= PICTURES:
            self.fault = None
