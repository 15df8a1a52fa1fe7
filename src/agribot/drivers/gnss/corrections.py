"""Corrections of a base station on their way from a caster to a receiver.

A thread of its own asks the caster, passes whole RTCM messages on, sends the caster the place of
the receiver every ten seconds (virtual base stations need it), and asks again after a loss. A base
that says to stand where it corrects nothing here, or elsewhere than before, is not passed on.
Neither the control loop nor the thread that reads the receiver waits for it.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from agribot.core.errors import ConfigError
from agribot.core.facts import CorrectionsCome, CorrectionsMissing
from agribot.drivers.gnss.base_place import BaseMemory, doubt_base
from agribot.drivers.gnss.nmea import StampedFix, write_gga
from agribot.drivers.gnss.ntrip import (
    FORMS,
    AnswerDecoder,
    Caster,
    CasterRefusal,
    write_request,
)
from agribot.drivers.gnss.rtcm import RtcmDecoder, RtcmMessage, corrects_ranges, read_base
from agribot.drivers.line.byte_streams import ByteStream, TcpStream
from agribot.drivers.line.caster_login import CasterLogin

if TYPE_CHECKING:
    import ssl

_CLOSE_S = 1.0  # a name that does not resolve holds the thread up for longer; it ends by itself


class CorrectionTiming(NamedTuple):
    """Waiting times: casters shut those out who ask too often."""

    gga_period_s: float = 10.0
    stall_s: float = 15.0  # without a measurement of satellites the line counts as dead
    first_wait_s: float = 1.0  # between two tries, then twice that, and so on
    longest_wait_s: float = 60.0


class CorrectionState(NamedTuple):
    """Age of the last measurement of satellites, None before the first; messages passed on.

    These are counted by their RTCM number.
    """

    age_s: float | None
    counts: dict[int, int]


def make_tls(authority: str = "") -> ssl.SSLContext:
    """Make what checks a caster's certificate: by those of the system, and by a file beside them.

    Raises: ConfigError: the file holds no certificate.
    """
    import ssl

    context = ssl.create_default_context()
    if authority:
        try:
            context.load_verify_locations(authority)
        except OSError as error:  # ssl.SSLError is one
            why = "it holds no certificate (PEM)" if isinstance(error, ssl.SSLError) else ""
            raise ConfigError(
                f"ntrip_ca={authority}: {why or error.strerror or error}; name a file in PEM"
            ) from error
    return context


class CorrectionLink:
    """Feeds a receiver from a caster until it is closed.

    `write` gives bytes to the receiver and returns whether it took them, `last_fix` is where that
    is, None before it knows. `tell` gets once that corrections come, are lost, or cannot be had.
    """

    def __init__(
        self,
        caster: Caster,
        login: CasterLogin | None,
        write: Callable[[bytes], bool],
        last_fix: Callable[[], StampedFix | None],
        notify: Callable[[CorrectionsCome | CorrectionsMissing], None],
        timing: CorrectionTiming | None = None,
        now_s: Callable[[], float] = time.monotonic,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """`tls` checks the certificate of a caster that is asked over TLS.

        Raises: ConfigError: there is no such check for one.
        """
        self._tls = (tls or make_tls()) if caster.is_secure else None
        self._caster, self._login, self._write = caster, login, write
        self._last_fix, self._notify, self._now_s = last_fix, notify, now_s
        self._timing = timing or CorrectionTiming()
        self._counts: Counter[int] = Counter()
        self._bases = BaseMemory(caster.name)
        self._last_s: float | None = None
        self._has_come = self._is_flowing = self._is_doubted = False
        self._notified = ""
        self._forms = itertools.cycle(FORMS)
        self._form = next(self._forms)
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"corrections from {caster.name}", daemon=True
        )
        self._thread.start()

    def state(self) -> CorrectionState:
        """Return how fresh the corrections are; any thread may ask."""
        last_s = self._last_s
        return CorrectionState(
            None if last_s is None else max(self._now_s() - last_s, 0.0), dict(self._counts.copy())
        )

    def close(self) -> None:
        """End the thread. Safe to call twice."""
        self._ended.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        wait_s = self._timing.first_wait_s
        while not self._ended.is_set():
            self._is_flowing = False
            why = self._try()
            if self._ended.is_set():
                return
            self._notify_reason(why)
            wait_s = self._timing.first_wait_s if self._is_flowing else wait_s
            if self._ended.wait(wait_s):
                return
            wait_s = min(2.0 * wait_s, self._timing.longest_wait_s)

    def _try(self) -> str:
        """Ask, and pass on until it ends; returns why it did."""
        try:
            stream = TcpStream(self._caster.host, self._caster.port, self._tls)
        except OSError as error:
            return _explain_line(error)
        try:
            self._pass_on(stream)
        except CasterRefusal as error:
            if error.is_of_form:
                self._form = next(self._forms)
            return str(error)
        except OSError as error:
            return _explain_line(error)
        finally:
            stream.close()
        return ""

    def _pass_on(self, stream: ByteStream) -> None:
        gga = self._write_position()
        stream.write(write_request(self._caster, self._login, self._form, gga))
        answer = AnswerDecoder(self._caster, has_login=self._login is not None)
        messages = RtcmDecoder()
        asked_s = self._now_s()
        sent_s = asked_s if gga and self._form.version == 2 else asked_s - self._timing.gga_period_s
        beside: set[int] = set()
        while not self._ended.is_set():
            try:
                data = stream.read()
            except ConnectionResetError:
                answer.end()
                raise
            for message in messages.feed(answer.feed(data)) if data else ():
                self._take(message)
                if corrects_ranges(message):
                    asked_s = self._now_s()
                    beside.clear()
                else:
                    beside.add(message.kind)
            now_s = self._now_s()
            if now_s - asked_s > self._timing.stall_s:
                raise CasterRefusal(self._explain_stall(messages.junk, beside))
            if answer.is_open and now_s - sent_s >= self._timing.gga_period_s:
                gga = self._write_position()
                stream.write(gga)
                sent_s = now_s if gga else sent_s

    def _write_position(self) -> bytes:
        found = self._last_fix()
        return write_gga(found) if found else b""

    def _take(self, message: RtcmMessage) -> None:
        self._check_base(message)
        if self._is_doubted:  # until the base says that it stands elsewhere
            return
        if not self._write(message.data):  # unplugged, or the line is full: old ones are no use
            return
        self._counts[message.kind] += 1
        if not corrects_ranges(message):
            return
        self._last_s = self._now_s()
        if not self._is_flowing:
            self._is_flowing, self._notified = True, ""
            is_again, self._has_come = self._has_come, True
            self._notify(CorrectionsCome(self._caster.name, is_again))

    def _check_base(self, message: RtcmMessage) -> None:
        """Compare where the base says to stand with where the receiver is, and with earlier runs.

        Raises: CasterRefusal: it corrects nothing there, or by other coordinates than before.
        """
        base, found = read_base(message), self._last_fix()
        if base is None or found is None:
            return
        why = doubt_base(base.ecef_m, found.fix) or self._bases.compare(base)
        self._is_doubted = bool(why)
        if why:
            raise CasterRefusal(why)

    def _explain_stall(self, junk: int, beside: set[int]) -> str:
        if beside:
            kinds = ", ".join(map(str, sorted(beside)))
            return (
                f"for {self._timing.stall_s:g} s the base reported itself only (RTCM {kinds}) and "
                "measured no satellite; check its antenna, or choose another mountpoint"
            )
        if junk and not self._is_flowing:
            return f"{junk} bytes came that are no RTCM 3; choose a mountpoint in that format"
        lacks_fix = "" if self._last_fix() else "; the receiver has no position yet to send to it"
        return f"nothing came for {self._timing.stall_s:g} s{lacks_fix}"

    def _notify_reason(self, why: str) -> None:
        """Report each reason once, until corrections come again."""
        if why == self._notified:
            return
        self._notified = why
        self._notify(CorrectionsMissing(self._caster.name, why, is_lost=self._is_flowing))


def _explain_line(error: OSError) -> str:
    """Say why a line cannot be opened or broke; of TLS, what to do about it."""
    import ssl

    if isinstance(error, ssl.SSLCertVerificationError):
        why = error.verify_message.rstrip(".")
        return (
            f"the caster cannot prove who it is: {why}; nothing was sent to it; check the host's "
            "name and this computer's clock, or name the certificate that signed its own with "
            "ntrip_ca=FILE"
        )
    if isinstance(error, ssl.SSLError):
        return (
            f"no TLS with what answers there ({error.reason or error}); check the port, or write "
            "ntrip:// if the caster has none"
        )
    if isinstance(error, TimeoutError):
        return "no answer in time; check host and port"
    return f"{error.strerror or error}"
