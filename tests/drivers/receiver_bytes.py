"""Bytes of made-up receivers, written by other people's libraries."""

from __future__ import annotations

import datetime as dt
import math

from pynmeagps import GET, NMEAMessage
from pyubx2 import UBXMessage

from agribot.drivers.gnss.ubx import make_frame
from agribot.drivers.gnss.ubx_setup import MON_VER

EPOCH = dt.datetime(2026, 5, 4, 9, 30, 15, tzinfo=dt.UTC)
VERSIONS = {"ZED-F9P": "27.31", "NEO-M8N": "18.00"}
LAT_DEG, LON_DEG, ALT_M = 52.15, 4.51, 11.5
GEOID_M = 45.0


def make_ubx_pvt(
    at: dt.datetime = EPOCH, lat_deg: float = LAT_DEG, lon_deg: float = LON_DEG,
    carrier: int = 0, h_acc_m: float = 1.4, is_ok: bool = True,
    velocity_mps: tuple[float, float, float] = (0.3, 0.4, 0.0),
) -> bytes:  # fmt: skip
    """Write a NAV-PVT; `velocity_mps` is East, North, up."""
    east, north, up = velocity_mps
    message = UBXMessage(
        "NAV", "NAV-PVT", GET,
        iTOW=itow_ms(at), year=at.year, month=at.month, day=at.day, hour=at.hour, min=at.minute,
        second=at.second, validDate=1, validTime=1, fullyResolved=1,
        nano=at.microsecond * 1000, fixType=3, gnssFixOk=int(is_ok), diffSoln=int(carrier > 0),
        carrSoln=carrier, lon=lon_deg, lat=lat_deg, height=round((ALT_M + GEOID_M) * 1e3),
        hMSL=round(ALT_M * 1e3), hAcc=round(h_acc_m * 1e3), vAcc=2000,
        velN=round(north * 1e3), velE=round(east * 1e3), velD=round(-up * 1e3),
        gSpeed=round(math.hypot(east, north) * 1e3), sAcc=80,
        headMot=math.degrees(math.atan2(east, north)) % 360.0,
    )  # fmt: skip
    data: bytes = message.serialize()
    return data


def make_ubx_hpposllh(at: dt.datetime, lat_deg: float, lon_deg: float) -> bytes:
    coarse_lat_deg, coarse_lon_deg = round(lat_deg, 7), round(lon_deg, 7)
    message = UBXMessage(
        "NAV", "NAV-HPPOSLLH", GET, iTOW=itow_ms(at), lon=coarse_lon_deg, lat=coarse_lat_deg,
        _HPlat=lat_deg - coarse_lat_deg, _HPlon=lon_deg - coarse_lon_deg,
        height=round((ALT_M + GEOID_M) * 1e3), hMSL=round(ALT_M * 1e3), hAcc=14.0, vAcc=20.0,
    )  # fmt: skip
    data: bytes = message.serialize()
    return data


def make_nmea(
    at: dt.datetime = EPOCH, lat_deg: float = LAT_DEG, lon_deg: float = LON_DEG, quality: int = 1,
    std_m: float | None = 0.8, speed_mps: float = 0.5, course_deg: float = 90.0,
) -> list[bytes]:  # fmt: skip
    """Write RMC, GGA and, with `std_m`, GST of an epoch."""
    north, east = "N" if lat_deg >= 0 else "S", "E" if lon_deg >= 0 else "W"
    time = at.time()
    messages = [
        NMEAMessage(
            "GN", "RMC", GET, time=time, status="A", lat=lat_deg, NS=north, lon=lon_deg, EW=east,
            spd=speed_mps / (1852.0 / 3600.0), cog=course_deg, date=at.date(), posMode="A",
        ),
        NMEAMessage(
            "GN", "GGA", GET, time=time, lat=lat_deg, NS=north, lon=lon_deg, EW=east,
            quality=quality, numSV=12, HDOP=0.9, alt=ALT_M, altUnit="M", sep=GEOID_M, sepUnit="M",
        ),
    ]  # fmt: skip
    if std_m is not None:
        messages.append(
            NMEAMessage("GN", "GST", GET, time=time, rangeRms=1.2, stdLat=std_m, stdLong=std_m)
        )
    return [message.serialize() for message in messages]


