"""The camera's pictures of a recording: as they were taken, and with the plants that were found."""

from __future__ import annotations

import bisect
from pathlib import Path

import msgspec

from agribot.core import topics
from agribot.core.topics import Topic
from agribot.record.mcap_file import read_messages
from agribot.ros.messages.rosmsg import read_compressed_image

MAX_BYTES = 64_000_000  # some half an hour at one picture per second; more is thinned out


class EncodedPicture(msgspec.Struct, frozen=True, kw_only=True):
    """`found` is the same picture with circles around the plants; empty where none was drawn."""

    t_s: float
    image: bytes
    found: bytes = b""


class Pictures:
    """JPEG files by the time at which they were taken."""

    def __init__(self, shots: list[EncodedPicture]) -> None:
        self._shots = shots
        self._times = [shot.t_s for shot in shots]

    @classmethod
    def load(cls, path: Path) -> Pictures:
        """Those of a recording; none where it has none. Raises: RecordingError: no recording."""
        images = _jpegs(path, topics.IMAGE)
        found = _jpegs(path, topics.OVERLAY)
        shots = [
            EncodedPicture(t_s=t_s, image=image, found=found.get(t_s, b""))
            for t_s, image in images.items()
        ]
        return cls(sorted(shots, key=lambda shot: shot.t_s))

    def at(self, t_s: float) -> tuple[int, EncodedPicture] | None:
        """Find the newest one of a time, and its number; None before the first."""
        number = bisect.bisect_right(self._times, t_s) - 1
        return (number, self._shots[number]) if number >= 0 else None


def _jpegs(path: Path, topic: Topic) -> dict[float, bytes]:
    """Pictures by time. Above MAX_BYTES every second one goes, and of those to come as well."""
    kept: dict[float, bytes] = {}
    size, every = 0, 1
    for number, message in enumerate(read_messages(path, topic)):
        if number % every:
            continue
        data = read_compressed_image(message.data)
        kept[message.publish_time * 1e-9] = data
        size += len(data)
        if size > MAX_BYTES:
            kept, every = dict(list(kept.items())[::2]), every * 2
            size = sum(map(len, kept.values()))
    return kept
