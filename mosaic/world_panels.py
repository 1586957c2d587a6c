"""Worlds built of flat textured rectangles, seen from one point."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic import world_kernels

Light = NDArray[np.float32]
"""Linear light (..., 3), about 0.01 to 1."""

_PAD = 2  # texels of repeated border round each texture in the atlas, so that interpolation never sees a neighbour
_ROW = 8192  # cv2.remap refuses sides of 32767 and more: rays are looked up as rows of this length


@dataclasses.dataclass(frozen=True, eq=False)
class Panel:
    """A textured rectangle.

    `corner` is the place of the outer corner of the texture's first texel, `across` and `down` (3,) are the sides along
    the texture's rows and columns, all in the world frame and one unit of length; `texture` (h, w, 3) is linear light.
    """

    corner: FloatArray
    across: FloatArray
    down: FloatArray
    texture: Light


class _Atlas(NamedTuple):
    """All textures in one picture, and how rays find their way into it (see `world_kernels.meet_panels`)."""

    picture: Light
    texel_from_ray: FloatArray
    sizes: FloatArray
    corners: FloatArray
    miss: tuple[float, float]


@dataclasses.dataclass(frozen=True, eq=False)
class PanelScene:
    """Panels seen from `position` (3,), in their unit of length; `background` is seen where there is none."""

    panels: tuple[Panel, ...]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    background: tuple[float, float, float] = (0.02, 0.02, 0.02)

    def seen_from(self, position: ArrayLike) -> PanelScene:
        """The same panels from another place (3,)."""
        x, y, z = np.asarray(position, float).tolist()
        moved = dataclasses.replace(self, position=(x, y, z))
        moved.__dict__["_atlas"] = self._atlas._replace(texel_from_ray=moved._homographies())  # textures stay the same
        return moved

    def radiance(self, rays: ArrayLike) -> Light:
        """Linear light (..., 3) that arrives along world rays (..., 3) of any length; 0 for a NaN ray."""
        given = np.ascontiguousarray(rays, np.float64)
        flat = given.reshape(-1, 3)
        length = min(_ROW, max(1, len(flat)))
        rows = -(-len(flat) // length)
        map_u, map_v = np.full((2, rows * length), -10.0, np.float32)
        atlas = self._atlas
        world_kernels.meet_panels(
            flat, atlas.texel_from_ray, atlas.sizes, atlas.corners, *atlas.miss, map_u[: len(flat)], map_v[: len(flat)]
        )
        if not len(flat):
            return np.zeros(given.shape, np.float32)
        light = cv2.remap(
            atlas.picture,
            map_u.reshape(rows, length),
            map_v.reshape(rows, length),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,  # no light outside the atlas, where the kernel sends NaN rays
        )
        return np.asarray(light, np.float32).reshape(-1, 3)[: len(flat)].reshape(given.shape)

    def distance(self, rays: ArrayLike) -> FloatArray:
        """How far along world rays (..., 3) the first panel is met (...), in lengths of the ray; infinite for none."""
        given = np.asarray(rays, float)
        nearest = np.zeros(given.shape[:-1])
        for (width, height), homography in zip(self._atlas.sizes, self._atlas.texel_from_ray, strict=True):
            u, v, near = np.moveaxis(given @ homography.T, -1, 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                inside = (near > 0) & (np.abs(u / near + 0.5 - width / 2) <= width / 2)
                inside &= np.abs(v / near + 0.5 - height / 2) <= height / 2
            nearest = np.where(inside, np.maximum(nearest, near), nearest)
        with np.errstate(divide="ignore"):
            return np.asarray(1 / nearest)

    @cached_property
    def _atlas(self) -> _Atlas:
        """Textures one below the other, the background below all of them."""
        heights = [p.texture.shape[0] + 2 * _PAD for p in self.panels]
        tops = np.concatenate([[0], np.cumsum(heights)]).astype(int)
        width = max([p.texture.shape[1] for p in self.panels], default=1) + 2 * _PAD
        picture = np.zeros((tops[-1] + 4, width, 3), np.float32)
        picture[tops[-1] :] = np.array(self.background, np.float32)
        for panel, top, height in zip(self.panels, tops[:-1], heights, strict=True):
            padded = np.pad(panel.texture, ((_PAD, _PAD), (_PAD, _PAD), (0, 0)), mode="edge")
            picture[top : top + height, : padded.shape[1]] = padded
        return _Atlas(
            picture,
            self._homographies(),
            np.array([p.texture.shape[1::-1] for p in self.panels], float).reshape(-1, 2),
            np.stack([np.full(len(self.panels), float(_PAD)), tops[:-1] + float(_PAD)], -1),
            (1.5, tops[-1] + 1.5),
        )

    def _homographies(self) -> FloatArray:
        """Those of all panels (n, 3, 3)."""
        return np.array([_texel_from_ray(p, np.asarray(self.position)) for p in self.panels]).reshape(-1, 3, 3)


def _texel_from_ray(panel: Panel, position: FloatArray) -> FloatArray:
    """The homography (3, 3) from rays at `position` to texels, scaled so that its last value is 1/distance.

    A point of the panel is  position + t ray = corner + s across + e down,  so (s, e, 1)/t = [across down corner']^-1
    ray with corner' = corner - position.  A position in the panel's plane sees nothing of it.
    """
    h, w = panel.texture.shape[:2]
    basis = np.stack([panel.across, panel.down, np.asarray(panel.corner) - position], -1)
    if abs(np.linalg.det(basis)) < 1e-12 * np.prod(np.linalg.norm(basis, axis=0)):
        return np.zeros((3, 3))
    texels = np.array([[w, 0, -0.5], [0, h, -0.5], [0, 0, 1.0]])
    return np.asarray(texels @ np.linalg.inv(basis), float)