def itow_ms(at: dt.datetime) -> int:
    day = at.isoweekday() % 7
    seconds = ((day * 24 + at.hour) * 60 + at.minute) * 60 + at.second
    return seconds * 1000 + at.microsecond // 1000


def make_ubx_relposned(
    at: dt.datetime, heading_deg: float, accuracy_deg: float = 0.3, carrier: int = 2,
    is_moving: bool = True, is_valid: bool = True,
) -> bytes:  # fmt: skip
    """Write the baseline of two antennas a metre apart."""
    message = UBXMessage(
        "NAV", "NAV-RELPOSNED", GET, version=1, iTOW=itow_ms(at), relPosLength=100,
        relPosHeading=heading_deg, accHeading=accuracy_deg, gnssFixOK=1, diffSoln=1,
        relPosValid=1, carrSoln=carrier, isMoving=int(is_moving), relPosHeadingValid=int(is_valid),
    )  # fmt: skip
    data: bytes = message.serialize()
    return data


def make_ubx_searching(at: dt.datetime = EPOCH) -> bytes:
    """Write NAV-PVT of a receiver that was just switched on, then what it sees already."""
    message = UBXMessage(
        "NAV", "NAV-PVT", GET, iTOW=itow_ms(at), year=2015, month=10, day=18, fixType=0,
        hAcc=2**32 - 1, vAcc=2**32 - 1, sAcc=20000, pDOP=99.99,
    )  # fmt: skip
    data: bytes = message.serialize()
    return data + make_ubx_sky(at, is_searching=True)


def make_ubx_sky(at: dt.datetime, *, is_searching: bool = False) -> bytes:
    """Write NAV-SAT with three satellites, two of them used, and NAV-DOP."""
    seen = {
        "gnssId": (0, 6, 2), "svId": (5, 14, 31), "cno": (44, 38, 0), "elev": (71, 15, -3),
        "azim": (210, 33, 359), "svUsed": (0, 0, 0) if is_searching else (1, 1, 0),
    }  # fmt: skip
    numbered = {f"{name}_{k + 1:02d}": seen[name][k] for name in seen for k in range(3)}
    sat = UBXMessage("NAV", "NAV-SAT", GET, iTOW=itow_ms(at), version=1, numSvs=3, **numbered)
    dops = {
        "gDOP": 2.1, "pDOP": 1.8, "tDOP": 1.1, "vDOP": 1.5, "hDOP": 0.9, "nDOP": 0.7, "eDOP": 0.6,
    }  # fmt: skip
    told = dict.fromkeys(dops, 99.99) if is_searching else dops
    dop = UBXMessage("NAV", "NAV-DOP", GET, iTOW=itow_ms(at), **told)
    data: bytes = sat.serialize() + dop.serialize()
    return data


def make_ubx_rtcm(use: int, *, is_broken: bool = False) -> bytes:
    """Write RXM-RTCM about a message that came; `use` is 0 unknown, 1 not used, 2 used."""
    message = UBXMessage(
        "RXM", "RXM-RTCM", GET, version=2, crcFailed=int(is_broken), msgUsed=use, msgType=1077
    )
    data: bytes = message.serialize()
    return data


def make_ubx_cor(use: int, protocol: int = 1) -> bytes:
    """Write RXM-COR about a message that came; protocol 1 is RTCM 3."""
    message = UBXMessage(
        "RXM", "RXM-COR", GET, version=1, protocol=protocol, msgUsed=use, msgTypeValid=1,
        msgType=1077,
    )  # fmt: skip
    data: bytes = message.serialize()
    return data


def make_ubx_version(model: str) -> bytes:
    """Write MON-VER of one of VERSIONS, whose blocks pyubx2 does not write."""
    words = [b"EXT CORE 1.00", b"FWVER=HPG 1.32", f"PROTVER={VERSIONS[model]}".encode()]
    words += [f"MOD={model}".encode()]
    body = words[0].ljust(30, b"\0") + b"00190000".ljust(10, b"\0")
    return make_frame(MON_VER, body + b"".join(word.ljust(30, b"\0") for word in words[1:]))


def make_sentence(body: str) -> bytes:
    data: bytes = NMEAMessage(body[:2], body[2:5], GET, payload=body.split(",")[1:]).serialize()
    return data
