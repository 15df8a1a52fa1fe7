"""Cameras as sources: programs that write raw pictures, and what OpenCV opens."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from agribot.core.errors import ConfigError
from agribot.core.facts import TimesKnown, TimesUnsure
from agribot.core.messages import CameraFrame
from agribot.description.loader import load_robot
from agribot.drivers.camera.cameras import CameraSource
from agribot.drivers.line import schemes
from tests.waiting import wait_for

ROBOT = load_robot()
assert ROBOT.camera is not None
WIDTH, HEIGHT = ROBOT.camera.width_px, ROBOT.camera.height_px
# Writes pictures whose red is their number; ends after a given number.
PROGRAM = """
import sys, time
count = int(sys.argv[1])
for k in range(count):
    sys.stdout.buffer.write(bytes((k % 256, 10, 200)) * ({width} * {height}))
    sys.stdout.buffer.flush()
    time.sleep(0.005)
sys.exit("the lens fell off")
"""


class Opened:
    def __init__(self) -> None:
        self.told: list[str] = []
        network = schemes.RosNetwork(lambda: 0, lambda: "", lambda: "")
        self.context = schemes.SourceContext(ROBOT, network, self.told.append)
        self.sources: list[CameraSource] = []
        self._began_s = time.monotonic()

    def open(self, uri: str, name: str = "camera") -> CameraSource:
        source = schemes.open_source(
            name, schemes.read_uri("--source", uri, f"{name}="), self.context
        )
        assert isinstance(source, CameraSource)
        self.sources.append(source)
        return source

    def frames(self, source: CameraSource, count: int) -> list[CameraFrame]:
        found: list[CameraFrame] = []

        def take() -> bool:
            found.extend(source.take(time.monotonic() - self._began_s))
            return len(found) >= count

        wait_for(take, f"{count} pictures")
        return found


@pytest.fixture
def opened() -> Iterator[Opened]:
    opened = Opened()
    yield opened
    for source in opened.sources:
        source.close()
        source.close()


@pytest.fixture
def program(tmp_path: Path) -> str:
    file = tmp_path / "camera.py"
    file.write_text(PROGRAM.format(width=WIDTH, height=HEIGHT))
    return f"{sys.executable} {file}"


def test_raw_pictures_of_any_program_are_frames(opened: Opened, program: str) -> None:
    frames = opened.frames(opened.open(f"pipe:{program} 1000"), 5)
    assert frames[0].image_rgb.shape == (HEIGHT, WIDTH, 3)
    for frame in frames:
        assert np.ptp(frame.image_rgb, axis=(0, 1)).tolist() == [0, 0, 0], "a picture in step"
        assert frame.image_rgb[0, 0].tolist()[1:] == [10, 200]
    stamps = [frame.t_s for frame in frames]
    assert stamps == sorted(set(stamps))


def test_a_camera_whose_program_ends_is_told_with_its_last_words_and_opened_again(
    opened: Opened, program: str
) -> None:
    source = opened.open(f"pipe:{program} 3")
    opened.frames(source, 1)
    wait_for(lambda: any("is back" in text for text in opened.told), "the camera to be back")
    assert "status 1: the lens fell off; trying again" in opened.told[0]
    opened.frames(source, 1)


def test_a_loop_that_stands_still_keeps_the_newest_pictures_only(
    opened: Opened, program: str
) -> None:
    source = opened.open(f"pipe:{program} 1000")
    opened.frames(source, 1)
    wait_for(lambda: source._index > 30, "thirty pictures that are not taken")
    taken = opened.frames(source, 1)
    assert len(taken) <= 5
    assert taken[-1].index > 25


def test_how_well_the_times_of_pictures_are_known_is_told(opened: Opened, program: str) -> None:
    source = opened.open(f"pipe:{program} 1000")
    opened.frames(source, 8)
    notes = [note for t_s in (100.0, 102.0) for note in source.take_more(t_s)["notes"]]
    (note,) = notes
    assert isinstance(note.fact, TimesKnown | TimesUnsure)
    assert note.fact.device == f"camera on {sys.executable}"


def test_a_video_file_is_a_camera_that_begins_again_at_its_end(
    opened: Opened, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is missing (pip install -e '.[camera]')")
    file = tmp_path / "drive.avi"
    size = (WIDTH // 2, HEIGHT // 2)
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 50.0, size)
    for _ in range(8):
        writer.write(np.full((*size[::-1], 3), (200, 10, 60), np.uint8))  # blue, green, red
    writer.release()
    source = opened.open(f"video:{file}")
    frame = opened.frames(source, 1)[0]
    assert frame.image_rgb.shape == (HEIGHT, WIDTH, 3), "fitted to the robot's camera"
    assert frame.image_rgb[0, 0].tolist() == pytest.approx([60, 10, 200], abs=12)
    wait_for(lambda: any("is back" in text for text in opened.told), "the second time round")


def test_a_camera_of_the_network_is_read_over_rtsp_and_again_after_it_restarted(
    opened: Opened,
) -> None:
    pytest.importorskip("cv2", reason="OpenCV is missing (pip install -e '.[camera]')")
    from tests.drivers.rtsp_server import RtspServer, paint

    with RtspServer(paint(WIDTH, HEIGHT)) as server:
        source = opened.open(f"rtsp://127.0.0.1:{server.port}/field")
        frame = opened.frames(source, 3)[-1]
        assert frame.image_rgb.shape == (HEIGHT, WIDTH, 3)
        left, right = (frame.image_rgb[HEIGHT // 2, x] for x in (20, WIDTH - 20))
        assert left.tolist() == pytest.approx([200, 10, 20], abs=12)
        assert right.tolist() == pytest.approx([20, 10, 200], abs=12)
        server.hang_up()
        wait_for(lambda: any("is back" in text for text in opened.told), "the camera to be back")
        assert opened.told[0].startswith("camera from rtsp://127.0.0.1/field is lost")
        opened.frames(source, 2)
        source.close()
    assert server.asked.count("PLAY") == 2


@pytest.mark.parametrize(
    ("uri", "name", "why"),
    [
        ("pipe:/no/such/program", "camera", "No such file"),
        ("pipe:", "camera", "pipe:COMMAND"),
        ("pipe:true", "imu", "that is a camera"),
        ("video:/no/such/file.mp4", "camera", "cannot be opened"),
        ("v4l2:/dev/video99", "camera", "cannot be opened"),
        ("v4l2:/dev/video99?colour=1", "camera", "unknown option 'colour'"),
    ],
)
def test_a_camera_that_cannot_be_opened_is_refused_in_words(
    uri: str, name: str, why: str, opened: Opened
) -> None:
    if not uri.startswith("pipe"):
        pytest.importorskip("cv2", reason="OpenCV is missing (pip install -e '.[camera]')")
    with pytest.raises(ConfigError, match=why):
        opened.open(uri, name)
