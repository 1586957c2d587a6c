"""Projections as short texts: a surface, its size and what else describes it with colons between.

equirectangular:8192 for example, or perspective:1920x1080:hfov=90:yaw=30, or a camera.json.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fullsphere.model.camera import MAX_SIDE_PX, Camera, Projection
from fullsphere.model.cube_map import LAYOUTS, CubeMap
from fullsphere.model.errors import CameraError, UsageError
from fullsphere.model.lens import (
    Equidistant,
    Equisolid,
    FloatArray,
    Lens,
    Orthographic,
    Perspective,
    Stereographic,
    Thoby,
    angle_of_radius,
)
from fullsphere.model.projection_help import PROJECTIONS_HELP
from fullsphere.model.store import load_camera
from fullsphere.model.surface import (
    POLE_TO_POLE,
    WHOLE_CIRCLE,
    Cylindrical,
    Equirectangular,
    Mercator,
    Mosaic360,
    Range,
)
from fullsphere.model.yaw_pitch_roll import rotation_of_angles

__all__ = ["PROJECTIONS_HELP", "Placed", "parse_projection"]


class Placed(NamedTuple):
    """A projection and how it stands in the world: `world_from_projection` (3, 3) turns its rays into the world's."""

    projection: Projection
    world_from_projection: FloatArray


def parse_projection(text: str) -> Placed:
    """The projection that a text describes, in one of the spellings of `PROJECTIONS_HELP`.

    Raises
    ------
    UsageError
        If the text is none of them; names the part that is wrong.
    InputError
        If it names a camera.json that cannot be used.
    """
    file = re.fullmatch(r"(.*\.json)(?::(.*))?", text, re.DOTALL | re.IGNORECASE)
    try:
        if file:
            options = _Options([] if file[2] is None else file[2].split(":"))
            rotation = _rotation(options)
            options.check_all_taken("camera.json")
            return Placed(load_camera(Path(file[1])), rotation)
        word, *parts = text.split(":")
        if word not in _SURFACES:
            known = ", ".join(_SURFACES)
            raise UsageError(f"{word!r} is no surface{_meant(word, list(_SURFACES))}: use {known}, or a camera.json")
        if not parts or "=" in parts[0]:
            raise UsageError(f"it does not say how large the picture is, as {word}:{_EXAMPLES.get(word, '2048')} does")
        options = _Options(parts[1:])
        rotation = _rotation(options, pitch=-90.0 if word == "littleplanet" else 0.0)
        projection = _SURFACES[word](word, parts[0], options)
        options.check_all_taken(word)
    except (UsageError, CameraError) as error:
        raise UsageError(f"projection {text!r}: {error}") from error
    return Placed(projection, rotation)


_EXAMPLES = {"equirectangular": "8192", "perspective": "1920x1080", "cube": "1024", "360x360": "8192"}
_NUMBER = r"[+-]?(?:[0-9]{1,9}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})"
_TURNS = ("yaw", "pitch", "roll")
_PLANET_FIELD = math.radians(300)
_ENDLESS = 1e9  # focal lengths: a lens with such a radius at its last angle does not reach it in a picture
_ROUNDING = 1e-9


class _Options:
    """The parts key=value of a text; each is taken once, and what nobody took is refused."""

    def __init__(self, parts: list[str]) -> None:
        self._values: dict[str, str] = {}
        self._asked: list[str] = []
        for part in parts:
            key, equals, value = part.partition("=")
            if not equals:
                raise UsageError(f"{part!r} is not of the form name=value")
            if key in self._values:
                raise UsageError(f"{key}= stands there twice")
            self._values[key] = value

    def word(self, key: str) -> str | None:
        self._asked.append(key)
        return self._values.pop(key, None)

    def degrees(self, key: str) -> float | None:
        """An angle in radians."""
        value = self.word(key)
        return None if value is None else math.radians(_number(key, value))

    def interval(self, key: str) -> Range | None:
        """Two angles with .. between them, in radians."""
        value = self.word(key)
        if value is None:
            return None
        ends = re.fullmatch(rf"({_NUMBER})\.\.({_NUMBER})", value)
        if not ends:
            raise UsageError(f"{key}={value} are no two angles such as {key}=-20..25")
        return math.radians(float(ends[1])), math.radians(float(ends[2]))

    def check_all_taken(self, word: str) -> None:
        for key in self._values:
            known = ", ".join(f"{name}=" for name in sorted(set(self._asked), key=self._asked.index))
            raise UsageError(f"{key!r} says nothing of {word}{_meant(key, self._asked)}; it takes {known}")


def _number(key: str, value: str) -> float:
    if not re.fullmatch(_NUMBER, value):
        raise UsageError(f"{key}={value} is no angle in degrees such as {key}=30")
    return float(value)


