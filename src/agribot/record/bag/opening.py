"""Open a recording of any kind; what cannot be opened is refused with the reason."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import zstandard

from agribot.core.errors import CHECK_PATH, RecordingError, add_advice, explain_os_error
from agribot.core.sqlite_file import MAGIC as SQLITE_MAGIC
from agribot.record.bag.folder_bag import FolderBag
from agribot.record.bag.mcap_bag import McapBag
from agribot.record.bag.ros1_bag import Ros1Bag
from agribot.record.bag.source import Bag
from agribot.record.bag.sqlite_bag import SqliteBag
from agribot.record.damage import Damage, warn_of
from agribot.record.mcap_parsing import MAGIC

_ROS1_MAGIC = b"#ROSBAG V2.0\n"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # RFC 8878, section 3.1.1
_PARTS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")  # suffixes of files in a rosbag2 folder


@contextlib.contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a ROS 1 `.bag`, a ROS 2 `.db3` or rosbag2 folder, or an MCAP file.

    A file that was compressed as a whole is unpacked into a temporary folder. Warns of damage
    (`DamagedRecording`), behind which the bag goes on.
    Raises: RecordingError: no such file, empty, of another kind, or damaged beyond reading.
    """
    with contextlib.ExitStack() as unpacked:
        bag = _open(path, unpacked)
        warn_of(bag.damage)
        try:
            yield bag
        finally:
            bag.close()


def check_target(source: Path, target: Path, what: str) -> None:
    """Refuse to write over the recording that is read, or a file of its folder.

    Raises: RecordingError: the target is part of it; `what` would replace it.
    """
    if target.exists() and target.resolve().is_relative_to(source.resolve()):
        raise RecordingError(
            f"{target} is the recording itself, which the {what} would replace; choose another name"
        )


def _open(path: Path, unpacked: contextlib.ExitStack) -> Bag:
    if path.is_dir():
        return _open_folder(path, unpacked)
    start = _read_start(path)
    if not start:
        raise RecordingError(f"{path} is empty (0 bytes); there is nothing to read")
    if start.startswith(MAGIC):
        return McapBag(path)
    if start.startswith(_ROS1_MAGIC):
        return Ros1Bag(path)
    if start.startswith(SQLITE_MAGIC):
        return SqliteBag(path)
    if start.startswith(_ZSTD_MAGIC):
        return _open_packed(path, unpacked)
    if start.startswith(b"#ROSBAG V"):
        version = start.split(b"\n")[0][9:].decode("ascii", "replace")
        raise RecordingError(f"{path} is a ROS 1 bag of version {version}; only 2.0 is read")
    raise RecordingError(
        f"{path} is no recording: it begins with {start[:8]!r}, not like a ROS 1 bag, a rosbag2 "
        "database or an MCAP file; name another file"
    )


def _open_packed(path: Path, unpacked: contextlib.ExitStack) -> Bag:
    inner, damage = _unpack(path, unpacked)
    try:
        bag = _open(inner, unpacked)
    except RecordingError as error:
        why = str(error).replace(str(inner), inner.name)
        fact = f"{path} was unpacked, but {why}"
        raise RecordingError(add_advice(fact, "take another copy of it")) from error
    bag.kind = f"{bag.kind} in a zstd file"
    bag.damage = (*damage, *bag.damage)
    return bag


def _unpack(path: Path, unpacked: contextlib.ExitStack) -> tuple[Path, tuple[Damage, ...]]:
    """Unpack a file that was compressed as a whole, up to where it is damaged or was cut off.

    Raises: RecordingError: nothing of it is sound, or there is no room.
    """
    damage: tuple[Damage, ...] = ()
    try:
        folder = tempfile.TemporaryDirectory(prefix="agribot-bag-")
        inner = Path(unpacked.enter_context(folder)) / path.name.removesuffix(".zstd")
        with path.open("rb") as packed, inner.open("wb") as file:
            zstandard.ZstdDecompressor().copy_stream(packed, file)
    except zstandard.ZstdError as error:
        if not inner.stat().st_size:
            raise RecordingError(f"{path} is no sound zstd file: {error}; copy it anew") from error
        what = f"{path.name}: its compressed data is damaged behind the first "
        damage = (Damage(what=f"{what}{inner.stat().st_size} bytes that it holds"),)
    except OSError as error:
        raise RecordingError(
            f"cannot unpack {path} into {tempfile.gettempdir()}: {error.strerror or error}; "
            "set TMPDIR to a folder with room"
        ) from error
    return inner, damage


def _open_folder(path: Path, unpacked: contextlib.ExitStack) -> Bag:
    if not any(path.iterdir()):
        raise RecordingError(f"{path} is an empty folder; give a rosbag2 folder or a file")
    files = sorted(file for file in path.iterdir() if file.name.endswith(_PARTS))
    if not files:
        raise RecordingError(
            f"{path} is no rosbag2 folder: it holds neither metadata.yaml nor .mcap or .db3 "
            "files; name another folder"
        )
    parts, refused = list[Bag](), list[RecordingError]()
    for file in files:
        try:
            parts.append(_open(file, unpacked))
        except RecordingError as error:
            refused.append(error)
    if not parts:
        raise refused[0]
    # The order is by time: the tenth file of a recorder comes before the second by name.
    parts.sort(key=lambda part: part.times_ns or (0, 0))
    return FolderBag(path, parts, [Damage(what=str(error)) for error in refused])


def _read_start(path: Path) -> bytes:
    with explain_os_error(f"cannot read {path}", CHECK_PATH), path.open("rb") as file:
        return file.read(16)
