"""`agribot live --show`: the page with the network's classes in the picture."""

from __future__ import annotations

import io
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import closing
from email.message import Message
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from agribot.cli.data import live
from agribot.cli.data.live_overlay import STRIP_PX, WIDEST_PX, draw_notice, draw_overlay
from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.ui.server.live_page import MOST_VIEWERS, LivePage
from tests.ros.live import free_port
from tests.waiting import PATIENCE_S, interrupted_once, wait_for


class LeftWeedRightCrop:
    """A network that is sure of the same classes in every picture: weed, soil, crop."""

    def segment(self, image_rgb: ByteArray) -> SimpleNamespace:
        class_id = np.repeat([[0, 2, 1]], 12, axis=0).repeat(8, axis=1).astype(np.uint8)
        return SimpleNamespace(class_id=class_id, confidence=np.full_like(class_id, 255))


class GreyCamera:
    """Gives one grey picture after another, until it is stopped."""

    name, ends, is_file = "test camera", False, False
    closed = stopped = False

    def read(self) -> ByteArray | None:
        return None if self.stopped else np.full((96, 144, 3), 120, np.uint8)

    def explain_silence(self) -> str:
        return "ask the test"

    def stop(self) -> None:
        self.stopped = True

    def close(self) -> None:
        self.closed = True


def open_pixels(jpeg: bytes) -> ByteArray:
    pixels: ByteArray = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))
    return pixels


def fetch(url: str, **headers: str) -> tuple[int, Message, bytes]:
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


@pytest.fixture
def page() -> Iterator[LivePage]:
    with closing(LivePage(free_port())) as page:
        yield page


def test_weeds_are_red_and_crops_green_over_the_picture_with_the_figures_below_it() -> None:
    image_rgb = GreyCamera().read()
    assert image_rgb is not None
    shown = open_pixels(draw_overlay(image_rgb, LeftWeedRightCrop().segment(image_rgb), "9 fps"))
    assert shown.shape == (96 + STRIP_PX, 144, 3)
    left, middle, right = (shown[40, x].astype(int) for x in (20, 72, 124))
    assert left[0] > left[1] + 80 and right[1] > right[0] + 80
    assert np.ptp(middle) < 10
    assert shown[96:].max() > 200 and np.median(shown[96:]) < 20


def test_a_picture_too_wide_for_a_page_is_shown_smaller() -> None:
    image_rgb = np.zeros((1000, 4000, 3), np.uint8)
    shown = open_pixels(draw_overlay(image_rgb, LeftWeedRightCrop().segment(image_rgb), ""))
    assert shown.shape == (320 + STRIP_PX, WIDEST_PX, 3)


def test_a_browser_gets_each_new_picture_and_the_last_one_when_the_page_ends(
    page: LivePage,
) -> None:
    page.show(b"first")
    with urllib.request.urlopen(f"{page.url}stream.mjpg", timeout=PATIENCE_S) as stream:
        assert stream.headers["content-type"].startswith("multipart/x-mixed-replace; boundary=")
        read = b""
        while b"first" not in read:
            read += stream.readline()
        wait_for(lambda: page.viewers == 1, "the viewer to be counted")
        page.show(b"second")
        while b"second" not in read:
            read += stream.readline()
        page.close(b"the end")
        assert b"content-length: 7\r\n\r\nthe end" in stream.read()
    assert page.viewers == 0


def test_the_page_shows_the_stream_and_answers_no_other_name_than_this_machines(
    page: LivePage,
) -> None:
    page.show(b"jpeg")
    status, headers, body = fetch(page.url)
    assert status == 200 and b'src="/stream.mjpg"' in body
    assert "default-src 'none'" in headers["content-security-policy"]
    assert fetch(f"{page.url}latest.jpg")[2] == b"jpeg"
    assert fetch(f"{page.url}secrets")[0] == 404
    status, _, body = fetch(page.url, Host="evil.example")
    assert status == 403 and b"is not a name of this robot" in body


def test_more_browsers_than_places_are_told_so(page: LivePage) -> None:
    page.show(b"jpeg")
    url = f"{page.url}stream.mjpg"
    streams = [urllib.request.urlopen(url, timeout=PATIENCE_S) for _ in range(MOST_VIEWERS)]
    wait_for(lambda: page.viewers == MOST_VIEWERS, "all viewers")
    status, _, body = fetch(url)
    assert status == 503 and b"close one of them" in body
    page.close()
    for stream in streams:
        stream.close()


def test_a_taken_port_is_refused_before_the_camera_is_looked_at(page: LivePage) -> None:
    with pytest.raises(ConfigError, match=f"cannot serve the page at 127.0.0.1:{page.port}"):
        LivePage(page.port)


def test_live_shows_its_picture_on_the_page_until_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera, port, shown = GreyCamera(), free_port(), list[ByteArray]()
    monkeypatch.setattr(live, "open_source", lambda name, seed: camera)
    monkeypatch.setattr("agribot.lab.train.networks.open_network", lambda *_: LeftWeedRightCrop())

    def has_picture() -> bool:
        try:
            pixels = open_pixels(fetch(f"http://127.0.0.1:{port}/latest.jpg")[2])
        except OSError:  # the page is not there yet
            return False
        shown[:] = [pixels]
        return pixels.shape == (96 + STRIP_PX, 144, 3)

    with interrupted_once(has_picture):
        assert main(["live", "0", "--show", "--port", str(port), "--json"]) == 130
    assert shown[0][40, 20, 0] > 180 and shown[0][40, 124, 1] > 160
    printed = capsys.readouterr()
    assert f"page: http://127.0.0.1:{port}/" in printed.err
    assert json.loads(printed.out)["frames"] > 0
    assert camera.closed
    with pytest.raises(OSError):
        fetch(f"http://127.0.0.1:{port}/")


def test_a_notice_stands_where_no_picture_has_come() -> None:
    shown = open_pixels(draw_notice("waiting for the first picture of ros1:/usb_cam/image_raw"))
    assert shown.shape == (480, 640, 3) and shown.max() > 200
