"""What a drive that teaches or calibrates is refused for."""

from __future__ import annotations

from typing import Literal

from agribot.core.facts.mission import MissionNote

Sampled = Literal["wheels", "imu", "stretches"]


class NoStretch(MissionNote, frozen=True):
    """A recorded drive has no stretch without a turn."""

    path: str
    shortest_m: float


class MarksOdd(MissionNote, frozen=True):
    """A drive has a mark without its second one."""

    marks: int


class RowWithoutLength(MissionNote, frozen=True):
    """Both marks of a row are at one place."""

    row: int


class NoFixesIn(MissionNote, frozen=True):
    """A recording holds no fix."""

    path: str


class NotMoved(MissionNote, frozen=True):
    """The robot did not move on a drive that was to teach."""

    path: str


class FewTurnFixes(MissionNote, frozen=True):
    """There are too few fixes while the robot turned in place."""

    fixes: int
    needed: int


class WheelsStoodIn(MissionNote, frozen=True):
    """The wheels did not turn in a stretch of a drive."""

    stretch: str


class HeadingUnfixed(MissionNote, frozen=True):
    """No leg of a drive gives its heading."""


class DriveUndetermined(MissionNote, frozen=True):
    """A drive does not determine the geometry of the robot."""


class WheelsStoodInTurns(MissionNote, frozen=True):
    """The wheels did not turn in the turns of a drive."""


class LegStood(MissionNote, frozen=True):
    """The wheels turned in a leg and the robot stood."""

    stretch: str
    rolled_rad: float
    length_m: float
    std_m: float


class FewSamples(MissionNote, frozen=True):
    """A drive has too few samples of a sensor."""

    samples: int
    of: Sampled

    @property
    def variant(self) -> str:
        return self.of


class NoRowLine(MissionNote, frozen=True):
    """No picture shows the line of a row."""

    inside: int
    pictures: int


class CameraUnproven(MissionNote, frozen=True):
    """A drive shows nothing of the camera."""

    pictures: int
    poses: int


class NoPlantFollowed(MissionNote, frozen=True):
    """No plant was followed through the pictures."""

    pictures: int


class NoMagnetometer(MissionNote, frozen=True):
    """The magnetometer was silent on the whole drive."""


class NoEllipse(MissionNote, frozen=True):
    """The readings of the magnetometer show no ellipse."""

    readings: int
    sectors: int
