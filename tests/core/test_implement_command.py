"""The command to an implement, as recordings have it."""

from __future__ import annotations

import msgspec
import pytest

from agribot.core.implement.spec import describe_command
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import ImplementCommand

BOOM = SprayerSpec(
    x_body_m=-0.35, section_count=3, section_spacing_m=0.1, section_width_m=0.1, latency_s=0.05
)


@pytest.mark.parametrize("sections", [(False, True, False), (True,) * 9])
def test_recordings_of_a_sprayer_have_the_bytes_that_they_always_had(
    sections: tuple[bool, ...],
) -> None:
    recorded = msgspec.msgpack.encode({"nozzles_open": sections})
    command = ImplementCommand(sections_on=sections)
    assert msgspec.msgpack.encode(command) == recorded
    assert msgspec.msgpack.decode(recorded, type=ImplementCommand) == command


def test_a_recording_of_a_robot_without_an_implement_is_read_as_ever() -> None:
    recorded = msgspec.msgpack.encode({"nozzles_open": ()})
    assert msgspec.msgpack.decode(recorded, type=ImplementCommand) == ImplementCommand()


def test_setpoints_come_back_from_a_recording() -> None:
    command = ImplementCommand(sections_on=(True,), setpoints={"depth_m": 0.02})
    again = msgspec.msgpack.decode(msgspec.msgpack.encode(command), type=ImplementCommand)
    assert again == command


def test_a_command_is_told_in_the_words_of_its_implement() -> None:
    command = ImplementCommand(sections_on=(False, True, False))
    assert describe_command(BOOM, command) == (("Nozzles", "○●○"),)
    assert describe_command(None, command) == (("Implement", "○●○"),)
    assert describe_command(BOOM, ImplementCommand()) == ()


def test_the_tags_of_a_sprayer_keep_their_names() -> None:
    names = [field.encode_name for field in msgspec.structs.fields(SprayerSpec)]
    assert names == [
        "x_body_m", "nozzle_count", "nozzle_spacing_m", "nozzle_width_m", "latency_s"
    ]  # fmt: skip
