"""Build the firmware: `python firmware/build.py [FOLDER]`, by default into firmware/prebuilt.

Needs `apt-get install gcc-avr binutils-avr avr-libc arduino-core-avr`; the same sources and the
same compiler give the same bytes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

FIRMWARE = Path(__file__).parent
PREBUILT = FIRMWARE / "prebuilt"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
# What an Arduino Mega 2560 is sold with; the program is behind it.
BOOTLOADER = ARDUINO / "bootloaders" / "stk500v2" / "stk500boot_v2_mega2560.hex"
CORE, WIRE = ARDUINO / "cores" / "arduino", ARDUINO / "libraries" / "Wire" / "src"
FLAGS = ("-mmcu=atmega2560", "-DF_CPU=16000000UL", "-Os", "-ffunction-sections", "-fdata-sections")
STRICT = ("-Wall", "-Wextra", "-Werror")
OF_ARDUINO = (
    "-DARDUINO=10819", "-DARDUINO_AVR_MEGA2560", "-DARDUINO_ARCH_AVR", "-w",
    f"-I{CORE}", f"-I{ARDUINO / 'variants' / 'mega'}", f"-I{WIRE}", f"-I{WIRE / 'utility'}",
)  # fmt: skip
# The compiler of Debian 12 does not know a macro that its own library wants.
CPP = ("-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics",
       "-DDECIMAL_DIG=__DECIMAL_DIG__")  # fmt: skip


def build_motor_board(folder: Path, defines: Sequence[str] = ()) -> Path:
    """Build the motor board's program; gives its hex file.

    Raises: subprocess.CalledProcessError: it does not compile.
    """
    sources = sorted((FIRMWARE / "motor_board").glob("*.c"))
    elf = folder / "motor_board.elf"
    _run("avr-gcc", *FLAGS, *STRICT, "-std=gnu11", *defines, *sources, "-Wl,--gc-sections",
         "-o", elf)  # fmt: skip
    return _write_hex(elf)


def build_imu_board(folder: Path, defines: Sequence[str] = ()) -> Path:
    """Build the IMU board's sketch with Arduino's core; gives its hex file.

    Raises: subprocess.CalledProcessError: it does not compile.
    """
    c_sources = [*sorted(CORE.glob("*.c")), WIRE / "utility" / "twi.c"]
    cpp_sources = [*sorted(CORE.glob("*.cpp")), WIRE / "Wire.cpp"]
    sketch = FIRMWARE / "imu_board" / "imu_board.ino"
    elf = folder / "imu_board.elf"
    with tempfile.TemporaryDirectory() as objects:
        flags = (*FLAGS, *OF_ARDUINO)
        _run("avr-gcc", *flags, "-std=gnu11", "-c", *c_sources, cwd=objects)
        _run("avr-gcc", *flags, "-x", "assembler-with-cpp", "-c", *sorted(CORE.glob("*.S")),
             cwd=objects)  # fmt: skip
        _run("avr-g++", *flags, *CPP, "-c", *cpp_sources, cwd=objects)
        _run("avr-g++", *flags, *CPP, *defines, "-x", "c++", "-c", sketch, cwd=objects)
        _run("avr-gcc", *FLAGS, *sorted(Path(objects).glob("*.o")), "-Wl,--gc-sections", "-lm",
             "-o", elf)  # fmt: skip
    return _write_hex(elf)


def _write_hex(elf: Path) -> Path:
    hex_file = elf.with_suffix(".hex")
    _run("avr-objcopy", "-O", "ihex", "-R", ".eeprom", elf, hex_file)
    return hex_file


def _run(*words: str | Path, cwd: str | None = None) -> None:
    subprocess.run([str(word) for word in words], cwd=cwd, check=True)


def main(words: Sequence[str]) -> None:
    folder = Path(words[0]) if words else PREBUILT
    folder.mkdir(parents=True, exist_ok=True)
    for hex_file in (build_motor_board(folder), build_imu_board(folder)):
        hex_file.with_suffix(".elf").unlink()
        sys.stdout.write(f"{hex_file}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
