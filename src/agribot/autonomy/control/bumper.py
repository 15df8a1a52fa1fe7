"""What the bumper says: a touch stops the robot, and by hand it only comes away from it."""

from __future__ import annotations

from agribot.core.facts import End, Side, Touched
from agribot.core.messages import STOP, DriveCommand, SensorBatch

# A contact that chatters is one touch: time after its last sample until the robot is free, s.
RELEASE_S = 0.5


class Bumper:
    """Remembers on which side, in front or behind, the robot touches something."""

    def __init__(self) -> None:
        self._touched_s: dict[End, float] = {}
        self._known: set[End] = set()

    @property
    def ends(self) -> tuple[End, ...]:
        """Ends of the robot that touch now."""
        return tuple(self._touched_s)

    def feel(self, batch: SensorBatch) -> Touched | None:
        """Take in the samples of a tick; find a touch that is new."""
        found = None
        for sample in batch.bumper:
            end: End = "behind" if sample.x_body_m < 0.0 else "front"
            if end not in self._known:
                ahead_m, left_m = sample.x_body_m, sample.y_body_m
                side: Side = "left" if left_m >= 0.0 else "right"
                found = Touched(end, abs(ahead_m), abs(left_m), side)
            self._touched_s[end] = batch.t_s
        for touched, touched_s in tuple(self._touched_s.items()):
            if not 0.0 <= batch.t_s - touched_s <= RELEASE_S:
                del self._touched_s[touched]
        self._known &= set(self._touched_s)
        return found

    def accept(self) -> None:
        """Let go of what the robot touches now: a person has seen it."""
        self._known = set(self._touched_s)

    def away(self, drive: DriveCommand) -> DriveCommand:
        """Keep what of a hand's wish leads straight away from all that the robot touches."""
        if not self._touched_s:
            return drive
        is_towards = (drive.v_mps > 0.0 and "front" in self._touched_s) or (
            drive.v_mps < 0.0 and "behind" in self._touched_s
        )
        return STOP if is_towards else DriveCommand(v_mps=drive.v_mps)
