"""The files of the built page: compressed where there is a compressed copy and the browser can."""

from __future__ import annotations

import mimetypes
import os
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.staticfiles import NotModifiedResponse

from agribot.ui.server.answers import inside, refuse_request


def page_file(request: Request, folder: Path, name: str, cache_control: str) -> Response:
    """Serve a file below `folder`; 304 where the browser has it, a part where that is asked for.

    Parts are of the file as it is, since a range of compressed bytes is of no use to anybody.
    """
    path = inside(folder, name)
    if path is None or not path.is_file():
        return refuse_request(404, f"no file '{name[:80]}' here")
    headers = {"cache-control": cache_control}
    copy = path.with_name(f"{path.name}.gz")
    shown = path
    if copy.is_file():
        headers["vary"] = "accept-encoding"
        if "range" not in request.headers and accepts_gzip(request):
            headers["content-encoding"] = "gzip"
            shown = copy
    media_type = mimetypes.guess_type(name)[0] or "application/octet-stream"
    answer = FileResponse(shown, media_type=media_type, headers=headers, stat_result=os.stat(shown))
    known = request.headers.get("if-none-match", "")
    if answer.headers["etag"] in {tag.strip().removeprefix("W/") for tag in known.split(",")}:
        return NotModifiedResponse(answer.headers)
    return answer


def accepts_gzip(request: Request) -> bool:
    for entry in request.headers.get("accept-encoding", "").split(","):
        name, _, weight = entry.replace(" ", "").lower().partition(";")
        if name in {"gzip", "*"}:
            return weight not in {"q=0", "q=0.0", "q=0.00", "q=0.000"}
    return False
