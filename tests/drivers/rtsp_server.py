"""A camera of the network: RTSP over TCP with JPEG pictures in RTP between its answers.

Sources: RFC 2326 (RTSP, interleaved data in 10.12), RFC 2435 (RTP payload of JPEG, quantization
tables in band as Q = 255), RFC 3550 (RTP).
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading

import cv2
import numpy as np

from agribot.core.messages import ByteArray

PICTURE_S = 0.04
CLOCK_HZ, PAYLOAD_JPEG, MOST_BYTES = 90_000, 26, 1400
YUV_420, TABLES_IN_BAND = 1, 255
DQT, SOS = b"\xff\xdb", b"\xff\xda"


class RtspServer:
    """Serves one picture again and again to one client after another, until it is left."""

    def __init__(self, picture_bgr: ByteArray) -> None:
        """Height and width of the picture are multiples of 8."""
        self._size_px = picture_bgr.shape[1], picture_bgr.shape[0]
        _, jpeg = cv2.imencode(".jpg", picture_bgr, [cv2.IMWRITE_JPEG_QUALITY, 90])
        self._tables, self._scan = read_jpeg(jpeg.tobytes())
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.1)
        self.port = int(self._server.getsockname()[1])
        self.asked: list[str] = []
        self._ended, self._hangs_up = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> RtspServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._server.close()

    def hang_up(self) -> None:
        """End the connection that there is, as a camera does that restarts."""
        self._hangs_up.set()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with contextlib.suppress(OSError):
                line, _ = self._server.accept()
                with line:
                    self._talk(line)

    def _talk(self, line: socket.socket) -> None:
        """Answer requests, and send pictures between them once they are asked for."""
        self._hangs_up.clear()
        line.settimeout(PICTURE_S)
        waiting, plays, index = b"", False, 0
        while not (self._ended.is_set() or self._hangs_up.is_set()):
            try:
                data = line.recv(4096)
                if not data:
                    return
                waiting += data
            except TimeoutError:
                pass
            while b"\r\n\r\n" in waiting:
                request, _, waiting = waiting.partition(b"\r\n\r\n")
                plays |= self._answer(line, request.decode())
            if plays:
                line.sendall(self._write_picture(index))
                index += 1

    def _answer(self, line: socket.socket, request: str) -> bool:
        """Answer a request; return whether it was to play."""
        first, *lines = request.splitlines()
        method = first.split()[0]
        self.asked.append(method)
        headers = {
            name.lower(): text.strip() for name, _, text in (s.partition(":") for s in lines)
        }
        more, body = "", ""
        if method == "OPTIONS":
            more = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = (
                "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=field\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\n"
                f"m=video 0 RTP/AVP {PAYLOAD_JPEG}\r\na=control:track1\r\n"
            )
            more = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            more = "Session: 1\r\n"
        head = f"RTSP/1.0 200 OK\r\nCSeq: {headers.get('cseq', '0')}\r\n{more}\r\n"
        line.sendall((head + body).encode())
        return method == "PLAY"

    def _write_picture(self, index: int) -> bytes:
        """Write the packets of a picture, the last of them marked."""
        width, height = self._size_px
        stamp = round(index * PICTURE_S * CLOCK_HZ) % (1 << 32)
        tables = struct.pack(">BBH", 0, 0, len(self._tables)) + self._tables
        out = b""
        for number, at in enumerate(range(0, len(self._scan), MOST_BYTES)):
            piece = self._scan[at : at + MOST_BYTES]
            head = struct.pack(
                ">IBBBB", at, YUV_420, TABLES_IN_BAND, width // 8, height // 8
            )  # type-specific 0, then 24 bits of offset
            payload = head + (b"" if at else tables) + piece
            is_last = at + MOST_BYTES >= len(self._scan)
            count = -(-len(self._scan) // MOST_BYTES)
            rtp = struct.pack(
                ">BBHII", 0x80, PAYLOAD_JPEG | is_last << 7,
                (index * count + number) % 65536, stamp, 7,
            )  # fmt: skip
            packet = rtp + payload
            out += b"$\0" + struct.pack(">H", len(packet)) + packet
        return out


def read_jpeg(data: bytes) -> tuple[bytes, bytes]:
    """Read the quantization tables of a baseline JPEG, one after another, and its scan."""
    tables, at = b"", 2
    while data[at : at + 2] != SOS:
        size = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at : at + 2] == DQT:
            segment = data[at + 4 : at + 2 + size]
            tables += b"".join(segment[k + 1 : k + 65] for k in range(0, len(segment), 65))
        at += 2 + size
    size = int.from_bytes(data[at + 2 : at + 4], "big")
    return tables, data[at + 2 + size : -2]


def paint(width_px: int, height_px: int) -> ByteArray:
    """Paint the left half red and the right half blue; blue, green, red bytes."""
    picture = np.zeros((height_px, width_px, 3), np.uint8)
    picture[:, : width_px // 2], picture[:, width_px // 2 :] = (20, 10, 200), (200, 10, 20)
    return picture
