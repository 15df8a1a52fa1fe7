"""Headings of two antennas are read in every form, where their ambiguities are fixed."""

from __future__ import annotations

import itertools
import math

import pytest

from agribot.core.geo import compass_deg_from_yaw
from agribot.core.messages import GnssHeading
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver_decoder import HeadingMount, ReceiverDecoder
from agribot.drivers.gnss.unicore import compute_crc32
from tests.drivers import maker_bytes

USUAL_DEG = HeadingMount().std_deg
AVR = "PTNL,AVR,093015.50,{yaw},Yaw,-0.5,Tilt,,,1.002,{quality},1.2,17"
HRP = "PSSN,HRP,093015.50,040526,143.20,,-0.708,0.084,,0.181,21,{mode},2.400,E"
TAR = "PQTMTAR,1,093015.500,{quality},,1.002,-0.5,0.7,143.200,0.146,0.296,0.190,25"
VHD = "PTNL,VHD,093015.50,040526,143.200,-0.138,-0.5,-0.015,1.002,0.006,{quality},17,1.4"
KSXT = "KSXT,20260504093015.50,004.51,52.15,56.5,143.20,-0.50,90.0,0.4,,3,{quality},20,20,,,,,,,,"
HPR = "PSAT,HPR,093015.50,143.20,-0.50,,{source}"
PSTI = "PSTI,036,093015.500,040526,143.20,-0.50,0.00,{mode}"
PASHR = "PASHR,093015.500,143.20,T,-0.50,0.70,+0.10,0.020,0.020,0.190,{quality}"
NOVATEL = "COM1,0,70.5,FINESTEERING,2417,120633.500,02000000,0000,16809"


def make_novatel_line(name: str, kind: str) -> bytes:
    body = f"SOL_COMPUTED,{kind},1.002,143.2000,-0.5,0.0,0.1900,0.29,0000,BASE,25,25,25,20,0,1,3,3"
    text = f"{name}A,{NOVATEL};{body}".encode()
    return b"#%s*%08x\r\n" % (text, compute_crc32(text))


def decode(*data: bytes) -> list[GnssHeading]:
    decoder = ReceiverDecoder(pytest.fail)
    found = [one for each in data for _, one in decoder.feed(each)]
    return [one for one in found if isinstance(one, GnssHeading)]


@pytest.mark.parametrize(
    ("data", "std_deg"),
    [
        (write_sentence("GNHDT,143.20,T"), USUAL_DEG),
        (write_sentence("GNTHS,143.20,A"), USUAL_DEG),
        (write_sentence("GNHPR,093015.50,143.2000,-0.5,0.0,4,38,1.00,0001"), USUAL_DEG),
        (write_sentence(AVR.format(yaw="+143.2000", quality=3)), USUAL_DEG),
        (write_sentence(AVR.format(yaw="-216.8000", quality=3)), USUAL_DEG),
        (write_sentence(HRP.format(mode=2)), 0.084),
        (write_sentence(TAR.format(quality=4)), 0.19),
        (write_sentence("GPTRA,093015.50,143.20,-0.50,000.00,4,20,0.00,0001"), USUAL_DEG),
        (write_sentence(VHD.format(quality=3)), USUAL_DEG),
        (write_sentence(KSXT.format(quality=3)), USUAL_DEG),
        (write_sentence(HPR.format(source="N")), USUAL_DEG),
        (write_sentence(PSTI.format(mode="R")), USUAL_DEG),
        (write_sentence(PASHR.format(quality=2)), 0.19),
        (make_novatel_line("HEADING", "NARROW_INT"), 0.19),
        (make_novatel_line("HEADING2", "NARROW_INT"), 0.19),
        (make_novatel_line("DUALANTENNAHEADING", "L1_INT"), 0.19),
        (maker_bytes.make_unicore_line("UNIHEADING", maker_bytes.make_uniheading_text()), 0.19),
        (maker_bytes.make_unicore_frame(972, maker_bytes.make_uniheading_body()), 0.19),
    ],
)
def test_a_heading_is_read_with_the_accuracy_that_it_states(data: bytes, std_deg: float) -> None:
    (heading,) = decode(data)
    assert compass_deg_from_yaw(heading.yaw_map_rad) == pytest.approx(143.2, abs=1e-4)
    assert math.degrees(heading.std_rad) == pytest.approx(std_deg, rel=1e-4)


@pytest.mark.parametrize(
    "data",
    [
        write_sentence("GNTHS,143.20,V"),
        write_sentence("GNTHS,143.20,E"),
        write_sentence("GNTHS,,V"),
        write_sentence("GNHPR,093015.50,143.2000,-0.5,0.0,5,38,1.00,0001"),
        write_sentence(AVR.format(yaw="+143.2000", quality=2)),
        write_sentence(HRP.format(mode=1)),
        write_sentence(TAR.format(quality=5)),
        write_sentence("GPTRA,093015.50,143.20,-0.50,000.00,5,20,0.00,0001"),
        write_sentence(VHD.format(quality=2)),
        write_sentence(KSXT.format(quality=2)),
        write_sentence(HPR.format(source="G")),
        write_sentence(PSTI.format(mode="F")),
        write_sentence(PASHR.format(quality=0)),
        write_sentence("PASHR,ATT,120633.5,143.20,-0.50,0.70,0.01,0.02,0"),
        make_novatel_line("HEADING2", "NARROW_FLOAT"),
        maker_bytes.make_unicore_line(
            "UNIHEADING", maker_bytes.make_uniheading_text("NARROW_FLOAT")
        ),
        maker_bytes.make_unicore_frame(972, maker_bytes.make_uniheading_body(34)),
        maker_bytes.make_att_euler(143.2, mode=1) * 2,
    ],
)
def test_a_heading_whose_ambiguities_are_not_fixed_is_none(data: bytes) -> None:
    assert decode(data) == []


def test_a_heading_of_septentrio_waits_for_its_covariance() -> None:
    epochs = [
        maker_bytes.make_att_euler(143.2, time_ms=k * 100)
        + maker_bytes.make_att_cov(0.3, time_ms=k * 100)
        for k in range(3)
    ]
    headings = decode(*epochs)
    assert len(headings) == 3
    assert math.degrees(headings[1].std_rad) == pytest.approx(0.3, rel=1e-5)


def test_of_two_headings_the_one_that_states_its_accuracy_counts() -> None:
    uniheading = maker_bytes.make_unicore_line("UNIHEADING", maker_bytes.make_uniheading_text())
    headings = decode(*(uniheading, write_sentence("GNTHS,143.20,A")) * 3)
    assert [math.degrees(each.std_rad) for each in headings] == pytest.approx([0.19] * 3)


def test_headings_between_epochs_have_stamps_of_their_own() -> None:
    decoder, stamps_s = ReceiverDecoder(pytest.fail), []
    gga = "GNGGA,093015.00,5209.0,N,00430.6,E,4,12,0.9,11.5,M,45.0,M,,"
    decoder.feed(write_sentence(gga))
    for part in ("00", "05", "10"):
        body = f"GNHPR,093015.{part},143.2000,-0.5,0.0,4,38,1.00,0001"
        dated = KSXT.format(quality=3).replace("15.50", f"15.{part}")
        found = decoder.feed(write_sentence(body if part == "05" else dated))
        stamps_s += [stamp_s for stamp_s, one in found if isinstance(one, GnssHeading)]
    assert [b - a for a, b in itertools.pairwise(stamps_s)] == pytest.approx([0.05] * 2)
