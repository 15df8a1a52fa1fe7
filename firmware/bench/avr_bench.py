"""The firmware on the bench: an ATmega2560 in simavr with wheels, contacts and an IMU around it.

Deterministic: what is put in between two calls of `advance` decides, to the cycle, what comes out.
For tests and simulation only; simavr is under the GPL and stays outside of the package.
"""

from __future__ import annotations

import ctypes
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

from agribot.core.messages import Four, Vec3
from agribot.drivers.board.board_protocol import BoardImu, list_fields

SOURCE = Path(__file__).with_suffix(".c")
CLOCK_HZ = 16_000_000
COUNTS_PER_TURN = 2048.0  # of the encoders, as four edges of each line
LINE_BYTES = 65536
MPU, MAG = 0, 1
MPU_READINGS, MAG_STATUS, MAG_ADJUSTMENT = 0x3B, 0x02, 0x10
# Of the ATmega2560, in its data memory: compare and control registers of timers 3 and 4.
OCR4, OCR3A, TCCR3A, TCCR4A = (0xA8, 0xAA, 0xAC), 0x98, 0x90, 0xA0
PORT_A, PORT_C, PORT_L = 0x22, 0x28, 0x10B
PWM_STEPS = 800
STATE_ENDED = (4, 5)  # simavr's cpu_Done and cpu_Crashed
BATTERY_DIVIDER, CURRENT_ZERO_MV, CURRENT_MV_PER_A = 11, 2500, 100
ESTOP, BUMPER = 0, 1  # of port L

_SIGNATURES: dict[str, tuple[list[object], object]] = {
    "new": ([ctypes.c_char_p, ctypes.c_char_p], ctypes.c_void_p),
    "free": ([ctypes.c_void_p], None),
    "turn": ([ctypes.c_void_p, ctypes.c_int, ctypes.c_double], None),
    "count": ([ctypes.c_void_p, ctypes.c_int], ctypes.c_double),
    "set_pin": ([ctypes.c_void_p, ctypes.c_char, ctypes.c_int, ctypes.c_int], None),
    "set_voltage": ([ctypes.c_void_p, ctypes.c_int, ctypes.c_int], None),
    "set_registers": (
        [ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_int], None,
    ),
    "get_register": ([ctypes.c_void_p, ctypes.c_int, ctypes.c_int], ctypes.c_int),
    "plug_imu": ([ctypes.c_void_p, ctypes.c_int], None),
    "read_data": ([ctypes.c_void_p, ctypes.c_int], ctypes.c_int),
    "time": ([ctypes.c_void_p], ctypes.c_double),
    "resets": ([ctypes.c_void_p], ctypes.c_uint32),
    "receive": ([ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int], ctypes.c_int),
    "send": ([ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int], ctypes.c_int),
    "waiting": ([ctypes.c_void_p], ctypes.c_int),
    "hang": ([ctypes.c_void_p], None),
    "reset": ([ctypes.c_void_p], None),
    "hold_sda": ([ctypes.c_void_p, ctypes.c_int], None),
    "run": ([ctypes.c_void_p, ctypes.c_uint64], ctypes.c_int),
}  # fmt: skip


