"""How fast wheels may turn that have lost their power: nothing brakes them, so they roll out."""

from __future__ import annotations

from agribot.core.messages import Four

REGAIN_S = 0.5  # time in which motors that get their power back have braked their wheels
STANDING: Four = (0.0, 0.0, 0.0, 0.0)


class RollOut:
    """One call of `follow` a sample of the encoders; `speeds_radps` is what each wheel may turn."""

    def __init__(self) -> None:
        self.speeds_radps = STANDING
        self._had_power, self._regained_s = True, 0.0

    def follow(
        self, speeds_radps: Four, wrong_s: list[float], elapsed_s: float, *, has_power: bool
    ) -> None:
        """Take a sample; wheels that turned wrong for `wrong_s` before they lost it stay wrong."""
        self._regained_s = self._regained_s + elapsed_s if has_power else 0.0
        if has_power and self._regained_s > REGAIN_S:
            self.speeds_radps = STANDING
        elif self._had_power and not has_power:
            rolling = (
                0.0 if off_s > 0.0 else speed
                for speed, off_s in zip(speeds_radps, wrong_s, strict=True)
            )
            rear_right, rear_left, front_right, front_left = rolling
            self.speeds_radps = rear_right, rear_left, front_right, front_left
        self._had_power = has_power
