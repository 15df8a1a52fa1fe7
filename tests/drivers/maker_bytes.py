"""Bytes of receivers by Unicore and Septentrio, written from their makers' definitions."""

from __future__ import annotations

import binascii
import math
import struct
import zlib

LAT_DEG, LON_DEG, ALT_M, GEOID_M = 48.7000123, 9.2000456, 431.25, 47.5
WEEK, TIME_MS = 2429, 468_000_000
SBF_UNKNOWN = -2e10


def make_unicore_line(name: str, body: str, time_ms: int = TIME_MS) -> bytes:
    """Write the ASCII form of a message."""
    text = f"{name}A,97,GPS,FINE,{WEEK},{time_ms},0,0,18,12;{body}"
    return f"#{text}*{compute_crc32(text.encode()):08x}\r\n".encode()


def make_unicore_frame(number: int, body: bytes, time_ms: int = TIME_MS) -> bytes:
    """Write the binary form of a message."""
    head = struct.pack(
        "<3sBHHBBHIIBBH", b"\xaa\x44\xb5", 97, number, len(body), 0, 160, WEEK, time_ms, 0, 0, 18, 0
    )
    return head + body + struct.pack("<I", compute_crc32(head + body))


def compute_crc32(data: bytes) -> int:
    """The CRC-32 of the manual: that of zlib without its inversions."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def make_bestnav_text(
    kind: str = "NARROW_INT", status: str = "SOL_COMPUTED", course: float = 90.0
) -> str:
    """Write the body of a BESTNAVA that moves at 0.5 m/s."""
    place = f"{LAT_DEG:.11f},{LON_DEG:.11f},{ALT_M:.4f},{GEOID_M:.4f},WGS84,0.0080,0.0060,0.0150"
    speed = f"SOL_COMPUTED,DOPPLER_VELOCITY,0.000,0.000,0.5000,{course:.6f},0.0100,0.0500,0.0300"
    return f'{status},{kind},{place},"0",1.000,0.000,42,38,38,30,0,01,30,33,{speed}'


def make_bestnav_body(kind: int = 50, status: int = 0, course: float = 90.0) -> bytes:
    """Write the body of a BESTNAVB that moves at 0.5 m/s."""
    place = struct.pack("<IIdddf", status, kind, LAT_DEG, LON_DEG, ALT_M, GEOID_M)
    stds = struct.pack("<Ifff4sff", 61, 0.008, 0.006, 0.015, b"0", 1.0, 0.0)
    counts = bytes((42, 38, 38, 30, 0, 1, 0x30, 0x33))
    speed = struct.pack("<IIffdddff", 0, 8, 0.0, 0.0, 0.5, course, 0.01, 0.05, 0.03)
    return place + stds + counts + speed


def make_uniheading_text(kind: str = "NARROW_INT", heading_deg: float = 143.2) -> str:
    return (
        f'SOL_COMPUTED,{kind},1.0020,{heading_deg:.4f},-0.5000,0.0000,0.1900,0.3400,"0",'
        "40,35,35,28,0,01,30,33"
    )


def make_uniheading_body(kind: int = 50, heading_deg: float = 143.2) -> bytes:
    angles = struct.pack("<IIffffff", 0, kind, 1.002, heading_deg, -0.5, 0.0, 0.19, 0.34)
    return angles + b"0\0\0\0" + bytes((40, 35, 35, 28, 0, 1, 0x30, 0x33))


def make_sbf(number: int, body: bytes) -> bytes:
    """Put a block's body behind its header, filled up to a multiple of four."""
    body += bytes(-len(body) % 4)
    rest = struct.pack("<HH", number, len(body) + 8) + body
    return b"$@" + struct.pack("<H", binascii.crc_hqx(rest, 0)) + rest


def make_pvt_geodetic(
    mode: int = 4, error: int = 0, time_ms: int = TIME_MS, lat_deg: float = LAT_DEG,
    accuracy_m: float = 0.05,
) -> bytes:  # fmt: skip
    """Write a PVTGeodetic that moves to the East at 0.5 m/s."""
    place = (math.radians(lat_deg), math.radians(LON_DEG), ALT_M + GEOID_M)
    place = (SBF_UNKNOWN,) * 3 if error else place
    body = struct.pack("<IHBBddd", time_ms, WEEK, mode, error, *place)
    body += struct.pack("<fffffdf", GEOID_M, 0.0, 0.5, 0.01, 90.0, 0.1, 0.0)
    body += struct.pack("<BBBBHHIBBHH", 0, 0, 30, 0, 1, 120, 0, 0, 1, 0, 20)
    return make_sbf(4007 | 2 << 13, body + struct.pack("<HHB", round(accuracy_m * 100), 8, 0))


def make_pos_cov(std_m: float, time_ms: int = TIME_MS) -> bytes:
    variances = (std_m**2, std_m**2, 4 * std_m**2, 1.0)
    return make_sbf(5906, struct.pack("<IHBB10f", time_ms, WEEK, 4, 0, *variances, *(0.0,) * 6))


def make_vel_cov(std_mps: float, time_ms: int = TIME_MS) -> bytes:
    variances = (std_mps**2, std_mps**2, 4 * std_mps**2, 1.0)
    return make_sbf(5908, struct.pack("<IHBB10f", time_ms, WEEK, 4, 0, *variances, *(0.0,) * 6))


def make_att_euler(heading_deg: float, mode: int = 2, time_ms: int = TIME_MS) -> bytes:
    angles = (heading_deg, 1.0, SBF_UNKNOWN, 0.0, 0.0, 0.0)
    return make_sbf(5938, struct.pack("<IHBBHBB6f", time_ms, WEEK, 25, 0, mode, 0, 0, *angles))


def make_att_cov(std_deg: float, time_ms: int = TIME_MS) -> bytes:
    variances = (std_deg**2, std_deg**2, 0.0, 0.0, 0.0, 0.0)
    return make_sbf(5939, struct.pack("<IHBB6f", time_ms, WEEK, 0, 0, *variances))
