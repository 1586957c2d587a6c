"""The frames of a panorama one by one, for retouching: each remapped, and where it is the owner."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Projection
from fullsphere.model.positions import fast
from fullsphere.model.remap import Tile, tiles
from fullsphere.model.workers import ordered_map
from fullsphere.mosaic.compose import Band, compose, plan
from fullsphere.mosaic.planning import Plan
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.shares import Shares

_SIDE = 512


def layer_names(frames: Sequence[Frame]) -> list[str]:
    """A file name without ending for each frame: its picture's, with the circle's where two share one; all differ."""
    plain = []
    for frame in frames:
        part = frame.id.rpartition(":")[2] if frame.crop_px and ":" in frame.id else ""
        stem = Path(frame.image).stem
        plain.append(f"{stem}_{part}" if part else stem)
    return [name if plain.count(name) == 1 else f"{k + 1:03d}_{name}" for k, name in enumerate(plain)]


def alone(planned: Plan, k: int, executor: Executor | None = None) -> Plan:
    """The plan of a panorama of the registered frame number `k` alone: as bright, and as much shifted, as in all."""
    mosaic: Mosaic = dataclasses.replace(planned.mosaic, frames=(planned.mosaic.registered[k],), links=())
    shares = plan(mosaic, executor, "feather")
    if planned.shares.shifts:
        shares = dataclasses.replace(shares, shifts=(planned.shares.shifts[k],))
    return Plan(mosaic, shares, planned.exposure_ev)


def layer(
    planned: Plan,
    k: int,
    surface: Projection,
    dtype: type[np.uint8] | type[np.uint16] | type[np.float32],
    executor: Executor | None = None,
) -> Iterator[Band]:
    """The registered frame number `k` on a surface, evened out in exposure but not blended; bands as of `compose`."""
    own = alone(planned, k, executor)
    return compose(own.mosaic, surface, dtype, executor, own.shares, own.exposure_ev)


def ownership(shares: Shares, k: int, surface: Projection, executor: Executor | None = None) -> Iterator[Band]:
    """Where frame number `k` is the owner: bands (n, width, 1) uint8, 255 there and 0 elsewhere."""
    whole, (width, height) = fast(surface), surface.size

    def owned(tile: Tile) -> NDArray[np.uint8]:
        rows, columns = tile
        at = shares.sphere.project(whole.window_rays(columns, rows, np.float32), dtype=np.float32)
        return np.where(_owner(shares.owners, at) == k, 255, 0).astype(np.uint8)[..., None]

    across = -(-width // _SIDE)
    finished = ordered_map(executor, owned, tiles(surface.size, _SIDE), ahead=2 * across)
    for top in range(0, height, _SIDE):
        yield Band(top, np.concatenate([next(finished) for _ in range(across)], axis=1))


def _owner(owners: NDArray[np.int16], at: NDArray[np.float32]) -> NDArray[np.int16]:
    """The owner that has most of the four pixels around places (h, w, 2), each by how near it is; -1 for no place."""
    height, width = owners.shape
    nowhere = ~np.isfinite(at[..., 0])
    places = np.nan_to_num(at)
    left, up = np.floor(places[..., 0]).astype(np.intp), np.floor(places[..., 1]).astype(np.intp)
    x, y = places[..., 0] - left, places[..., 1] - up
    corners: list[tuple[NDArray[np.int16], NDArray[np.floating[Any]]]] = []
    for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (x if dx else 1 - x) * (y if dy else 1 - y)
        corners.append((owners[np.clip(up + dy, 0, height - 1), (left + dx) % width], weight))
    best, most = np.full(at.shape[:2], -1, np.int16), np.zeros(at.shape[:2], np.float32)
    for owner, _ in corners:
        has = np.sum([np.where(other == owner, weight, 0) for other, weight in corners], axis=0)
        better = has > most
        best[better], most[better] = owner[better], has[better]
    best[nowhere] = -1
    return best
