"""A picture as PNG file, by zlib alone: rows without filter, which for curves and flat colours only cost time."""

from __future__ import annotations

import struct
import zlib

import numpy as np

_LEVEL = 3  # of zlib: beyond it twice the time for a tenth of the bytes
_INCH = 0.0254  # m


def png_of(rgba: np.ndarray, dpi: float) -> bytes:
    """Return the PNG file of an opaque picture (height, width, 4), uint8, without its alpha channel.  Local."""
    height, width = rgba.shape[:2]
    rows = np.zeros((height, 1 + 3 * width), dtype=np.uint8)  # a row begins with the number of its filter, 0: none
    rows[:, 1:].reshape(height, width, 3)[:] = rgba[..., :3]
    per_metre = round(dpi / _INCH)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in (
            (b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)),  # 8 bits, RGB
            (b"pHYs", struct.pack(">2IB", per_metre, per_metre, 1)),
            (b"IDAT", zlib.compress(rows.data, _LEVEL)),
            (b"IEND", b""),
        )
    )
