"""Colour profiles: how the codes of a picture stand for light, and which colours its red, green and blue are.

Profiles of three primaries and a tone curve (ICC.1:2022, 8.3.3, 10.6, 10.18) are understood: sRGB, Adobe RGB, Display
P3, ProPhoto and their like.  A profile made of tables is taken for sRGB.  It can be handed on from frames to what is
made of them all the same: only the light that frames are compared in is then not quite that of the scene.
"""

from __future__ import annotations

import dataclasses
import functools
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating[Any]]
Curve = Callable[[FloatArray], FloatArray]
"""Light, 0..1, of codes, 0..1."""

_XYZ_FROM_SRGB = np.array(  # D50, as ICC profiles count: IEC 61966-2-1 adapted after Bradford
    [[0.4360747, 0.3850649, 0.1430804], [0.2225045, 0.7168786, 0.0606169], [0.0139322, 0.0971045, 0.7141733]]
)
_SAME_CODE, _SAME_PRIMARIES = 0.001, 0.004  # a quarter of an 8 bit code; a hundredth of the way to Adobe RGB
_STEP_BACK = 1e-4  # where the two parts of a parametric curve, which are rounded, meet
_GRID = np.linspace(0, 1, 4097)
_FEWEST_BYTES, _MOST_BYTES, _MOST_TAGS = 132, 1 << 26, 1000
_PARAMETERS = {0: 1, 1: 3, 2: 4, 3: 5, 4: 7}  # of a parametric curve, by its kind


