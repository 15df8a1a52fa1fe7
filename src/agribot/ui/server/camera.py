"""`/ws/cam/main`: the newest picture to everybody who has drawn the one before.

A viewer has two credits and gives one back for each picture that it has drawn. How long that
takes decides how large the next ones are. A size is encoded once for a frame, and only when
somebody wants it; without viewers the robot sends no pictures at all.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import time
from collections import deque

import msgspec
import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from agribot.core.messages import AskerKind, ByteArray, Who
from agribot.ui import wire
from agribot.ui.server.guarded_connections import POLICY, TOO_MUCH
from agribot.ui.server.hub import Hub

MAX_VIEWERS = 32
FOR_OPERATORS = 8  # connections for operators
CREDITS = 2
LADDER = ((1.0, 75), (0.75, 60), (0.5, 55), (0.35, 45))  # size ratio, JPEG quality
LOOK_AGAIN_S = 0.5  # whether this browser began to replay a recording
REPLAY_LOOK_S = 0.05
SLOW_S, QUICK_S, QUICK_TIMES = 0.25, 0.12, 60
_PALETTE = (220, 40, 40, 40, 180, 60, 120, 90, 60)  # weed, crop, soil


class Picture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """`pixels` is (height, width, 3) for an image and (height, width) for a class mask."""

    kind: int
    index: int
    wall_ms: float
    pixels: ByteArray


def unpack_pixels(data: bytes) -> Picture:
    """Unpack what `feed.pack_pixels` made."""
    kind, index, wall_ms, height, width = wire.PIXELS_HEAD.unpack_from(data)
    pixels = np.frombuffer(data, np.uint8, offset=wire.PIXELS_HEAD.size)
    shape = (height, width) if kind == 1 else (height, width, 3)
    return Picture(kind=kind, index=index, wall_ms=wall_ms, pixels=pixels.reshape(shape))


class SizeLadder:
    """Which size a viewer gets, by how long it takes to draw."""

    def __init__(self) -> None:
        self.level = 0
        self._quick = 0

    def note_drawing(self, delay_s: float) -> None:
        if delay_s > SLOW_S:
            self.level, self._quick = min(self.level + 1, len(LADDER) - 1), 0
        elif delay_s < QUICK_S:
            self._quick += 1
            if self._quick > QUICK_TIMES:
                self.level, self._quick = max(self.level - 1, 0), 0


class Camera:
    """The newest image and mask, and their encoded forms."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._newest: dict[int, Picture] = {}
        self._encoded: dict[tuple[int, int], tuple[int, asyncio.Task[bytes]]] = {}
        self._arrived = asyncio.Event()
        self._viewers: dict[int, bool] = {}

    def show(self, picture: Picture) -> None:
        self._newest[picture.kind] = picture
        arrived, self._arrived = self._arrived, asyncio.Event()
        arrived.set()

    @property
    def viewers(self) -> int:
        return len(self._viewers)

    def enter(self, viewer: int, *, with_mask: bool) -> None:
        self._viewers[viewer] = with_mask
        self._report_viewers()

    def leave(self, viewer: int) -> None:
        self._viewers.pop(viewer, None)
        self._report_viewers()

    async def after(self, kind: int, index: int) -> Picture:
        """Wait for the first picture of this kind that is not the one with `index`."""
        while True:
            picture = self._newest.get(kind)
            if picture is not None and picture.index != index:
                return picture
            await self._arrived.wait()

    def newest(self, kind: int) -> Picture | None:
        return self._newest.get(kind)

    async def encode(self, picture: Picture, level: int) -> bytes:
        """Encode for the first who asks; the others wait for the same bytes."""
        key = (picture.kind, level)
        known = self._encoded.get(key)
        if known is None or known[0] != picture.index:
            work = asyncio.create_task(asyncio.to_thread(encode, picture, level))
            known = self._encoded[key] = (picture.index, work)
        return await asyncio.shield(known[1])

    def _report_viewers(self) -> None:
        mask = any(self._viewers.values())
        self._hub.order(wire.WatchOrder(camera=bool(self._viewers), mask=mask))


