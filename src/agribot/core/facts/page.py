"""What the operator's page is refused for before the robot is asked."""

from __future__ import annotations

from typing import Literal

from agribot.core.facts.mission import MissionNote

Handed = Literal["file", "field", "view"]  # kind of thing that a page hands in


class SeatNeeded(MissionNote, frozen=True):
    """The page does not have the operator's seat."""


class SeatHeld(MissionNote, frozen=True):
    """Another page has the operator's seat."""

    name: str


class ViewerOnly(MissionNote, frozen=True):
    """The page was opened with the token of a viewer."""


class TokenNeeded(MissionNote, frozen=True):
    """The page was opened without a token."""


class TokenWrong(MissionNote, frozen=True):
    """A token is not one of this robot."""


class TokensWrong(MissionNote, frozen=True):
    """Too many wrong tokens came from one address."""


class RecordingShown(MissionNote, frozen=True):
    """The page shows a recording."""


class RobotEnded(MissionNote, frozen=True):
    """The robot's program has ended, and the page is still open."""


class NoRobotShown(MissionNote, frozen=True):
    """The page shows a recording or a description, or no robot runs."""


class TookTooLong(MissionNote, frozen=True):
    """What a page handed in was not read in time."""

    what: Handed
    limit_s: float

    @property
    def variant(self) -> str:
        return self.what


class ReaderEnded(MissionNote, frozen=True):
    """What a page handed in ended the program that read it."""

    what: Handed

    @property
    def variant(self) -> str:
        return self.what
