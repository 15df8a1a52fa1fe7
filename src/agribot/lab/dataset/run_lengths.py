"""Instance masks as run lengths in COCO's compressed form."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

LONGEST_COUNT_BITS = 40
Ints = npt.NDArray[np.integer]


def instance_run_lengths(instance: Ints) -> dict[int, str]:
    """Compress the run lengths of every value above 0 in an instance mask (height, width)."""
    line = np.asarray(instance).ravel(order="F").astype(np.int64)
    edges = np.flatnonzero(np.diff(line)) + 1
    first = np.concatenate([[0], edges])
    last = np.concatenate([edges, [line.size]])
    value = line[first]
    order = np.argsort(value, kind="stable")
    order = order[value[order] > 0]
    if not order.size:
        return {}  # np.split makes one part of nothing
    names, starts = np.unique(value[order], return_index=True)
    codes = {}
    for name, runs in zip(names.tolist(), np.split(order, starts[1:]), strict=True):
        codes[name] = compress(_count_runs(first[runs], last[runs], line.size))
    return codes


def _count_runs(first: Ints, last: Ints, size: int) -> list[int]:
    """Count background, plant, background and so on, from the first pixel to the last."""
    bounds = np.stack([first, last], axis=1).ravel()
    counts: list[int] = np.diff(np.concatenate([[0], bounds, [size]])).tolist()
    return counts if counts[-1] else counts[:-1]


def compress(counts: list[int]) -> str:
    """Encode five bits in a character; the sixth says that more follow.

    From the fourth number on it is the difference to the last but one.
    """
    text = bytearray()
    for index, count in enumerate(counts):
        value = count - counts[index - 2] if index > 2 else count
        while True:
            bits = value & 31
            value >>= 5
            is_last = value == (-1 if bits & 16 else 0)
            text.append(48 + (bits if is_last else bits | 32))
            if is_last:
                break
    return text.decode("ascii")


def decompress(text: str) -> list[int]:
    """Decode what `compress` encodes; what was cut off gives too few counts.

    Raises: ValueError: a letter that it does not write, or a count that no picture has.
    """
    counts: list[int] = []
    value = shift = 0
    for letter in text:
        bits = ord(letter) - 48
        if not 0 <= bits < 64 or shift > LONGEST_COUNT_BITS:
            raise ValueError(f"'{letter}' is no part of a count of pixels")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        value = shift = 0
    return counts