def encode(picture: Picture, level: int) -> bytes:
    """Head and JPEG of an image, or head and half-size palette PNG of a mask."""
    from PIL import Image

    buffer = io.BytesIO()
    if picture.kind == 1:
        mask = Image.fromarray(np.ascontiguousarray(picture.pixels[::2, ::2]), mode="P")
        mask.putpalette(_PALETTE)
        mask.save(buffer, format="PNG", compress_level=1)
    else:
        ratio, quality = LADDER[level]
        image = Image.fromarray(picture.pixels)
        if ratio < 1.0:
            size = (round(image.width * ratio), round(image.height * ratio))
            image = image.resize(size, Image.Resampling.BOX)
        image.save(buffer, format="JPEG", quality=quality)
    return (
        wire.CAMERA_HEAD.pack(picture.kind, level, 0, picture.index, picture.wall_ms)
        + buffer.getvalue()
    )


class Viewer:
    def __init__(self, hub: Hub, camera: Camera, socket: WebSocket, *, with_mask: bool) -> None:
        self._hub, self._camera, self._socket = hub, camera, socket
        self._browser: str = socket.scope["agribot.caller"].session
        self._with_mask = with_mask
        self._credits = asyncio.Semaphore(CREDITS)
        self._sent_s: deque[float] = deque()
        self._ladder = SizeLadder()
        self._shown: tuple[str | None, int] = (None, -1)  # recording or None, number

    async def serve(self) -> None:
        self._camera.enter(id(self), with_mask=self._with_mask)
        sender = asyncio.create_task(self._send_all())
        try:
            while True:
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    if message.get("code") == POLICY:
                        self._hub.refuse(Who("a viewer of the camera", AskerKind.VIEWER), TOO_MUCH)
                    return
                self._note_drawing()
        finally:
            sender.cancel()
            self._camera.leave(id(self))

    def _note_drawing(self) -> None:
        if self._sent_s:  # a page that acknowledges more than it got gains nothing
            self._ladder.note_drawing(time.monotonic() - self._sent_s.popleft())
            self._credits.release()

    async def _send_all(self) -> None:
        masked = -1
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._credits.acquire()
                data = await self._next()
                self._sent_s.append(time.monotonic())
                await self._socket.send_bytes(data)
                mask = self._camera.newest(1) if self._with_mask and self._is_live else None
                if mask is not None and mask.index != masked:
                    masked = mask.index
                    await self._socket.send_bytes(await self._camera.encode(mask, 0))

    @property
    def _is_live(self) -> bool:
        return self._shown[0] is None

    async def _next(self) -> bytes:
        """Wait for the next picture of what this browser looks at: the robot, or a recording.

        Recorded pictures are few, and sent as they are.
        """
        while True:
            replay = self._hub.replays.find(self._browser)
            if replay is None:
                with contextlib.suppress(TimeoutError):
                    before = self._shown[1] if self._is_live else -1
                    picture = await asyncio.wait_for(self._camera.after(0, before), LOOK_AGAIN_S)
                    self._shown = (None, picture.index)
                    return await self._camera.encode(picture, self._ladder.level)
                continue
            found = replay.picture()
            if found is not None and self._shown != (replay.name, found[0]):
                number, shot = found
                self._shown = (replay.name, number)
                jpeg = shot.found if self._with_mask and shot.found else shot.image
                return wire.CAMERA_HEAD.pack(0, 0, 0, number, time.time() * 1e3) + jpeg
            await asyncio.sleep(REPLAY_LOOK_S)


async def camera_socket(socket: WebSocket) -> None:
    camera: Camera = socket.app.state.camera
    is_operator = socket.scope["agribot.caller"].role == "operator"
    if camera.viewers >= MAX_VIEWERS - (0 if is_operator else FOR_OPERATORS):
        await socket.close(1013)
        return
    await socket.accept()
    with_mask = socket.query_params.get("mask") == "1"
    await Viewer(socket.app.state.hub, camera, socket, with_mask=with_mask).serve()
