"""What a drive beside the work is for."""

from __future__ import annotations

from enum import StrEnum


class ErrandKind(StrEnum):
    """Its kind decides what the mission does on the way and at its end; who asked is data only."""

    HOME = "home"  # a person or a program asked for it
    CHARGE = "charge"  # home, because the battery is low
    GOAL = "goal"
    WORK = "work"  # back to where the work stopped
    BACK = "back"  # back from a lost row, to where the row was still certain
    OUT = "out"  # all of the way out of a lost row
    FREE = "free"  # out of a place where the robot is stuck

    @property
    def leg(self) -> str:
        return _LEGS[self]

    @property
    def refusal(self) -> str:
        return _REFUSALS.get(self, "cannot back out")

    @property
    def leads_home(self) -> bool:
        return self in (ErrandKind.HOME, ErrandKind.CHARGE)

    @property
    def leaves_row(self) -> bool:
        """Whether the robot backs out because it lost its row."""
        return self in (ErrandKind.BACK, ErrandKind.OUT)

    @property
    def is_along_own_track(self) -> bool:
        """Whether the robot goes back slowly along the way on which it came."""
        return self.leaves_row or self is ErrandKind.FREE


_LEGS = {
    ErrandKind.HOME: "way home",
    ErrandKind.CHARGE: "way home",
    ErrandKind.GOAL: "to the goal",
    ErrandKind.WORK: "back to the work",
    ErrandKind.BACK: "backs out to find its row",
    ErrandKind.OUT: "backs out of its row",
    ErrandKind.FREE: "backs out to try again",
}
_REFUSALS = {
    ErrandKind.HOME: "cannot return home",
    ErrandKind.CHARGE: "cannot return home",
    ErrandKind.GOAL: "goal refused",
    ErrandKind.WORK: "cannot go back to work",
}
