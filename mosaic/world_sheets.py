"""Worlds of printed sheets, flat or rolled into a tube, seen from one point."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.calibration.board import Artwork, Placement
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic import world_kernels

PAPER, INK = 0.8, 0.05
"""Reflectance of the paper and the ink."""

_BACKGROUND = 0.02
_TINT = np.array([1.02, 1.0, 0.95], np.float32)  # the light is a little warm
_DISC_SIDES = 128  # a polygon of the disc's area: its edge is right to 2e-4 of the radius


@dataclasses.dataclass(frozen=True, eq=False)
class Sheet:
    """A printed sheet.

    Attributes
    ----------
    placement
        Where its paper is in the world, mm.
    lower, upper
        Corners (2,) of the paper, mm.
    ink
        (h, w) uint8, 255 where ink covers the whole texel; its first texel's outer corner is at `lower`.
    texel_mm
        Side of a texel.
    lamp
        (5,) the light on it, see `world_kernels.see_sheets`.
    """

    placement: Placement
    lower: tuple[float, float]
    upper: tuple[float, float]
    ink: NDArray[np.uint8]
    texel_mm: float
    lamp: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class SheetScene:
    """Sheets seen from `position` (3,), mm; they hide each other, their backs are blank, around them it is dark."""

    sheets: tuple[Sheet, ...]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def seen_from(self, position: ArrayLike) -> SheetScene:
        """The same sheets from another place (3,)."""
        x, y, z = np.asarray(position, float).tolist()
        seen = dataclasses.replace(self, position=(x, y, z))
        seen.__dict__["_printed"] = self._printed  # the largest array, shared
        return seen

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        """Linear light (..., 3) that arrives along world rays (..., 3) of any length; 0 for a NaN ray."""
        given = np.ascontiguousarray(rays, np.float64)
        light = np.empty(given.shape[:-1], np.float32)
        world_kernels.see_sheets(
            *(given.reshape(-1, 3), *self._places, *self._printed, _BACKGROUND, light.reshape(-1)),
        )
        return np.asarray(light[..., None] * _TINT, np.float32)

    @cached_property
    def _places(self) -> tuple[Any, ...]:
        """turn, place, radius of the kernel."""
        poses = np.array([sheet.placement.target_from_board for sheet in self.sheets]).reshape(-1, 4, 4)
        turn = np.ascontiguousarray(poses[:, :3, :3].transpose(0, 2, 1))
        place = np.einsum("mij,mj->mi", turn, np.asarray(self.position) - poses[:, :3, 3])
        return turn, place, np.array([sheet.placement.radius_mm for sheet in self.sheets], float)

    @cached_property
    def _printed(self) -> tuple[Any, ...]:
        """paper, texel, ink, shape, first, tones, lamps of the kernel."""
        sizes = [sheet.ink.size for sheet in self.sheets]
        return (
            np.array([[*sheet.lower, *sheet.upper] for sheet in self.sheets], float).reshape(-1, 4),
            np.array([sheet.texel_mm for sheet in self.sheets], float),
            np.concatenate([np.zeros(0, np.uint8), *(sheet.ink.ravel() for sheet in self.sheets)]),
            np.array([sheet.ink.shape for sheet in self.sheets], np.int64).reshape(-1, 2),
            np.cumsum([0, *sizes])[:-1].astype(np.int64),
            np.array([PAPER, INK]),
            np.array([sheet.lamp for sheet in self.sheets], float).reshape(-1, 5),
        )


def inked(artwork: Artwork, texel_mm: float) -> NDArray[np.uint8]:
    """How much of each texel (h, w) ink covers, 0 to 255; exact, so that edges between texels are not moved."""
    width, height = (max(2, math.ceil(s / texel_mm - 1e-6)) for s in np.subtract(artwork.upper, artwork.lower))
    outlines = [_clockwise(np.asarray(polygon, float)) for polygon in artwork.polygons] + _rounds(artwork.discs)
    vertices = (np.concatenate([np.zeros((0, 2)), *outlines]) - artwork.lower) / texel_mm
    nearest = np.rint(vertices)
    vertices = np.where(np.abs(vertices - nearest) < 1e-6, nearest, vertices)
    starts = np.cumsum([0, *(len(outline) for outline in outlines)]).astype(np.int64)
    covered = np.zeros((height, width + 1), np.float32)
    world_kernels.add_outlines(vertices, starts, covered)
    np.cumsum(covered, axis=1, out=covered)
    return np.asarray(np.rint(np.clip(covered[:, :-1], 0.0, 1.0) * 255.0), np.uint8)


def _rounds(discs: FloatArray) -> list[FloatArray]:
    turn = np.arange(_DISC_SIDES) * (2 * math.pi / _DISC_SIDES)
    sector = 2 * math.pi / _DISC_SIDES
    corner = math.sqrt(sector / math.sin(sector)) * np.stack([np.cos(turn), np.sin(turn)], -1)
    return [np.array([x, y]) + radius * corner for x, y, radius in np.asarray(discs, float)]


def _clockwise(polygon: FloatArray) -> FloatArray:
    """The polygon (k, 2) so that its area is positive: with y down, clockwise to the eye."""
    x, y = polygon.T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return polygon if area >= 0 else polygon[::-1]
