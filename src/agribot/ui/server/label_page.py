"""The page of `agribot label` and what it asks: this machine, no robot.

Two pages may be open on one folder: neither replaces what the other has saved.

Classes, plants and superpixels cross the line as plain bytes, row by row, with their size in
headers.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Literal, Protocol

import msgspec
import numpy as np
import numpy.typing as npt
import uvicorn
from PIL import Image
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route

from agribot.core.errors import AgribotError
from agribot.core.messages import ByteArray
from agribot.ui.address import Address, bound
from agribot.ui.server.access import Access, Refusal
from agribot.ui.server.answers import Unusable, json_answer, refuse_request
from agribot.ui.server.app import FOR_EVER, NOT_BUILT, SAFE_HEADERS
from agribot.ui.server.languages import language_of
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.page_files import page_file
from agribot.ui.server.serve import QuietServer

PAGE_DIR = Path(__file__).parents[1] / "page"
PAGE = "label.html"
LAST_KNOCK_S = 0.05
JPEG_QUALITY = 93
State = Literal["new", "draft", "done"]
Endpoint = Callable[[Request], Awaitable[Response]]


class PictureState(msgspec.Struct, frozen=True, kw_only=True):
    """A picture in the list.

    `uncertainty`, 0 to 1, is that of the names of its plants; None before the network has seen it.
    """

    number: int
    name: str
    state: State
    uncertainty: float | None


class PictureList(msgspec.Struct, frozen=True, kw_only=True):
    about: str
    pictures: list[PictureState]


class LabelledClasses(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """`PlantClass` or 255 of every pixel (height, width), and whether somebody has drawn it.

    `revision` changes with every change of what is saved.
    """

    class_id: ByteArray
    state: State
    revision: str


class SavedMeanwhileError(AgribotError):
    """Somebody else has saved a picture since its revision; what was drawn is kept elsewhere."""


class LabelSet(Protocol):
    """What the page works on; numbers are those of `list_pictures`."""

    @property
    def about(self) -> str: ...

    def list_pictures(self) -> list[PictureState]: ...

    def read_picture(self, number: int) -> ByteArray: ...

    def read_classes(self, number: int) -> LabelledClasses: ...

    def find_superpixels(self, number: int) -> npt.NDArray[np.uint16]: ...

    def find_plants(self, number: int) -> npt.NDArray[np.uint16]: ...

    def save(
        self, number: int, class_id: ByteArray, *, is_done: bool, revision: str = ""
    ) -> str: ...


@contextlib.contextmanager
def serve_labels(labels: LabelSet, port: int | None = None) -> Iterator[str]:
    """Serve the page on this machine alone, in a thread; yields its address.

    Raises: ConfigError: the port is taken.
    """
    address = Address(port=port)
    with contextlib.closing(bound(address)) as listener:
        taken: int = listener.getsockname()[1]
        config = uvicorn.Config(
            _build_app(labels, taken),
            log_level="error",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        logging.getLogger("uvicorn.error").addFilter(_is_news)
        server = QuietServer(config)
        thread = threading.Thread(target=_serve, args=(server, listener), daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{taken}/"
        finally:
            server.should_exit = True
            thread.join()


def _is_news(record: logging.LogRecord) -> bool:
    """Leave out that the server's end cuts answers short, which is intended."""
    return not str(record.msg).startswith("Cancel ")


def _serve(server: uvicorn.Server, listener: socket.socket) -> None:
    asyncio.run(_serve_and_close(server, listener))


async def _serve_and_close(server: uvicorn.Server, listener: socket.socket) -> None:
    await server.serve(sockets=[listener])
    # A browser that knocked while the server ended was let in and never greeted.
    await asyncio.sleep(LAST_KNOCK_S)
    for late in [*server.server_state.connections]:
        late.transport.abort()
    await asyncio.sleep(0.0)


def _build_app(labels: LabelSet, port: int) -> Starlette:
    one = "/api/v1/pictures/{number:int}"
    access = Access(
        (), port, secrets.token_hex(), secrets.token_hex(), secrets.token_hex(), is_local=True
    )
    found: tuple[tuple[str, str, Endpoint], ...] = (
        ("GET", "/api/v1/pictures", _list_pictures),
        ("GET", f"{one}/picture", _show_picture),
        ("GET", f"{one}/classes", _read_classes),
        ("PUT", f"{one}/classes", _save_classes),
        ("GET", f"{one}/superpixels", _find_superpixels),
        ("GET", f"{one}/plants", _find_plants),
        ("GET", "/", _front_page),
        ("GET", "/{path:path}", _bundled_file),
    )
    app = Starlette(
        routes=[
            Route(path, _guard(endpoint, access), methods=[method])
            for method, path, endpoint in found
        ]
    )
    app.state.labels = labels
    return app


