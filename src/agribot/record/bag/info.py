"""What a recording holds: topics, counts, rates and times."""

from __future__ import annotations

from pathlib import Path

import msgspec

from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import Bag
from agribot.record.damage import collect_damage


class TopicInfo(msgspec.Struct, frozen=True, kw_only=True):
    """`rate_hz` is the mean over the whole recording; `known` whether messages can be read."""

    name: str
    type: str
    encoding: str
    count: int
    rate_hz: float | None
    latched: bool
    known: bool


class BagInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Times are those of the recorder's clock, seconds; null for a recording without messages.

    `damage` is in words; `has_gaps`: messages or files of the middle are missing.
    """

    path: str
    kind: str
    compression: str
    size_bytes: int
    start_s: float | None
    end_s: float | None
    duration_s: float
    messages: int
    topics: tuple[TopicInfo, ...]
    files: tuple[str, ...]
    notes: tuple[str, ...]
    damage: tuple[str, ...]
    has_gaps: bool


def read_info(path: Path) -> BagInfo:
    """Summarise a recording, with its damage instead of a warning.

    Raises: RecordingError: it cannot be read.
    """
    with collect_damage(), open_bag(path) as bag:
        start_s, end_s = (t * 1e-9 for t in bag.times_ns) if bag.times_ns else (None, None)
        duration_s = end_s - start_s if start_s is not None and end_s is not None else 0.0
        topics = tuple(sorted(_topics(bag, duration_s), key=lambda topic: topic.name))
        return BagInfo(
            path=str(path),
            kind=bag.kind,
            compression=bag.compression,
            size_bytes=_size_bytes(path),
            start_s=start_s,
            end_s=end_s,
            duration_s=duration_s,
            messages=bag.count,
            topics=topics,
            files=bag.file_names,
            notes=tuple(bag.notes),
            damage=tuple(damage.describe() for damage in bag.damage),
            has_gaps=any(damage.is_gap for damage in bag.damage),
        )


def format_info(info: BagInfo) -> str:
    kind = f"{info.kind}, {info.compression} compression" if info.compression else info.kind
    lines = [
        f"{info.path}: {kind}, {info.size_bytes / 1e6:.2f} MB",
        f"{info.messages} messages in {info.duration_s:.2f} s",
        "",
    ]
    width = max((len(topic.name) for topic in info.topics), default=0)
    for topic in info.topics:
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:8.2f} Hz"
        words = [topic.type or topic.encoding]
        words += ["latched"] if topic.latched else []
        words += [] if topic.known or topic.encoding not in ("cdr", "ros1") else ["unknown type"]
        lines.append(
            f"  {topic.name:{width}} {topic.count:8d} {rate:11}  {', '.join(words)}".rstrip()
        )
    if info.files:
        lines += ["", f"files inside: {', '.join(info.files)}"]
    lines += [f"note: {note}" for note in (*info.damage, *info.notes)]
    return "\n".join(lines) + "\n"


def _topics(bag: Bag, duration_s: float) -> list[TopicInfo]:
    return [
        TopicInfo(
            name=topic.name,
            type=topic.ros_type or topic.schema_name,
            encoding=topic.encoding,
            count=topic.count,
            rate_hz=(topic.count - 1) / duration_s if topic.count > 1 and duration_s > 0 else None,
            latched=topic.is_latched,
            known=bag.knows(topic),
        )
        for topic in bag.topics
    ]


def _size_bytes(path: Path) -> int:
    if path.is_dir():
        return sum(file.stat().st_size for file in path.iterdir() if file.is_file())
    return path.stat().st_size
