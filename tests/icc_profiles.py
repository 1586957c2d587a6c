"""ICC profiles of three primaries and tone curves, made by the letter of ICC.1:2022."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
P3 = ((0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407))
PROPHOTO = ((0.79767, 0.28804, 0.0), (0.13519, 0.71188, 0.0), (0.03134, 0.00009, 0.82491))
SRGB = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.7141))
"""Red, green and blue as XYZ of D50."""

SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def gamma(exponent: float) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(exponent * 256))


def sampled(values: NDArray[np.floating[Any]] | Sequence[float]) -> bytes:
    codes = np.round(np.array(values) * 65535).astype(int)
    return b"curv" + bytes(4) + struct.pack(f">I{len(codes)}H", len(codes), *codes)


def parametric(kind: int, values: Sequence[float]) -> bytes:
    return b"para" + bytes(4) + struct.pack(">HH", kind, 0) + _fixed(values)


def profile(
    primaries: Sequence[Sequence[float]], *curves: bytes, space: bytes = b"RGB ", version: int = 0x04200000
) -> bytes:
    """A profile; one curve is that of all channels."""
    white = (0.9642, 1.0, 0.8249)
    tags = {b"wtpt": _xyz(white), b"cprt": b"mluc" + struct.pack(">III", 0, 0, 12), b"desc": _text("made for a test")}
    if space == b"GRAY":
        tags[b"kTRC"] = curves[0]
    else:
        tags |= {name: _xyz(own) for name, own in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries, strict=True)}
        each = curves * 3 if len(curves) == 1 else curves
        tags |= dict(zip((b"rTRC", b"gTRC", b"bTRC"), each, strict=True))
    return assembled(tags, space, version)


def assembled(tags: dict[bytes, bytes], space: bytes = b"RGB ", version: int = 0x04200000) -> bytes:
    start = 132 + 12 * len(tags)
    table, body = struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        table += name + struct.pack(">II", start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI4s4s4s", start + len(body), bytes(4), version, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + _fixed((0.9642, 1.0, 0.8249))
    return head + bytes(128 - len(head)) + table + body


def _fixed(values: Sequence[float]) -> bytes:
    return b"".join(struct.pack(">i", round(value * 65536)) for value in values)


def _xyz(values: Sequence[float]) -> bytes:
    return b"XYZ " + bytes(4) + _fixed(values)


def _text(text: str) -> bytes:
    data = text.encode("utf-16-be")
    return b"mluc" + struct.pack(">III2s2sII", 0, 1, 12, b"en", b"US", len(data), 28) + data
