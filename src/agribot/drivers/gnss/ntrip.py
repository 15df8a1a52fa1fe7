"""NTRIP, the protocol of correction services: what is asked, and what the answer means.

Sources: RTCM 10410.0 (version 1) and 10410.1 (version 2, over HTTP/1.1 with RFC 9112's chunks),
the same over TLS. No input or output here; `corrections.py` holds the line.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Mapping
from typing import NamedTuple
from urllib.parse import urlsplit

from agribot.core.errors import ConfigError
from agribot.core.suggestions import suggest_name
from agribot.core.version import __version__
from agribot.drivers.gnss.rtcm import PREAMBLE
from agribot.drivers.line.caster_login import LOGIN_HELP, CasterLogin, check_no_login

PORT, TLS_PORT = 2101, 443  # the second is that of HTTPS
_AGENT = f"NTRIP agribot/{__version__}"
_LONGEST_HEAD, _LONGEST_TABLE, _LONGEST_CHUNK = 16_384, 1 << 20, 1 << 20
_LONGEST_LINE = 80  # characters of a caster's words that are shown
_NAMES = 8  # mountpoints that are listed
_EMPTY_LINE = re.compile(rb"\r?\n\r?\n")  # RFC 9112, section 2.2: a line may end in a bare LF
_CHUNK_LENGTH = re.compile(rb"\A[0-9A-Fa-f]+(?:;[^\n]*)?\r?\n")
_TABLE_BEGINS = (b"STR;", b"CAS;", b"NET;", b"ENDSOURCETABLE")
_ENOUGH_TO_JUDGE = 64  # bytes
_OF_FORM = (" 400", " 403", " 405", " 406", " 415", " 501", " 505")
_NO_CASTER = "what answers there is no NTRIP caster; check host and port"


class Caster(NamedTuple):
    """Source of corrections; `is_secure` asks for them over TLS."""

    host: str
    port: int
    mount: str
    is_secure: bool = False

    @property
    def name(self) -> str:
        return f"{self.host}:{self.port}/{self.mount}"


class RequestForm(NamedTuple):
    """Form of a request for a mountpoint: the version of the protocol, and the accepted answers."""

    version: int
    accept: str


# Tried in turn: old casters know version 1 only, and some want to read what a rover accepts.
FORMS = tuple(
    RequestForm(version, accept)
    for accept in ("*/*", "rtk/rtcm, dgps/rtcm") for version in (2, 1)
)  # fmt: skip


class CasterRefusal(Exception):
    """A caster does not give what it was asked for; the text says why and what to do.

    `is_of_form` is set where another form of the request may do.
    """

    def __init__(self, text: str, *, is_of_form: bool = False) -> None:
        super().__init__(text)
        self.is_of_form = is_of_form


def read_caster(text: str) -> Caster:
    """Read ntrip://HOST:PORT/MOUNT, or HOST:PORT/MOUNT; ntrips:// is over TLS.

    Raises: ConfigError: it names no mountpoint, or holds a login.
    """
    check_no_login(text)
    try:
        parts = urlsplit(text if "//" in text else f"ntrip://{text}")
        is_secure = parts.scheme == "ntrips"
        usual = TLS_PORT if is_secure else PORT
        host, port = parts.hostname or "", usual if parts.port is None else parts.port
    except ValueError:
        host, port, parts, is_secure = "", 0, urlsplit(""), False
    mount = parts.path.strip("/")
    is_plain = mount.isascii() and mount.isprintable() and not set(mount) & set(" /?#\\")
    is_whole = host and port and mount and is_plain and not (parts.query or parts.fragment)
    if parts.scheme not in ("ntrip", "ntrips") or not is_whole:
        raise ConfigError(
            f"ntrip={text}: not a caster; write ntrip://HOST:PORT/MOUNTPOINT, or ntrips:// over TLS"
        )
    return Caster(host, port, mount, is_secure)


def write_request(
    caster: Caster, login: CasterLogin | None, form: RequestForm = FORMS[0], gga: bytes = b""
) -> bytes:
    """Write the request for a mountpoint; `gga` gives version 2 the rover's place at once."""
    version, accept = form
    lines = [f"GET /{caster.mount} HTTP/1.{version - 1}"]
    if version == 2:
        lines += [f"Host: {caster.host}:{caster.port}", "Ntrip-Version: Ntrip/2.0"]
    lines += [f"User-Agent: {_AGENT}", f"Accept: {accept}"]
    if login is not None:
        word = f"{login.user}:{login.password}".encode()
        lines += [f"Authorization: Basic {base64.b64encode(word).decode()}"]
    if version == 2:
        lines += [f"Ntrip-GGA: {gga.decode().strip()}"] if gga else []
        lines += ["Connection: close"]
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


