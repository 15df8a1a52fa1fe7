"""`agribot live --show` of a topic: a camera's node of a real ROS 1, and a writer of ROS 2."""

from __future__ import annotations

import io
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from agribot.cli.data.live_overlay import STRIP_PX
from agribot.cli.main import main
from agribot.core.messages import ByteArray
from agribot.core.topics import Qos, Topic
from agribot.ros.messages import rosmsg
from agribot.ros.ros2.node import Ros2Node
from tests import machine
from tests.ros.live import free_port
from tests.ros.ros1_system import Ros1
from tests.waiting import interrupted_once, wait_for

PICTURE = np.zeros((48, 64, 3), np.uint8)
PICTURE[:, :32] = (200, 30, 30)
PICTURE[:, 32:] = (30, 30, 200)
CAMERA = Path(__file__).with_name("ros1_camera.py")


class Blind:
    """A network that calls everything soil, so that the picture stays as it is."""

    def segment(self, image_rgb: ByteArray) -> SimpleNamespace:
        class_id = np.full(image_rgb.shape[:2], 2, np.uint8)
        return SimpleNamespace(class_id=class_id, confidence=np.full_like(class_id, 255))


@pytest.fixture(autouse=True)
def _blind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agribot.lab.train.networks.open_network", lambda *_: Blind())


@pytest.fixture(scope="module")
def ros1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros1]:
    machine.require("roscore")
    with closing(Ros1(tmp_path_factory.mktemp("ros1"))) as ros:
        yield ros


@pytest.fixture
def master(ros1: Ros1) -> str:
    return ros1.uri.removeprefix("http://")


@contextmanager
def camera(ros1: Ros1, topic: str, encoding: str, data: bytes) -> Iterator[None]:
    """A node that publishes a picture meanwhile: it computes as long as it runs."""
    file = ros1.folder / topic.replace("/", "_")
    file.write_bytes(data)
    height, width, _ = PICTURE.shape
    words = (topic, encoding, str(file), str(width), str(height))
    node = ros1.start("/usr/bin/python3", str(CAMERA), *words)
    try:
        wait_for(lambda: topic in ros1.publishers(), f"the publisher of {topic}")
        yield
    finally:
        ros1.stop(node)


def show_until_seen(uri: str) -> ByteArray:
    """Run the command, fetch a picture of its page, and interrupt it."""
    port, seen = free_port(), list[ByteArray]()

    def has_picture() -> bool:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/latest.jpg") as answer:
                pixels = np.asarray(Image.open(io.BytesIO(answer.read())).convert("RGB"))
        except OSError:  # the page is not there yet
            return False
        seen[:] = [pixels]
        return pixels.shape == (PICTURE.shape[0] + STRIP_PX, PICTURE.shape[1], 3)

    with interrupted_once(has_picture):
        assert main(["live", uri, "--show", "--port", str(port), "--patience", "60"]) == 130
    return seen[0]


def assert_is_picture(shown: ByteArray) -> None:
    middle = shown[24].astype(int)
    assert np.abs(middle[16] - PICTURE[24, 16]).max() < 40
    assert np.abs(middle[48] - PICTURE[24, 48]).max() < 40


def test_the_raw_pictures_of_a_real_ros_1_camera_are_shown(ros1: Ros1, master: str) -> None:
    with camera(ros1, "/usb_cam/image_raw", "bgr8", PICTURE[..., ::-1].tobytes()):
        assert_is_picture(show_until_seen(f"ros1://{master}/usb_cam/image_raw"))


def test_the_compressed_pictures_of_a_real_ros_1_camera_are_shown(ros1: Ros1, master: str) -> None:
    jpeg = io.BytesIO()
    Image.fromarray(PICTURE).save(jpeg, format="JPEG", quality=95)
    with camera(ros1, "/usb_cam/image_raw/compressed", "jpeg", jpeg.getvalue()):
        assert_is_picture(show_until_seen(f"ros1://{master}/usb_cam/image_raw/compressed"))


def test_an_encoding_that_is_not_read_is_named_once_with_those_that_are(
    ros1: Ros1, master: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with camera(ros1, "/bayer/image_raw", "bayer_rggb8", PICTURE[..., 0].tobytes()):
        assert main(["live", f"ros1://{master}/bayer/image_raw", "--patience", "3"]) == 1
    said = capsys.readouterr().err
    assert "encoding bayer_rggb8 is unknown; send one of rgb8, bgr8" in said
    assert len([line for line in said.splitlines() if line.startswith("agribot live: frames")]) == 1
    assert "no frame for 3.0 s after 0 frames; what comes cannot be shown" in said


def test_a_topic_that_no_one_publishes_names_those_that_have_pictures(
    ros1: Ros1, master: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with camera(ros1, "/front/image_raw", "rgb8", PICTURE.tobytes()):
        assert main(["live", f"ros1://{master}/image_raw", "--patience", "0.5"]) == 1
    said = capsys.readouterr().err
    assert "no node publishes it, topics with pictures: " in said and "/front/image_raw" in said


@pytest.fixture(scope="module")
def ros2_camera() -> Iterator[str]:
    """A node of ROS 2 that publishes the picture; yields its address."""
    port, ended = free_port(), threading.Event()
    topic = Topic(name="/camera/image_raw", ros_type="sensor_msgs/msg/Image", qos=Qos(depth=1))
    with closing(Ros2Node("camera", 0, f"tcp/127.0.0.1:{port}", listen=True)) as node:
        publish = node.create_publisher(topic)
        data = rosmsg.to_cdr(rosmsg.make_image(1.0, PICTURE))

        def run() -> None:
            while not ended.wait(0.05):
                publish(data)

        thread = threading.Thread(target=run)
        thread.start()
        yield f"127.0.0.1:{port}"
        ended.set()
        thread.join()


def test_the_pictures_of_a_ros_2_writer_are_shown(ros2_camera: str) -> None:
    assert_is_picture(show_until_seen(f"ros2://{ros2_camera}/camera/image_raw"))


def test_of_ros_2_too_the_topics_with_pictures_are_named(
    ros2_camera: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["live", f"ros2://{ros2_camera}/image_raw", "--patience", "0.5"]) == 1
    said = capsys.readouterr().err
    assert "no node publishes it, topics with pictures: /camera/image_raw; start" in said
