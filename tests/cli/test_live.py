from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from agribot.cli.data import live
from agribot.cli.data.newest_frame import NewestFrame
from agribot.cli.main import main
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray

WAIT_S = 20.0  # for another thread; a test that reaches it fails


class Camera:
    """Gives numbered frames; each one only after the test lets it."""

    name = "test camera"

    def __init__(self, frames: int, ends: bool = True, is_file: bool = False) -> None:
        self.ends, self.is_file = ends, is_file
        self.closed = False
        self.given = 0
        self.last_asked = threading.Event()
        self._frames = frames

    def read(self) -> ByteArray | None:
        if self.given == self._frames:
            self.last_asked.set()
            return None
        self.given += 1
        return np.full((48, 64, 3), self.given, np.uint8)

    def explain_silence(self) -> str:
        return "check the camera and its cable"

    def stop(self) -> None: ...

    def close(self) -> None:
        self.closed = True


class HangingCamera(Camera):
    def read(self) -> ByteArray | None:
        if self.given == 1:
            threading.Event().wait(0.6)
            return None
        return super().read()


class Blind:
    """A network that calls everything soil."""

    def segment(self, image_rgb: ByteArray) -> SimpleNamespace:
        return SimpleNamespace(class_id=np.full(image_rgb.shape[:2], 2, np.uint8))


def test_a_slow_reader_gets_the_newest_frame_and_the_others_are_counted() -> None:
    camera = Camera(frames=9)
    newest = NewestFrame(camera)
    seen = []
    for frame in newest:
        seen.append(int(frame.image_rgb[0, 0, 0]))
        assert camera.last_asked.wait(WAIT_S)  # the camera goes on while this frame is worked on
    assert seen[-1] == 9
    assert seen == sorted(seen)
    assert newest.captured == 9
    assert newest.dropped == 9 - len(seen) >= 7
    assert camera.closed


def test_a_video_ends_and_a_camera_that_stops_is_a_fault() -> None:
    assert list(NewestFrame(Camera(frames=0))) == []
    with pytest.raises(PerceptionError, match=r"test camera: stopped after [12] frames"):
        list(NewestFrame(Camera(frames=2, ends=False)))


def test_a_camera_that_hangs_is_given_up() -> None:
    with pytest.raises(PerceptionError, match=r"no frame for 0\.1 s after 1 frames"):
        list(NewestFrame(HangingCamera(frames=5), patience_s=0.1))


def test_a_camera_that_hangs_does_not_hold_up_who_interrupts() -> None:
    asked: list[int] = []

    def is_stopped() -> bool:
        asked.append(1)
        return len(asked) > 1

    frames = NewestFrame(HangingCamera(frames=5), patience_s=WAIT_S, is_stopped=is_stopped)
    assert len(list(frames)) <= 1


def test_live_shows_frames_and_latency_and_keeps_the_newest_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live, "open_source", lambda name, seed: Camera(frames=4))
    assert main(["live", "sim", "--out", str(tmp_path), "--json"]) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert 1 <= result["frames"] <= 4
    assert result["captured"] == 4
    assert result["frames"] + result["dropped"] == 4
    assert result["latency_median_s"] > 0.0
    assert "fps  latency" in printed.err
    assert (tmp_path / "latest.jpg").stat().st_size > 500


@pytest.mark.parametrize(("every", "seen"), [((), 5), (("--every", "2"), 3), (("--every", "9"), 1)])
def test_a_file_is_looked_at_frame_by_frame_however_slow_the_network_is(
    every: tuple[str, ...],
    seen: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = Camera(frames=5, is_file=True)
    monkeypatch.setattr(live, "open_source", lambda name, seed: file)
    monkeypatch.setattr("agribot.lab.train.networks.open_network", lambda *_: Blind())
    assert main(["live", "rows.mp4", *every, "--json"]) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert (result["frames"], result["captured"], result["dropped"]) == (seen, 5, 0)
    assert f"{seen} of 5 frames seen\n" in printed.err
    assert file.closed


def test_every_nth_frame_of_a_camera_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = Camera(frames=5)
    monkeypatch.setattr(live, "open_source", lambda name, seed: camera)
    monkeypatch.setattr("agribot.lab.train.networks.open_network", lambda *_: Blind())
    assert main(["live", "0", "--every", "3"]) == 2
    assert "--every is for files; test camera is always looked at" in capsys.readouterr().err
    assert (camera.given, camera.closed) == (0, True)


def test_live_ends_with_one_where_the_camera_stops(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live, "open_source", lambda name, seed: Camera(frames=1, ends=False))
    assert main(["live", "0", "--json"]) == 1
    printed = capsys.readouterr()
    assert "stopped after 1 frames" in json.loads(printed.out)["fault"]
    assert "test camera" in printed.err


def test_the_simulated_drive_shows_plants(capsys: pytest.CaptureFixture[str]) -> None:
    from agribot.cli.data.live_sources import SimulatedDrive

    drive = SimulatedDrive(seed=1)
    first, second = drive.read(), drive.read()
    assert first.shape == (480, 640, 3)
    assert (first != second).mean() > 0.2
    green = (first[..., 1] > first[..., 0].astype(int) + 20).mean()
    assert green > 0.003


class Picture:
    """A message of 3 x 2 pixels; the first is blue."""

    encoding, height, width, step, is_bigendian = "bgr8", 2, 3, 9, 0
    data = np.array([255, 0, 0] + [0] * 15, np.uint8)

    header = SimpleNamespace(stamp=SimpleNamespace(sec=5, nanosec=0))


class Network:
    """A ROS on which one picture comes at once; the topics that are asked for."""

    asked: ClassVar[list[str]] = []
    closed: ClassVar[list[str]] = []

    def __init__(self, name: str, *_: object, **__: object) -> None:
        self.name = name

    def subscribe_any(self, name: str, on_message: Callable[[str, bytes], None]) -> None:
        self.asked.append(name)
        on_message("sensor_msgs/msg/Image", b"")

    def decode(self, ros_type: str, data: bytes) -> Picture:
        return Picture()

    def close(self) -> None:
        self.closed.append(self.name)


@pytest.mark.parametrize("uri", ["ros1:/usb_cam/image_raw", "ros1://robot:11311/usb_cam/image_raw"])
def test_the_pictures_of_a_topic_are_seen_whatever_their_size(
    monkeypatch: pytest.MonkeyPatch, uri: str
) -> None:
    monkeypatch.setattr("agribot.ros.ros1.connection.Ros1Connection", Network)
    monkeypatch.setattr(Network, "asked", [])
    monkeypatch.setattr(Network, "closed", [])
    seen = []
    for frame in NewestFrame(live.open_source(uri, 0), patience_s=WAIT_S):
        seen.append(frame.image_rgb)
        break
    assert seen[0].shape == (2, 3, 3) and seen[0][0, 0].tolist() == [0, 0, 255]
    assert Network.asked == ["/usb_cam/image_raw"]
    assert Network.closed == ["agribot_sensors"]


def test_a_topic_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["live", "/usb_cam/image_raw"]) == 2
    assert "of a topic write ros1:/usb_cam/image_raw or ros2:/usb" in capsys.readouterr().err
    assert main(["live", "ros1:"]) == 2
    assert "ros1: names no topic; write ros1:/image_raw or ros2://HOST:PORT/image_raw" in (
        capsys.readouterr().err
    )