class AnswerDecoder:
    """Reads a caster's answer from its bytes: first the head, then what the mountpoint sends."""

    def __init__(self, caster: Caster, *, has_login: bool) -> None:
        self._caster, self._has_login = caster, has_login
        self._waiting = bytearray()
        self._chunks: _Chunks | None = None
        self._is_table = False
        self._is_text = False  # its beginning will show whether it is a table
        self.is_open = False  # the caster said yes

    def feed(self, data: bytes) -> bytes:
        """Take bytes of the caster; gives those of the mountpoint.

        Raises: CasterRefusal: it says no, sends a list of mountpoints, or speaks no NTRIP.
        """
        if self.is_open:
            return self._chunks.feed(data) if self._chunks else data
        self._waiting += data
        is_read = self._is_table or self._is_text or self._read_head()
        if not is_read or (self._is_text and not self._read_text()):
            return b""
        if self._is_table:
            if b"ENDSOURCETABLE" in self._waiting or len(self._waiting) > _LONGEST_TABLE:
                self.end()
            return b""
        rest = bytes(self._waiting)
        self._waiting.clear()
        return self._chunks.feed(rest) if self._chunks else rest

    def end(self) -> None:
        """Say what it means that the caster closed the line now.

        Raises: CasterRefusal: always.
        """
        if self._is_table:
            raise self._refuse_by_table(bytes(self._waiting))
        if self.is_open:
            raise CasterRefusal("the caster closed the line")
        line = _clean(bytes(self._waiting).partition(b"\n")[0])
        if _is_redirect(line):
            self._read_http(line, _read_fields(bytes(self._waiting)))
        if self._is_text and self._waiting.strip():
            raise CasterRefusal(f"the caster answers '{_clean(bytes(self._waiting))}'")
        hint = "" if self._caster.is_secure else "; if it speaks TLS, write ntrips://"
        raise CasterRefusal(f"the caster closed the line without an answer{hint}", is_of_form=True)

    def _read_head(self) -> bool:
        """Read the first line and, of HTTP, those to the empty one; return whether it is there."""
        first, newline, rest = bytes(self._waiting).partition(b"\n")
        line = _clean(first)
        if not newline:
            if len(first) > _LONGEST_HEAD or not _may_begin(first):
                raise CasterRefusal(_NO_CASTER)
            return False
        if _is_redirect(line) or (line.startswith("HTTP/1.") and " 200" in line[8:13]):
            found = _EMPTY_LINE.search(self._waiting)
            head = bytes(self._waiting[: found.start() if found else None])
            if found is None:
                if len(head) > _LONGEST_HEAD:
                    raise CasterRefusal(f"the head of its answer exceeds {_LONGEST_HEAD} bytes")
                return False
            rest = bytes(self._waiting[found.end() :])
            self._read_http(line, _read_fields(head))
        elif line.startswith("SOURCETABLE 200"):
            self._is_table = True
        elif not line.startswith("ICY 200"):
            self._refuse(line)
        self.is_open = not (self._is_table or self._is_text)
        self._waiting[:] = rest
        return True

    def _read_text(self) -> bool:
        """Find out from its beginning what a text is, once there is enough of it.

        Raises: CasterRefusal: neither a source table nor RTCM.
        """
        words = _CHUNK_LENGTH.sub(b"", self._waiting, count=1)
        self._is_table = words.lstrip().startswith(_TABLE_BEGINS)
        if not self._is_table and PREAMBLE not in words:
            if b"\n" in words.lstrip() or len(words) > _ENOUGH_TO_JUDGE:
                raise CasterRefusal(
                    f"the caster answers '{_clean(words.lstrip().splitlines()[0])}'"
                )
            return False
        self._is_text, self.is_open = False, not self._is_table
        return True

    def _read_http(self, line: str, fields: Mapping[str, str]) -> None:
        if _is_redirect(line):
            where = _clean(fields.get("location", "").encode("latin-1"))
            sends = f"sends on to '{where}'" if where else "sends on, and does not say where to"
            raise CasterRefusal(
                f"the caster {sends} ('{line}'); write the address of the caster itself"
            )
        kind = fields.get("content-type", "").lower()
        if kind.startswith("text/html"):
            raise CasterRefusal(_NO_CASTER)
        if "chunked" in fields.get("transfer-encoding", "").lower():
            self._chunks = _Chunks()
        self._is_table = "sourcetable" in kind
        self._is_text = kind.startswith("text/plain")

    def _refuse(self, line: str) -> None:
        words = line.upper()
        if " 401" in words or "PASSWORD" in words or "UNAUTHORIZED" in words:
            raise CasterRefusal(
                f"the caster refuses the login; check {LOGIN_HELP}"
                if self._has_login
                else f"the caster wants a login: {LOGIN_HELP}"
            )
        if " 404" in words or "MOUNT" in words:
            raise CasterRefusal(
                f"the caster has no mountpoint '{self._caster.mount}' now; choose another"
            )
        if not words.startswith(("HTTP/", "ICY", "ERROR")):
            raise CasterRefusal(_NO_CASTER)
        raise CasterRefusal(
            f"the caster answers '{line}'", is_of_form=any(code in words for code in _OF_FORM)
        )

    def _refuse_by_table(self, table: bytes) -> CasterRefusal:
        words = [_clean(line).split(";") for line in table.splitlines()]
        names = [w[1] for w in words if w[0] == "STR" and len(w) > 1]
        if self._caster.mount in names:
            text = f"the caster sends its list, and not its mountpoint '{self._caster.mount}'"
            return CasterRefusal(f"{text}; check that the login may use it", is_of_form=True)
        more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
        has = f"it has {', '.join(names[:_NAMES])}{more}" if names else "its list is empty"
        mount = self._caster.mount
        hint = suggest_name(mount, names)
        return CasterRefusal(f"the caster has no mountpoint '{mount}'{hint}; {has}")