def build_library(folder: Path) -> Path:
    """Compile the bench into a folder.

    Raises: RuntimeError: the compiler, or libsimavr-dev, are missing.
    """
    path = folder / "libavr_bench.so"
    command = ["cc", "-O2", "-shared", "-fPIC", str(SOURCE), "-o", str(path), "-lsimavr"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", "") or error
        raise RuntimeError(
            f"the bench of the firmware does not compile: {said}; apt-get install gcc libsimavr-dev"
        ) from error
    return path


def load_library(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    for name, (arguments, result) in _SIGNATURES.items():
        function = getattr(library, f"bench_{name}")
        function.argtypes, function.restype = arguments, result
    return library


class AvrBench:
    """One board with its firmware; wheels in the order of WHEEL_NAMES.

    It begins with a full battery, closed contacts, wheels at rest and an IMU that lies still.
    """

    def __init__(
        self, library: ctypes.CDLL, firmware: Path, counts_per_turn: float = COUNTS_PER_TURN,
        bootloader: Path | None = None,
    ) -> None:  # fmt: skip
        """Load a firmware, and the bootloader with which a reset begins; Intel hex files.

        Raises: RuntimeError: simavr cannot load a file.
        """
        self._library = library
        self._bench = library.bench_new(
            str(firmware).encode(), str(bootloader).encode() if bootloader else None
        )
        if not self._bench:
            words = f"{firmware} behind {bootloader}" if bootloader else f"{firmware}"
            raise RuntimeError(f"simavr cannot load {words}; build the firmware anew")
        self._buffer = ctypes.create_string_buffer(LINE_BYTES)
        self._counts_per_rad = counts_per_turn / 6.283185307179586
        self._cycles = 0.0
        self.set_estop(pressed=False)
        self.set_bumper(pressed=False)
        self.set_battery(24.0)
        self.set_currents((0.0, 0.0, 0.0, 0.0))
        self.set_imu((0.0, 0.0, 9.80665), (0.0, 0.0, 0.0))
        self.set_mag((2e-5, 0.0, -4e-5))

    @property
    def t_s(self) -> float:
        """How long the board has been running."""
        return float(self._library.bench_time(self._bench))

    @property
    def resets(self) -> int:
        """How often the board began anew."""
        return int(self._library.bench_resets(self._bench))

    @property
    def counts(self) -> tuple[int, ...]:
        """Edges that the encoders have made."""
        return tuple(int(self._library.bench_count(self._bench, k)) for k in range(4))

    @property
    def tool(self) -> int:
        """Bits of the tool's outputs."""
        return self._read(PORT_C)

    @property
    def is_lamp_on(self) -> bool:
        return bool(self._read(PORT_L) & 1 << 2)

    @property
    def duty_ratio(self) -> Four:
        """Share of the voltage that each motor gets, with its sign."""
        shares = []
        for wheel in range(4):
            control, compare = (TCCR3A, OCR3A) if wheel == 3 else (TCCR4A, OCR4[wheel])
            connect = 0x80 >> (0 if wheel == 3 else 2 * wheel)
            is_on = self._read(control) & connect
            steps = self._read(compare) | self._read(compare + 1) << 8
            sign = -1.0 if self._read(PORT_A) & 1 << wheel else 1.0
            shares.append(sign * steps / PWM_STEPS if is_on else 0.0)
        return shares[0], shares[1], shares[2], shares[3]

    def advance(self, dt_s: float, speed_radps: Sequence[float]) -> Four:
        """Run the board while the wheels turn so; gives the duty of the motors at the end.

        Raises: RuntimeError: the program ended, as it never does.
        """
        for wheel, speed in enumerate(speed_radps):
            self._library.bench_turn(self._bench, wheel, float(speed) * self._counts_per_rad)
        self._cycles += dt_s * CLOCK_HZ
        # Instructions are whole: what one slice took too much of, the next one has less.
        cycles = round(self._cycles - self.t_s * CLOCK_HZ)
        state = self._library.bench_run(self._bench, max(cycles, 0))
        if state in STATE_ENDED:
            raise RuntimeError(f"the firmware ended after {self.t_s:.3f} s (simavr state {state})")
        return self.duty_ratio

    def send(self, data: bytes) -> None:
        """Put bytes on the line to the board.

        Raises: RuntimeError: more than it takes before it runs again.
        """
        if self._library.bench_send(self._bench, data, len(data)) < len(data):
            raise RuntimeError(f"{len(data)} bytes are too many at once; advance in between")

    @property
    def waiting(self) -> int:
        """How many bytes on the line the board has not heard yet."""
        return int(self._library.bench_waiting(self._bench))

    def receive(self) -> bytes:
        """Take the bytes that the board has sent."""
        count = self._library.bench_receive(self._bench, self._buffer, LINE_BYTES)
        return self._buffer.raw[:count]

    def set_estop(self, *, pressed: bool) -> None:
        self._library.bench_set_pin(self._bench, b"L", ESTOP, int(pressed))

    def set_bumper(self, *, pressed: bool) -> None:
        self._library.bench_set_pin(self._bench, b"L", BUMPER, int(pressed))

    def set_battery(self, voltage_v: float) -> None:
        self._set_voltage(0, 1000.0 * voltage_v / BATTERY_DIVIDER)

    def set_currents(self, current_a: Sequence[float]) -> None:
        for wheel, amperes in enumerate(current_a):
            self._set_voltage(1 + wheel, CURRENT_ZERO_MV + CURRENT_MV_PER_A * amperes)

    def set_imu(self, accel_mps2: Vec3, gyro_radps: Vec3, temperature_c: float = 25.0) -> None:
        """Let the chip measure this in its own axes, at the ranges of the protocol."""
        counts = [
            *_count("accel_mps2", accel_mps2), round((temperature_c - 21.0) * 333.87),
            *_count("gyro_radps", gyro_radps),
        ]  # fmt: skip
        self._set_registers(MPU, MPU_READINGS, struct.pack(">7h", *counts))

    def set_mag(self, field_t: Vec3, adjustment: tuple[int, int, int] = (128, 128, 128)) -> None:
        """Let the magnetometer measure this, in the axes of the MPU.

        `adjustment` is the sensitivity in its fuse ROM, in its own axes; 128 means no correction.
        """
        x, y, z = _count("mag_t", field_t)
        own = (y, x, -z)
        raw = [round(256 * one / (128 + a)) for one, a in zip(own, adjustment, strict=True)]
        self._set_registers(MAG, MAG_STATUS, b"\x01" + struct.pack("<3h", *raw) + b"\x10")
        self._set_registers(MAG, MAG_ADJUSTMENT, bytes(adjustment))

    def plug_imu(self, *, is_there: bool) -> None:
        """Unplug the IMU or plug it in; then it begins as a chip does that gets its power."""
        self._library.bench_plug_imu(self._bench, int(is_there))

    def get_register(self, chip: int, which: int) -> int:
        """Get a register of the MPU or the MAG, as the program has set it."""
        return int(self._library.bench_get_register(self._bench, chip, which))

    def hang(self) -> None:
        """Let the program hang, its interrupts on, until it is reset."""
        self._library.bench_hang(self._bench)

    def reset(self) -> None:
        """Press the reset button, as opening the serial line does."""
        self._library.bench_reset(self._bench)

    def hold_sda(self, clocks: int) -> None:
        """Let the IMU hold the data line of the I2C bus low for `clocks` edges of its clock.

        So does a chip that was cut off in the middle of a byte.
        """
        self._library.bench_hold_sda(self._bench, clocks)

    def close(self) -> None:
        """Free the board. Safe to call twice."""
        if self._bench:
            self._library.bench_free(self._bench)
            self._bench = None

    def _read(self, address: int) -> int:
        return int(self._library.bench_read_data(self._bench, address))

    def _set_voltage(self, channel: int, voltage_mv: float) -> None:
        level_mv = min(max(round(voltage_mv), 0), 5000)
        self._library.bench_set_voltage(self._bench, channel, level_mv)

    def _set_registers(self, chip: int, first: int, data: bytes) -> None:
        self._library.bench_set_registers(self._bench, chip, first, data, len(data))


def _count(field: str, values: Vec3) -> list[int]:
    scale = next(f.wire.scale for f in list_fields(BoardImu) if f.name == field)
    return [min(max(round(value / scale), -32768), 32767) for value in values]
