"""Changes to a file, drawn from a seed: bytes, lines and numbers, lost or others."""

import struct

import numpy as np
from fuzz_formats import Format


def damaged(form: Format, seed: int) -> bytes:
    """The file with one to three changes, all drawn from the seed."""
    rng = np.random.default_rng(seed)
    if form.parts is None or rng.random() < 0.3:
        return _changed(form.data, rng)
    parts, join = form.parts(form.data)
    at = rng.integers(len(parts))
    parts[at] = _changed(parts[at], rng)
    return join(parts)


def _changed(data: bytes, rng) -> bytes:
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        change = CHANGES[rng.integers(len(CHANGES))]
        # Damage in headers does most.
        end = len(data) if rng.random() < 0.5 else min(len(data), 300)
        data = change(data, end, rng)
    return data


def _place(end, rng, most=64):
    at = int(rng.integers(end))
    return at, at + int(rng.integers(1, most))


def _flip(data, end, rng):
    at, _ = _place(end, rng)
    return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]


def _byte(data, end, rng):
    at, _ = _place(end, rng)
    new = (0, 255, 32, 10, int(rng.integers(256)))[rng.integers(5)]
    return data[:at] + bytes([new]) + data[at + 1 :]


def _cut(data, end, rng):
    return data[: rng.integers(end)]


def _lose(data, end, rng):
    at, stop = _place(end, rng)
    return data[:at] + data[stop:]


def _repeat(data, end, rng):
    at, stop = _place(end, rng)
    return data[:stop] + data[at:]


def _splice(data, end, rng):
    at, stop = _place(len(data), rng)
    to, _ = _place(end, rng)
    return data[:to] + data[at:stop] + data[to + stop - at :]


def _noise(data, end, rng):
    at, stop = _place(end, rng, 16)
    return data[:at] + rng.bytes(stop - at) + data[at:]


def _lose_line(data, end, rng):
    lines = data.splitlines(keepends=True)
    at = int(rng.integers(len(lines[:20] if end < len(data) else lines) or 1))
    return b"".join(lines[:at] + lines[at + 1 :])


NUMBERS = b"nan inf -inf -1 0 1 3 1e999 -1e30 1.5 2147483648 -2147483649 100000000 1e9"
NUMBERS = [*NUMBERS.split(), b"9" * 20, b"9" * 400, b"null", b"[]", b'"a"', b"", b"1_0"]


def _number(data, end, rng):
    """A number in text becomes another."""
    at, _ = _place(end, rng)
    digits = b"0123456789.+-eE"
    while at < len(data) and data[at] not in digits:
        at += 1
    stop = at
    while at > 0 and data[at - 1] in digits:
        at -= 1
    while stop < len(data) and data[stop] in digits:
        stop += 1
    return data[:at] + NUMBERS[rng.integers(len(NUMBERS))] + data[stop:]


WORDS = [
    *(struct.pack("<f", x) for x in (np.nan, np.inf, -1e38, 1e-40)),
    *(struct.pack("<I", x) for x in (0, 1, 0x7FA00000, 2**31, 2**32 - 1, 10**9)),
    *(struct.pack("<d", x) for x in (np.nan, 1e308, -0.5)),
    *(struct.pack("<Q", x) for x in (2**63, 2**64 - 1, 2**40)),
]


def _word(data, end, rng):
    """A number in binary becomes another."""
    at = int(rng.integers(end)) // 4 * 4
    word = WORDS[rng.integers(len(WORDS))]
    return data[:at] + word + data[at + len(word) :]


CHANGES = [_flip, _byte, _cut, _lose, _repeat, _splice, _noise, _lose_line]
CHANGES += [_number] * 4 + [_word] * 3
