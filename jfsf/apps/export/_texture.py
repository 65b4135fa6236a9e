"""The checker, as a PNG."""

import struct
import zlib

import numpy as np

SIDE = 128  # pixels of a square
_LIGHT, _DARK = 255, 140


def checker() -> bytes:
    """A PNG of one period: two by two squares, white and grey, which tint colours."""
    square = np.add.outer(np.arange(2), np.arange(2)) % 2
    pixels = np.kron(np.where(square, _DARK, _LIGHT), np.ones((SIDE, SIDE)))
    return _png(pixels.astype(np.uint8))


def _png(grey):
    # Without Pillow, which is not among the core packages.
    high, wide = grey.shape
    lines = np.pad(grey, ((0, 0), (1, 0))).tobytes()  # each after its filter, 0
    # 8 bits of grey, without interlace.
    header = struct.pack(">IIBBBBB", wide, high, 8, 0, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data))
        + kind
        + data
        + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
