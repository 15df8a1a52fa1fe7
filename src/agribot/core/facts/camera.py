"""The camera, its pictures and the network."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from agribot.core.facts.base import Fact, Part, Severity

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class _OfCamera(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("camera",)
    severity: ClassVar[Severity] = "warning"


class NoPicture(_OfCamera, frozen=True):
    """No picture was seen for some time."""

    silent_s: float


class PicturesComeLate(_OfCamera, frozen=True):
    """Pictures come late to the estimate."""

    late_s: float


class PictureFrozen(_OfCamera, frozen=True):
    """The picture has not changed while the robot moved."""

    way_m: float


class PictureReversed(_OfCamera, frozen=True):
    """The picture moves against the way of the robot."""


class PictureMirrored(_OfCamera, frozen=True):
    """The picture turns against the turns of the robot."""


class TooDark(_OfCamera, frozen=True):
    """A picture is too dark."""


class Overexposed(_OfCamera, frozen=True):
    """A picture is white over this share of it."""

    white_ratio: float


class OneBrightness(_OfCamera, frozen=True):
    """A picture is of one brightness, of 255."""

    level: float


class PictureNoisy(_OfCamera, frozen=True):
    """A picture is noise."""


class OutOfFocus(_OfCamera, frozen=True):
    """A picture is out of focus."""


class PlantsStrange(_OfCamera, frozen=True):
    """The network does not know these plants in this light."""

    doubt: float
    limit: float


class PictureUnfit(_OfCamera, frozen=True):
    """Pictures show nothing to go by; in words of a recording of an earlier version."""

    why: str = ""
    cause: AnyFact | None = None

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code,)

    @property
    def variant(self) -> str:
        return "said" if self.cause is None else "known"


class CropUnknown(_OfCamera, frozen=True):
    """The network sees no crop where the rows are."""

    share_ratio: float
    way_m: float
    row: int


class RowLineMoved(_OfCamera, frozen=True):
    """The row line moved without the robot."""

    severity: ClassVar[Severity] = "fault"
    off_m: float


class RowLinesScatter(_OfCamera, frozen=True):
    """Row lines scatter aside by more than they state."""

    std_m: float
    stated_m: float


class RowHeadingsScatter(_OfCamera, frozen=True):
    """The directions of row lines scatter by more than they state."""

    std_rad: float
    stated_rad: float


class CameraSilent(_OfCamera, frozen=True):
    """The camera sends no picture."""

    silent_s: float
    limit_s: float


class CameraLate(_OfCamera, frozen=True):
    """The camera's pictures are old when they come."""

    late_s: float
    limit_s: float


class NetworkSilent(_OfCamera, frozen=True):
    """The network says nothing of the pictures."""

    about: ClassVar[tuple[Part, ...]] = ("network", "camera")
    silent_s: float
    limit_s: float
