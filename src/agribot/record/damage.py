"""Damage of a recording: what cannot be read, and from when to when messages are missing.

Every reader goes on behind it. `open_bag` and `read_records` give a `DamagedRecording` warning for
each stretch; the program prints it as a note and ends with status 1.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import msgspec


class Damage(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch of a recording that cannot be read.

    Messages may be missing between `after_ns` and `before_ns`, log times of the recorder; None
    where the recording has no sound message on that side. `begin_ns` is the log time at which the
    recording begins. `lost_messages` is None where nothing in the file states how many there were.
    `is_end`: nothing sound follows, as where a recorder lost power. `what` is the damage in words.
    """

    what: str
    begin_ns: int | None = None
    after_ns: int | None = None
    before_ns: int | None = None
    lost_messages: int | None = None
    lost_bytes: int = 0
    lost_files: tuple[str, ...] = ()
    is_end: bool = False

    @property
    def is_loss(self) -> bool:
        """Whether anything recorded may be missing, not only an index."""
        return self.lost_messages != 0 or bool(self.lost_files)

    @property
    def is_gap(self) -> bool:
        """Whether anything of the middle may be missing."""
        return self.is_loss and not self.is_end

    def describe(self) -> str:
        """Describe the damage in one line; times are seconds since the recording began."""
        files = f"; lost files: {', '.join(self.lost_files)}" if self.lost_files else ""
        return f"{self.what}; {self._describe_messages()}{files}"

    def _describe_messages(self) -> str:
        if self.lost_messages == 0:
            return "no message is missing"
        some = "messages" if self.lost_messages is None else f"{self.lost_messages} messages"
        verb = "may be" if self.lost_messages is None else "are"
        return f"{some} {self._describe_times()}{verb} missing"

    def _describe_times(self) -> str:
        begin_ns = self.begin_ns or 0
        after_s, before_s = (
            None if t_ns is None else f"{(t_ns - begin_ns) * 1e-9:.2f}"
            for t_ns in (self.after_ns, self.before_ns)
        )
        if after_s is not None and before_s is not None:
            return f"from {after_s} to {before_s} s "
        if after_s is not None:
            return f"after {after_s} s "
        return "" if before_s is None else f"before {before_s} s "


class DamagedRecording(UserWarning):
    """A recording was read that is not whole."""

    def __init__(self, damage: Damage) -> None:
        super().__init__(damage.describe())
        self.damage = damage


def warn_of(damages: Iterable[Damage]) -> None:
    for damage in damages:
        warnings.warn(DamagedRecording(damage), stacklevel=2)


@contextmanager
def collect_damage(on_damage: Callable[[Damage], None] | None = None) -> Iterator[list[Damage]]:
    """Collect the damage of all recordings that are read meanwhile, each stretch once."""
    found: list[Damage] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always", DamagedRecording)
        show = warnings.showwarning

        def collect(message: Warning | str, *where: object, **more: object) -> None:
            if not isinstance(message, DamagedRecording):
                show(message, *where, **more)  # type: ignore[arg-type]
            elif message.damage not in found:
                found.append(message.damage)
                if on_damage is not None:
                    on_damage(message.damage)

        warnings.showwarning = collect
        yield found
