"""What the bumper says: a touch stops the robot, and by hand it only comes away from it."""

from __future__ import annotations

from agribot.core.messages import STOP, DriveCommand, SensorBatch

# A touch that chatters is one touch; so long after its last sample the robot is free.
RELEASE_S = 0.5


class Bumper:
    """Remembers on which side, in front or behind, the robot touches something."""

    def __init__(self) -> None:
        self._touched_s: dict[str, float] = {}
        self._known: set[str] = set()

    @property
    def sides(self) -> tuple[str, ...]:
        """Where it touches now: "in front", "behind"."""
        return tuple(self._touched_s)

    def feel(self, batch: SensorBatch) -> str:
        """Take in the samples of a tick; where a touch is new, what it is in words."""
        found = ""
        for sample in batch.bumper:
            side = "behind" if sample.x_body_m < 0.0 else "in front"
            if side not in self._known:
                found = (
                    f"the bumper touches something {side}, {abs(sample.x_body_m):.2f} m from the "
                    f"robot's middle and {abs(sample.y_body_m):.2f} m to the "
                    f"{'left' if sample.y_body_m >= 0.0 else 'right'}"
                )
            self._touched_s[side] = batch.t_s
        for side, touched_s in tuple(self._touched_s.items()):
            if not 0.0 <= batch.t_s - touched_s <= RELEASE_S:
                del self._touched_s[side]
        self._known &= set(self._touched_s)
        return found

    def accept(self) -> None:
        """Let go of what the robot touches now: a person has seen it."""
        self._known = set(self._touched_s)

    def away(self, drive: DriveCommand) -> DriveCommand:
        """Keep what of a hand's wish leads straight away from all that the robot touches."""
        if not self._touched_s:
            return drive
        is_towards = (drive.v_mps > 0.0 and "in front" in self._touched_s) or (
            drive.v_mps < 0.0 and "behind" in self._touched_s
        )
        return STOP if is_towards else DriveCommand(v_mps=drive.v_mps)
