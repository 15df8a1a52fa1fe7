"""Sensors on a serial line, a TCP port or gpsd: `serial:/dev/ttyACM0?baud=38400`, `gpsd:`.

Receivers are in `receiver.py`, IMUs in `imu_devices.py`. A line that breaks is opened again.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from agribot.core.errors import ConfigError
from agribot.core.platform import Sensor, SensorSource
from agribot.drivers.gnss import gpsd, ntrip
from agribot.drivers.gnss.corrections import make_tls
from agribot.drivers.gnss.receiver import GpsdDecoder, ReceiverSource
from agribot.drivers.gnss.receiver_decoder import HeadingMount, ReceiverDecoder
from agribot.drivers.imu.imu_devices import ImuSource, make_imu
from agribot.drivers.line.byte_streams import (
    ByteStream,
    OpenStream,
    SerialStream,
    TcpStream,
    describe_failure,
)
from agribot.drivers.line.caster_login import find_login
from agribot.drivers.line.schemes import SourceContext, SourceUri
from agribot.drivers.line.uri_options import UriOptions

# Least time from the epoch of a fix until its last byte: u-blox receivers compute for 40 to 100 ms
# and send a NAV-PVT for 26 ms at 38400 baud.
GNSS_LATENCY_S = 0.06
BAUD = {"gnss": 38400, "imu": 57600}


def open_serial_source(sensor: Sensor, uri: SourceUri, context: SourceContext) -> SensorSource:
    """Open a device on a serial line.

    Raises: ConfigError: no such line, a wrong option, or a sensor that has no codec.
    """
    options = UriOptions(uri)
    baud = int(options.pop_number("baud", BAUD.get(sensor, 115200), 300, 4_000_000))
    return _open_stream(sensor, uri, context, options, lambda: SerialStream(uri.path, baud))


def open_tcp_source(sensor: Sensor, uri: SourceUri, context: SourceContext) -> SensorSource:
    """Open a device whose bytes come over TCP, such as a receiver behind ser2net.

    Raises: ConfigError: no program answers, a wrong option, or a sensor that has no codec.
    """
    host, port = read_address(uri, None)
    return _open_stream(sensor, uri, context, UriOptions(uri), lambda: TcpStream(host, port))


def open_gpsd_source(sensor: Sensor, uri: SourceUri, context: SourceContext) -> ReceiverSource:
    """Open a receiver of a gpsd: `gpsd:` on this machine, `gpsd://HOST:PORT` elsewhere.

    `gpsd://HOST:PORT/dev/ttyACM0` is one of several receivers; else the first that it reports is
    taken.
    Raises: ConfigError: no gpsd answers, a wrong option, or another sensor than the receiver.
    """
    if sensor != "gnss":
        raise ConfigError(f"{sensor} from gpsd: it reports receivers only; use gnss=gpsd:")
    host, port = read_address(uri, gpsd.PORT)
    device = uri.path.rstrip("/")
    options = UriOptions(uri)
    latency_s = options.pop_number("latency_s", GNSS_LATENCY_S, 0.0, 2.0)
    if options.pop_text("ntrip", ""):
        raise ConfigError("gpsd?ntrip=: a receiver of gpsd gets corrections from gpsd itself; see "
                          "ntrip:// in man gpsd, or take the receiver's own line")  # fmt: skip
    options.check_empty()
    return ReceiverSource(
        f"gpsd {host}:{port}{device}", lambda: TcpStream(host, port),
        GpsdDecoder(context.refuse, device), context.refuse, latency_s,
        lambda stream: stream.write(gpsd.write_watch(device)),
    )  # fmt: skip


def refuse_can(sensor: Sensor, uri: SourceUri, context: SourceContext) -> SensorSource:
    """Refuse a sensor on a CAN bus.

    Raises: ConfigError: always.
    """
    raise ConfigError(
        f"{sensor} from {uri.scheme}:{uri.name}: a CAN bus carries motor boards only; write "
        "base=can:can0?board=vesc&ids=11,12"
    )


def open_receiver_line(uri: SourceUri) -> ByteStream:
    """Open the line of a receiver to set it up, by the URI that a run reads it by.

    Raises: ConfigError: no such line, or one of a daemon that has the receiver for itself.
    """
    options = UriOptions(uri)
    try:
        if uri.scheme == "serial":
            return SerialStream(uri.path, int(options.pop_number("baud", 38400, 300, 4_000_000)))
        if uri.scheme == "tcp":
            return TcpStream(*read_address(uri, None))
    except OSError as error:
        raise ConfigError(f"{uri.name}: {describe_failure(error)}") from error
    raise ConfigError(
        f"{uri.scheme}:{uri.name}: not a line; write serial:/dev/ttyACM0 or tcp://HOST:PORT"
    )


def _open_stream(
    sensor: Sensor, uri: SourceUri, context: SourceContext, options: UriOptions, stream: OpenStream
) -> SensorSource:
    def refuse(text: str) -> None:
        context.refuse(f"{sensor} from {uri.name}: {text}")

    if sensor == "gnss":
        return _open_receiver(uri, context, options, stream, refuse)
    if sensor != "imu":
        raise ConfigError(
            f"{sensor} from {uri.scheme}:{uri.name}: not read from a line; give gnss or imu there"
        )
    latency_s = options.pop_number("latency_s", 0.0, 0.0, 2.0)
    device = make_imu(options, refuse)
    options.check_empty()
    return ImuSource(uri.name, stream, device, context.refuse, latency_s)


def _open_receiver(
    uri: SourceUri, context: SourceContext, options: UriOptions, stream: OpenStream,
    refuse: Callable[[str], None],
) -> ReceiverSource:  # fmt: skip
    latency_s = options.pop_number("latency_s", GNSS_LATENCY_S, 0.0, 2.0)
    mount = HeadingMount(
        options.pop_number("heading_offset_deg", 0.0, -360.0, 360.0),
        options.pop_number("heading_std_deg", HeadingMount().std_deg, 0.01, 45.0),
    )
    text, authority = options.pop_text("ntrip", ""), options.pop_text("ntrip_ca", "")
    options.check_empty()
    caster = ntrip.read_caster(text) if text else None
    login = find_login(caster.host, os.environ, Path.home()) if caster else None
    if authority and not (caster and caster.is_secure):
        raise ConfigError("ntrip_ca=: it checks a caster over TLS; write ntrip=ntrips://...")
    tls = make_tls(authority) if caster and caster.is_secure else None
    source = ReceiverSource(
        uri.name, stream, ReceiverDecoder(refuse, mount), context.refuse, latency_s
    )
    if caster is not None:
        source.take_corrections(caster, login, tls)
    return source


def read_address(uri: SourceUri, default_port: int | None) -> tuple[str, int]:
    host, colon, port_text = uri.at.rpartition(":")
    if not colon:
        host, port_text = uri.at, ""
    host = host.strip("[]") or "localhost"
    if not port_text and default_port is not None:
        return host, default_port
    if not (port_text.isdecimal() and 0 < int(port_text) < 65536) or not uri.at:
        raise ConfigError(
            f"{uri.scheme}://{uri.at}: not an address; write {uri.scheme}://HOST:PORT"
        )
    return host, int(port_text)