def _meant(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word.lower(), list(known), 1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _rotation(options: _Options, pitch: float = 0.0) -> FloatArray:
    yaw, up, roll = (options.word(key) for key in _TURNS)
    angles = [
        0.0 if yaw is None else _number("yaw", yaw),
        pitch if up is None else _number("pitch", up),
        0.0 if roll is None else _number("roll", roll),
    ]
    if not any(angles):
        return np.eye(3)
    return rotation_of_angles(*angles)


def _sides(text: str) -> tuple[int, int | None]:
    """Width and height, or width alone."""
    found = re.fullmatch(r"([0-9]{1,9})(?:[xX]([0-9]{1,9}))?", text)
    if not found:
        raise UsageError(f"{text!r} is no size in pixels such as 1920x1080 or 2048")
    sides = (int(found[1]), None if found[2] is None else int(found[2]))
    for side in sides:
        if side is not None and not 1 <= side <= MAX_SIDE_PX:
            raise UsageError(f"a picture {text} px large: a side has 1 to {MAX_SIDE_PX} pixels")
    return sides


def _square(text: str) -> tuple[int, int]:
    width, height = _sides(text)
    return width, width if height is None else height


def _equirectangular(word: str, size: str, options: _Options) -> Projection:
    width, height = _sides(size)
    longitudes = options.interval("lon") or WHOLE_CIRCLE
    latitudes = options.interval("lat") or POLE_TO_POLE
    if height is None:
        if (longitudes, latitudes) == (WHOLE_CIRCLE, POLE_TO_POLE) and width % 2:
            raise UsageError(f"a full sphere {width} px wide has no whole half as its height: use an even width")
        across, up = longitudes[1] - longitudes[0], latitudes[1] - latitudes[0]
        height = max(1, round(width * up / across)) if across > 0 and up > 0 else 1  # else the surface refuses them
    return Equirectangular((width, height), longitudes, latitudes)


def _upright(word: str, size: str, options: _Options) -> Projection:
    surface: type[Cylindrical | Mercator] = Cylindrical if word == "cylindrical" else Mercator
    width, height = _sides(size)
    hfov = options.degrees("hfov")
    hfov = 2 * math.pi if hfov is None else hfov
    latitudes = options.interval("lat")
    if height is not None:
        return surface((width, height), hfov, latitudes)
    if latitudes is None:
        raise UsageError(f"how high the picture is does not follow: write {word}:{width}xHEIGHT, or add lat=-40..40")
    bottom, top = surface((width, 1), hfov, latitudes).heights
    return surface((width, max(1, round(width * (top - bottom) / hfov))), hfov, latitudes)


def _lens(word: str, size: str, options: _Options) -> Projection:
    picture = width, height = _square(size)
    across: dict[str, float] = {"hfov": width, "vfov": height, "dfov": math.hypot(width, height)}
    if word not in ("perspective", "littleplanet"):
        across["fov"] = min(picture)
    fields = {key: angle for key in across if (angle := options.degrees(key)) is not None}
    if word == "littleplanet" and not fields:
        fields = {"hfov" if width <= height else "vfov": _PLANET_FIELD}
    if len(fields) != 1:
        options.check_all_taken(word)
        given = f"; {' and '.join(fields)} are given" if fields else ""
        raise UsageError(f"it takes one field of view, {' or '.join(f'{key}=' for key in across)}{given}")
    [(key, field)] = fields.items()
    return _camera(_LENSES[word], key, field, across[key], picture)


def _camera(
    lens_of: Callable[[float], Lens], key: str, field: float, across_px: float, size: tuple[int, int]
) -> Camera:
    """The lens that images `field` (radians) over `across_px`, in the middle of the picture."""
    unit = lens_of(1.0)
    endless = float(unit.radius(unit.theta_max)) > _ENDLESS
    if not 0 < field <= 2 * unit.theta_max + _ROUNDING or (endless and field > 2 * unit.theta_max - _ROUNDING):
        limit = f"{'less than' if endless else 'at most'} {math.degrees(2 * unit.theta_max):.6g}"
        raise UsageError(
            f"{key}={math.degrees(field):.6g}: the {unit.projection} lens shows more than 0 and {limit} degrees"
        )
    half = min(field / 2, unit.theta_max)
    lens = lens_of(across_px / 2 / float(unit.radius(half)))
    if key != "fov":  # as far as the picture's corners, or as the lens shows anything
        corner = math.hypot(*size) / 2
        half = float(np.nan_to_num(angle_of_radius(lens, corner, lens.theta_max), nan=lens.theta_max))
    return Camera(lens, size, ((size[0] - 1) / 2, (size[1] - 1) / 2), half_fov=half)


def _cube(word: str, size: str, options: _Options) -> Projection:
    side, height = _sides(size)
    if height is not None:
        raise UsageError(f"{size!r} is not the side of a face, cube:1024 for example")
    layout = options.word("layout") or "3x2"
    if layout not in LAYOUTS:
        raise UsageError(f"layout={layout} is not one of {', '.join(LAYOUTS)}{_meant(layout, list(LAYOUTS))}")
    return CubeMap(side, layout)


def _mosaic(word: str, size: str, options: _Options) -> Projection:
    return Mosaic360(_square(size))


_LENSES: dict[str, Callable[[float], Lens]] = {
    "perspective": Perspective,
    "stereographic": Stereographic,
    "littleplanet": Stereographic,
    "equidistant": Equidistant,
    "equisolid": Equisolid,
    "orthographic": Orthographic,
    "thoby": Thoby,
}

_SURFACES: dict[str, Callable[[str, str, _Options], Projection]] = {
    "equirectangular": _equirectangular,
    "cylindrical": _upright,
    "mercator": _upright,
    **dict.fromkeys(_LENSES, _lens),
    "cube": _cube,
    "360x360": _mosaic,
}
