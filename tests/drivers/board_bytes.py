"""What the motor board sends."""

from __future__ import annotations

from typing import Any

from agribot.drivers.board import board_protocol as table
from agribot.drivers.board.board_codec import BoardEncoder, BoardFrame


def make_state(**changes: Any) -> table.BoardState:
    values = {
        "t_us": 1_234_567, "counts": (1, -2, 300_000, 0), "speed_countps": (5, -6, 7, 0),
        "duty_ratio": (0.5, -0.25, 0.0, 1.0), "current_a": (0.1, 0.0, 2.5, 12.0),
        "battery_v": 24.123, "flags": table.BoardFlag.NO_COMMAND,
        "stop_causes": table.StopCause(0), "motor_faults": 0, "tool": 0, "command_seq": 0,
        "bad_frames": 0, "encoder_errors": 0,
    }  # fmt: skip
    return table.BoardState(**{**values, **changes})


def make_line(count: int) -> tuple[list[bytes], list[BoardFrame]]:
    """Make the frames that a board sends, and what is in them."""
    encoder = BoardEncoder()
    sent = [make_state(t_us=10_000 * k, counts=(k, 0, 0, -k)) for k in range(count)]
    frames = [encoder.encode(state)[1] for state in sent]
    return frames, [BoardFrame(k & 0xFF, state) for k, state in enumerate(sent)]


def make_all() -> list[table.BoardMessage]:
    """Make one of each message that a board sends."""
    return [
        make_state(),
        table.BoardVersion(
            protocol=table.PROTOCOL, board=table.BoardKind.MOTOR, layout=table.LAYOUT,
            firmware=(1, 0, 0), reset_cause=1,
        ),
        table.BoardImu(
            t_us=1_000_000, accel_mps2=(0.1, 0.0, 9.8), temperature_c=25.0,
            gyro_radps=(0.0, 0.01, -0.5), mag_t=(2e-5, 0.0, -4e-5), mag_count=3,
            flags=table.BoardFlag(0),
        ),
        table.BoardAck(of_type=0x11, of_seq=7, result=table.AckResult.DONE),
    ]  # fmt: skip