def _guard(endpoint: Endpoint, access: Access) -> Endpoint:
    """Let in this page alone, and turn what a person can act on into one sentence."""

    async def answering(request: Request) -> Response:
        verdict = access.check("http", request.method, request.url.path, request.headers)
        if isinstance(verdict, Refusal):
            answer = refuse_request(verdict.status, verdict.why, language_of(request))
        else:
            try:
                answer = await endpoint(request)
            except Unusable as error:
                answer = error.answer(request)
            except AgribotError as error:
                answer = refuse_request(422, str(error))
            except asyncio.CancelledError:  # the server ends, and has waited for long enough
                answer = refuse_request(503, "agribot label has ended; start it again")
        for name, value in SAFE_HEADERS:
            answer.headers[name.decode()] = value.decode()
        return answer

    return answering


def _labels(request: Request) -> LabelSet:
    labels: LabelSet = request.app.state.labels
    return labels


def _number(request: Request) -> int:
    """Read the number of a picture from the path.

    Raises: Unusable: there is no such picture.
    """
    number: int = request.path_params["number"]
    if all(number != one.number for one in _labels(request).list_pictures()):
        raise Unusable(404, f"there is no picture {number}; load the page again")
    return number


async def _list_pictures(request: Request) -> Response:
    labels = _labels(request)
    pictures = await run_in_thread(labels.list_pictures)
    return json_answer(PictureList(about=labels.about, pictures=pictures))


async def _show_picture(request: Request) -> Response:
    image_rgb = await run_in_thread(_labels(request).read_picture, _number(request))
    jpeg = await run_in_thread(_encode, image_rgb)
    return Response(jpeg, media_type="image/jpeg", headers={"cache-control": "no-store"})


def _encode(image_rgb: ByteArray) -> bytes:
    buffer = io.BytesIO()
    image = Image.fromarray(image_rgb)
    image.save(buffer, format="JPEG", quality=JPEG_QUALITY, subsampling=0)
    return buffer.getvalue()


async def _read_classes(request: Request) -> Response:
    found = await run_in_thread(_labels(request).read_classes, _number(request))
    return _array_answer(found.class_id, {"x-state": found.state, "etag": f'"{found.revision}"'})


async def _find_superpixels(request: Request) -> Response:
    pieces = await run_in_thread(_labels(request).find_superpixels, _number(request))
    return _array_answer(pieces.astype("<u2"), {})


async def _find_plants(request: Request) -> Response:
    plants = await run_in_thread(_labels(request).find_plants, _number(request))
    return _array_answer(plants.astype("<u2"), {})


def _array_answer(array: npt.NDArray[np.unsignedinteger], headers: dict[str, str]) -> Response:
    height, width = array.shape
    size = {"x-width": str(width), "x-height": str(height), "cache-control": "no-store"}
    return Response(
        array.tobytes(), media_type="application/octet-stream", headers={**size, **headers}
    )


async def _save_classes(request: Request) -> Response:
    """Save the classes of a picture; `?done=1` says that they are finished.

    With `If-Match`, the `ETag` of what was read or saved before, they replace nothing else.
    """
    number, labels = _number(request), _labels(request)
    shape = (await run_in_thread(labels.read_picture, number)).shape[:2]
    size, data = shape[0] * shape[1], bytearray()
    async for part in request.stream():
        data += part
        if len(data) > size:
            break
    if len(data) != size:
        raise Unusable(
            400, f"the classes are not those of {shape[1]} x {shape[0]} pixels; load the page again"
        )
    class_id = np.frombuffer(bytes(data), np.uint8).reshape(shape)
    is_done = request.query_params.get("done") == "1"
    known = request.headers.get("if-match", "").strip('"')
    try:
        saved = await run_in_thread(
            lambda: labels.save(number, class_id, is_done=is_done, revision=known)
        )
    except SavedMeanwhileError as error:
        raise Unusable(409, str(error)) from error
    return Response(status_code=204, headers={"etag": f'"{saved}"'})


async def _front_page(request: Request) -> Response:
    if not (PAGE_DIR / PAGE).is_file():
        return HTMLResponse(NOT_BUILT)
    return page_file(request, PAGE_DIR, PAGE, "no-cache")


async def _bundled_file(request: Request) -> Response:
    path = request.path_params["path"]
    return page_file(
        request, PAGE_DIR, path, FOR_EVER if path.startswith("assets/") else "no-cache"
    )
