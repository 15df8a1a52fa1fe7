"""The slow line behind which `agribot bench ui` puts a page."""

from __future__ import annotations

import asyncio
import time

import pytest

from agribot.lab.bench.ui import GOOD_AGE_S, LinkDelay, check_delays
from agribot.lab.bench.ui_link import DELAY_S, SlowConnection

DATA = bytes(range(256)) * 200  # 51 kB


async def _close(writer: asyncio.StreamWriter) -> None:
    writer.close()
    await writer.wait_closed()


async def _through(bytes_per_s: float) -> tuple[bytes, float]:
    """What comes out of a line into which DATA is sent, and how long that takes."""

    async def send(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        assert await reader.readexactly(2) == b"go"
        writer.write(DATA)
        await writer.drain()
        await _close(writer)

    async with await asyncio.start_server(send, "127.0.0.1", 0) as far:
        line = SlowConnection(bytes_per_s, far.sockets[0].getsockname()[1])
        async with line.open() as port:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            from_s = time.monotonic()
            writer.write(b"go")
            got = await reader.readexactly(len(DATA))
            passed_s = time.monotonic() - from_s
            await _close(writer)
    return got, passed_s


def test_a_line_carries_all_in_order_and_no_faster_than_its_rate() -> None:
    got, passed_s = asyncio.run(_through(100e3))
    assert got == DATA
    assert passed_s >= len(DATA) / 100e3 + 2 * DELAY_S - 0.05


@pytest.mark.parametrize(("mbit_per_s", "most_s"), [(10.0, GOOD_AGE_S), (1.0, 2 * GOOD_AGE_S)])
def test_a_picture_that_is_too_old_fails_the_benchmark(mbit_per_s: float, most_s: float) -> None:
    def limit(age_s: float) -> bool:
        link = LinkDelay(
            mbit_per_s=mbit_per_s, state_hz=30.0, state_age_p95_s=0.1, camera_hz=9.0,
            camera_age_p95_s=age_s,
        )  # fmt: skip
        return check_delays([link])[0].ok

    assert limit(most_s)
    assert not limit(most_s + 0.01)