def srgb_curve(code: FloatArray) -> FloatArray:
    """The light of sRGB codes (IEC 61966-2-1)."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """The colour space of a picture with integer samples.

    Attributes
    ----------
    icc
        The profile as files hold it; empty for sRGB that is not written down.
    curve
        The light that codes stand for, in all channels.
    srgb_from_own
        (3, 3) takes light in the picture's own primaries to that in those of sRGB; white stays white.
    grey
        Whether it is for pictures of one channel.
    doubt
        Why it is taken for sRGB, in plain words; empty where it is understood.
    """

    icc: bytes = dataclasses.field(default=b"", repr=False)
    curve: Curve = srgb_curve
    srgb_from_own: FloatArray = dataclasses.field(default_factory=lambda: np.eye(3), repr=False)
    grey: bool = False
    doubt: str = ""

    @property
    def is_srgb(self) -> bool:
        """Whether codes mean what they mean in sRGB."""
        return self.curve is srgb_curve and bool((self.srgb_from_own == np.eye(3)).all())


SRGB = Profile()
"""What pictures without a profile are in."""


class _NotUnderstoodError(ValueError):
    """Nothing that is understood; says why."""


@functools.lru_cache(maxsize=64)
def profile_of(icc: bytes | None) -> Profile:
    """The colour space that an ICC profile describes; one not understood is taken for sRGB, with a `doubt`."""
    if not icc:
        return SRGB
    try:
        return _read(icc)
    except _NotUnderstoodError as error:
        return Profile(icc, doubt=str(error))
    except (struct.error, IndexError, ValueError, OverflowError):
        return Profile(icc, doubt="is damaged")


def _read(icc: bytes) -> Profile:
    if not _FEWEST_BYTES <= len(icc) <= _MOST_BYTES or icc[36:40] != b"acsp":
        raise _NotUnderstoodError("is damaged")
    space = icc[16:20]
    if space not in (b"RGB ", b"GRAY"):
        raise _NotUnderstoodError(f"is for {space.decode('ascii', 'replace').strip()}, not for RGB")
    tags = _tags(icc)
    names = (b"kTRC",) if space == b"GRAY" else (b"rTRC", b"gTRC", b"bTRC")
    if not all(name in tags for name in (*names, *((b"rXYZ", b"gXYZ", b"bXYZ") if len(names) == 3 else ()))):
        raise _NotUnderstoodError("is made of tables")
    curves = [_curve(tags[name]) for name in names]
    with np.errstate(all="ignore"):  # of damaged curves
        own = np.array([curve(_GRID) for curve in curves])
    if not (
        np.isfinite(own).all()
        and (np.maximum.accumulate(own, axis=1) - own).max() < _STEP_BACK
        and np.abs(own[:, -1] - 1).max() < 0.05
    ):
        raise _NotUnderstoodError("has a tone curve that does not rise from black to white")
    if np.abs(_srgb_codes(own) - _srgb_codes(own[len(own) // 2])).max() > _SAME_CODE:
        raise _NotUnderstoodError("has a tone curve of its own for each colour")
    curve = srgb_curve if np.abs(_srgb_codes(own) - _GRID).max() < _SAME_CODE else curves[len(curves) // 2]
    if space == b"GRAY":
        return Profile(icc, curve, grey=True)
    return Profile(icc, curve, _srgb_from(np.stack([_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")], -1)))


def _srgb_from(xyz_from_own: FloatArray) -> FloatArray:
    if not abs(np.linalg.det(xyz_from_own)) > 1e-4:
        raise _NotUnderstoodError("has primaries that are no three colours")
    srgb_from_own = np.linalg.solve(_XYZ_FROM_SRGB, xyz_from_own)
    white = srgb_from_own.sum(1, keepdims=True)
    if not (white > 0.1).all():
        raise _NotUnderstoodError("has primaries that make no white")
    found: FloatArray = (
        srgb_from_own / white
    )  # white stays white: primaries are rounded, and some are not adapted to D50
    return np.eye(3) if np.abs(found - np.eye(3)).max() < _SAME_PRIMARIES else found


def _tags(icc: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", icc, 128)
    if count > _MOST_TAGS:
        raise _NotUnderstoodError("is damaged")
    entries = [struct.unpack_from(">4sII", icc, 132 + 12 * k) for k in range(count)]
    return {name: icc[start : start + size] for name, start, size in entries}


def _xyz(tag: bytes) -> FloatArray:
    if tag[:4] != b"XYZ ":
        raise _NotUnderstoodError("is damaged")
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes) -> Curve:
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        values = np.array(struct.unpack_from(f">{count}H", tag, 12))
        if count == 0:
            return _gamma(1.0)
        return _gamma(float(values[0]) / 256) if count == 1 else _sampled(values / 65535)
    if tag[:4] == b"para":
        (kind,) = struct.unpack_from(">H", tag, 8)
        if kind not in _PARAMETERS:
            raise _NotUnderstoodError("has a tone curve of an unknown kind")
        return _parametric(kind, [v / 65536 for v in struct.unpack_from(f">{_PARAMETERS[kind]}i", tag, 12)])
    raise _NotUnderstoodError("has a tone curve of an unknown kind")


def _gamma(exponent: float) -> Curve:
    if not 0.1 < exponent < 10:
        raise _NotUnderstoodError("has a tone curve that does not rise from black to white")
    return lambda code: np.asarray(code) ** exponent


def _sampled(values: FloatArray) -> Curve:
    places = np.linspace(0, 1, len(values))
    return lambda code: np.interp(code, places, values)


def _parametric(kind: int, values: list[float]) -> Curve:
    """(a x + b)^g + e from x = d on, c x + f below; the kinds leave out some of them."""
    g, a, b, c, d, e, f = values[0], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind in (1, 2):
        a, b = values[1:3]
        d = -b / a if a != 0 else 0.0
        e = f = values[3] if kind == 2 else 0.0
    elif kind >= 3:
        a, b, c, d = values[1:5]
        e, f = values[5:] if kind == 4 else (0.0, 0.0)

    def curve(code: FloatArray) -> FloatArray:
        powered = np.maximum(a * np.asarray(code) + b, 0) ** g + e
        return np.where(code >= d, powered, c * np.asarray(code) + f)

    return curve


def _srgb_codes(light: FloatArray) -> FloatArray:
    light = np.maximum(light, 0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
