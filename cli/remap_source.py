"""What the pictures of `fullsphere remap` are: --from, with the --scale and --crop that the user states."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from fullsphere.model.camera import Projection

Size = tuple[int, int]

_SIMPLE = 16  # denominators up to here make a ratio that somebody chose


class Scale(NamedTuple):
    """The pictures are as many times as wide and high as those that the camera was calibrated from."""

    factor: Fraction

    def __str__(self) -> str:
        return f"--scale {spelled(self.factor)}"


class Crop(NamedTuple):
    """The pictures are a rectangle of those that the camera was calibrated from."""

    left: int
    top: int
    width: int
    height: int

    def __str__(self) -> str:
        return f"--crop {self.left},{self.top},{self.width}x{self.height}"


Change = Scale | Crop


def scale(text: str) -> Scale:
    """The scale that `0.5` or `1/3` spells."""
    if not re.fullmatch(r"\d{1,9}(\.\d{0,12})?|\.\d{1,12}|\d{1,9}/\d{1,9}", text, re.ASCII):
        raise argparse.ArgumentTypeError(f"{text!r} is no scale such as 0.5 or 1/3")
    numerator, _, denominator = text.partition("/")
    if denominator and not int(denominator):
        raise argparse.ArgumentTypeError(f"{text!r} divides by zero")
    factor = Fraction(numerator) / Fraction(denominator or 1)
    if not Fraction(1, 1000) <= factor <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 1/1000 to 1000")
    return Scale(factor)


def crop(text: str) -> Crop:
    """The rectangle that `LEFT,TOP,WIDTHxHEIGHT` spells; left and top may be negative, where a border was added."""
    match = re.fullmatch(r"(-?\d{1,7}),(-?\d{1,7}),(\d{1,7})x(\d{1,7})", text, re.ASCII)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no rectangle LEFT,TOP,WIDTHxHEIGHT such as 120,0,3000x3000")
    return Crop(*map(int, match.groups()))


def changed(projection: Projection, changes: Sequence[Change], text: str) -> Projection:
    """The projection of pictures that were scaled and cropped, in that order of the changes.

    Raises
    ------
    UsageError
        If there are changes, and the projection is no camera; `text` is its spelling.
    CameraError
        If nothing is left of the pictures.
    """
    from fullsphere.model.camera import Camera
    from fullsphere.model.errors import UsageError

    for change in changes:
        if not isinstance(projection, Camera):
            raise UsageError(f"{change}: is for cameras; say in --from {text} itself how large the pictures are")
        if isinstance(change, Scale):
            projection = projection.scaled(float(change.factor))
        else:
            projection = projection.cropped(*change)
    return projection


def check_size(name: str, size: Size, source: Projection, text: str, changes: Sequence[Change]) -> None:
    """Make sure that a picture is of the size that its projection is for.

    Raises
    ------
    InputError
        If it is not; the message says both sizes and the --scale that would fit, if there is one.
    """
    from fullsphere.model.camera import Camera
    from fullsphere.model.errors import InputError

    if size == source.size:
        return
    stated = " ".join([text, *map(str, changes)])
    says = f"{name}: is {size[0]} x {size[1]} pixels, but --from {stated} is for {source.size[0]} x {source.size[1]}"
    if not isinstance(source, Camera):
        raise InputError(f"{says}; say the size of the pictures there")
    factor = None if changes else fitting_scale(source.size, size)
    if factor is not None:
        raise InputError(f"{says}; if it is such a picture scaled, add --scale {spelled(factor)}")
    if changes or size[0] > source.size[0] or size[1] > source.size[1]:
        raise InputError(f"{says}; is it of another camera?")
    raise InputError(f"{says}; if it is a part of such a picture, say which with --crop LEFT,TOP,{size[0]}x{size[1]}")


def fitting_scale(old: Size, new: Size) -> Fraction | None:
    """The factor that makes pictures of the size `old` ones of the size `new`, after rounding; None if none does.

    The simplest one where it is simple, because that is what somebody chose: a third of 4000 x 3000 is 1333 x 1000.
    """
    sides = list(zip(old, new, strict=True))
    least = max(Fraction(2 * n - 1, 2 * o) for o, n in sides)
    most = min(Fraction(2 * n + 1, 2 * o) for o, n in sides)
    if least > most:
        return None
    simple = (Fraction(math.ceil(least * below), below) for below in range(1, _SIMPLE + 1))
    long_old, long_new = max(sides)
    for factor in (*simple, Fraction(long_new, long_old), (least + most) / 2):
        if all(round(o * factor) == n for o, n in sides):
            return factor
    return None


def spelled(factor: Fraction) -> str:
    """The factor as `scale` reads it: short decimals as decimals, other simple ratios as ratios."""
    decimal = f"{float(factor):.12g}"
    if len(decimal) <= 6 and Fraction(decimal) == factor:
        return decimal
    return f"{factor.numerator}/{factor.denominator}"
