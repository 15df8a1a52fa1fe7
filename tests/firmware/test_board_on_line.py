"""A program that opens a serial line drives the firmware behind it, as it would a real board."""

from __future__ import annotations

import ctypes

from agribot.drivers.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board_protocol import BAUD, BoardMessage, BoardState, ClearLatch
from agribot.drivers.byte_streams import SerialStream
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import BoardOnLine
from firmware.build import PREBUILT
from tests.firmware.board_on_bench import REST, command, configure
from tests.waiting import wait_for

FORWARD = (4.0, 4.0, 4.0, 4.0)


def test_a_program_drives_the_board_over_a_serial_line(bench_library: ctypes.CDLL) -> None:
    bench = AvrBench(bench_library, PREBUILT / "motor_board.hex")
    encoder, decoder = BoardEncoder(), BoardDecoder()
    states: list[BoardState] = []
    with BoardOnLine(bench) as board:
        stream = SerialStream(board.path, BAUD)

        def exchange(*messages: BoardMessage) -> BoardState | None:
            stream.write(b"".join(encoder.encode(message)[1] for message in messages))
            found = [frame.message for frame in decoder.feed(stream.read())]
            states.extend(message for message in found if isinstance(message, BoardState))
            return states[-1] if states else None

        wait_for(exchange, "a state of the board")
        exchange(configure(), ClearLatch())
        wait_for(lambda: not getattr(exchange(command(REST)), "flags", True), "no flags")
        wait_for(
            lambda: min(getattr(exchange(command(FORWARD)), "counts", REST)) > 100, "wheels to turn"
        )
        stream.close()
    assert (decoder.bad, decoder.unknown) == (0, 0)
    bench.close()