class _Chunks:
    """Takes the chunks of RFC 9112, section 7.1, apart."""

    def __init__(self) -> None:
        self._line = bytearray()
        self._left = 0  # bytes left of the present chunk, with the line's end behind it

    def feed(self, data: bytes) -> bytes:
        body = bytearray()
        while data:
            if self._left:
                part, data = data[: self._left], data[self._left :]
                # The last two bytes of a chunk are its line's end.
                body += part[: max(self._left - 2, 0)]
                self._left -= len(part)
                continue
            line, newline, data = data.partition(b"\n")
            self._line += line
            if len(self._line) > _LONGEST_HEAD:
                raise CasterRefusal("a chunk without a length")
            if newline:
                self._left = self._read_length(bytes(self._line)) + 2
                self._line.clear()
        return bytes(body)

    def _read_length(self, line: bytes) -> int:
        word = line.partition(b";")[0].strip()
        try:
            length = int.from_bytes(binascii.unhexlify(word.rjust(len(word) + len(word) % 2, b"0")))
        except binascii.Error:
            raise CasterRefusal("a chunk whose length is not a number") from None
        if not word:
            raise CasterRefusal("a chunk without a length")
        if length > _LONGEST_CHUNK:
            raise CasterRefusal(f"a chunk of {length} bytes; the limit is {_LONGEST_CHUNK}")
        if length == 0:
            raise CasterRefusal("the caster ended the stream")
        return length


def _is_redirect(line: str) -> bool:
    return line.startswith("HTTP/1.") and line[8:11] == " 30"


def _may_begin(first: bytes) -> bool:
    """Return whether bytes without a line's end may be the beginning of an answer."""
    known = (b"HTTP/1.", b"ICY 200", b"SOURCETABLE", b"ERROR")
    return any(word.startswith(first[: len(word)]) for word in known)


def _read_fields(head: bytes) -> dict[str, str]:
    pairs = (line.decode("latin-1").partition(":") for line in head.splitlines()[1:])
    return {name.strip().lower(): value.strip() for name, _, value in pairs}


def _clean(line: bytes) -> str:
    """Make a caster's words fit to be shown: printable ASCII, cut to the longest line."""
    text = line.decode("latin-1").strip()
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)[:_LONGEST_LINE]
