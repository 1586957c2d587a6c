"""The links of a mosaic.json, with their matches."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from fullsphere.model.camera import MAX_SIDE_PX
from fullsphere.model.errors import InputError
from fullsphere.model.json_values import demand_keys, list_of, numbers_of, object_of, text_of, whole_of
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.match_errors import held_out_px
from fullsphere.mosaic.project import Frame, Link, Mosaic
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.store_frames import rotation_of

_MATCHES = ("matches_px", "held_out_px")
_FIGURES = ("residual_px", "held_out_residual_px")  # said for people, and not read
_KEYS = ("frames", "matches", "verdict", "second_from_first", *_MATCHES)
_DECIMALS = 3  # of a pixel: a hundredth of what a keypoint is good to
_GATE = 12 / 1920  # of the longer side: held-out matches further off are of something else, as in `quality`
_MOST = 1 << 24
_NOWHERE = np.full((3, 3), np.nan)


def links_to_list(mosaic: Mosaic) -> list[dict[str, Any]]:
    """The links as a file holds them; residuals are those of the pixels as they are written."""
    rotations = np.array([_NOWHERE if f.camera_from_world is None else f.camera_from_world for f in mosaic.frames])
    rig = Rig.of(mosaic.frames)
    return [_link(_rounded(link), mosaic, rotations, rig) for link in mosaic.links]


def links_from_list(values: Sequence[Any], frames: Sequence[Frame], where: str) -> tuple[Link, ...]:
    """The links that the file `where` holds; raises InputError."""
    index = {frame.id: k for k, frame in enumerate(frames)}
    links: dict[tuple[int, int], Link] = {}
    for k, value in enumerate(values):
        place = f"{where}: links[{k}]"
        link = _read(object_of(value, place), index, place)
        if (link.i, link.j) in links:
            raise InputError(f"{place}: frames: these two are linked above already")
        links[link.i, link.j] = link
    return tuple(links.values())


def _link(link: Link, mosaic: Mosaic, rotations: FloatArray, rig: Rig) -> dict[str, Any]:
    value: dict[str, Any] = {
        "frames": [mosaic.frames[link.i].id, mosaic.frames[link.j].id],
        "matches": len(link.pixels_i),
        "verdict": link.verdict,
        "second_from_first": link.j_from_i,
    }
    for key, figure, (i, j) in zip(_MATCHES, _FIGURES, _both(link), strict=True):
        value[key] = np.hstack([i, j]).ravel()
        as_held = dataclasses.replace(link, held_i=i, held_j=j)
        residuals = held_out_px([as_held], rotations, mosaic.cameras, rig)
        residuals = residuals[residuals < _GATE * max(mosaic.frames[link.j].size)]
        value[figure] = round(float(np.median(residuals)), _DECIMALS) if residuals.size else None
    return value


def _both(link: Link) -> list[tuple[FloatArray, FloatArray]]:
    """The matches that fits may use, and those that no fit sees."""
    return [(link.pixels_i, link.pixels_j), (link.held_i, link.held_j)]


def _rounded(link: Link) -> Link:
    (i, j), (held_i, held_j) = (
        [np.round(pixels, _DECIMALS) + 0.0 for pixels in both]
        for both in _both(link)  # + 0: no negative zero
    )
    return dataclasses.replace(link, pixels_i=i, pixels_j=j, held_i=held_i, held_j=held_j)


def _read(data: dict[str, Any], index: dict[str, int], where: str) -> Link:
    demand_keys(data, where, _KEYS, _FIGURES)
    names = list_of(data, "frames", where)
    for name in names:
        if not isinstance(name, str) or name not in index:
            raise InputError(f"{where}: frames: {name!r} is the id of none")
    ends = [index[name] for name in names]
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise InputError(f"{where}: frames are not the id of two, in the order of the list of frames")
    used, held = (_pixels(data, key, where) for key in _MATCHES)
    if whole_of(data, "matches", where, 0, _MOST) != len(used):
        raise InputError(f"{where}: matches is {data['matches']}, but matches_px holds those of {len(used)}")
    return Link(
        i=ends[0],
        j=ends[1],
        pixels_i=used[:, :2],
        pixels_j=used[:, 2:],
        j_from_i=rotation_of(data, "second_from_first", where),
        held_i=held[:, :2],
        held_j=held[:, 2:],
        verdict=text_of(data, "verdict", where),
    )


def _pixels(data: dict[str, Any], key: str, where: str) -> FloatArray:
    numbers = np.array(numbers_of(data, key, where))
    if numbers.size % 4:
        raise InputError(f"{where}: {key} holds {numbers.size} numbers; a match has four")
    if (np.abs(numbers) > 2 * MAX_SIDE_PX).any():
        raise InputError(f"{where}: {key} holds a pixel that is in no picture")
    return numbers.reshape(-1, 4)
