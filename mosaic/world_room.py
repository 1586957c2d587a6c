"""A furnished room, painted by a random generator: the world of the demo and of the tests.

Straight edges run through every face, so that a break at a seam shows; every face has texture of all scales, so that
features are found in all directions, floor and ceiling included.  Metres; the camera stands at the origin, 1.45 m
above the floor.  World axes: x right, y down, z to the window wall.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from fullsphere.mosaic import world_walls
from fullsphere.mosaic.photographer import window
from fullsphere.mosaic.world_paint import Paint
from fullsphere.mosaic.world_panels import Panel, PanelScene

_LOW, _HIGH = np.array([-2.7, -1.3, -2.2]), np.array([2.5, 1.45, 2.7])  # corners of the room, metres
_CHEST = (np.array([-0.35, 0.72, 1.15]), np.array([1.25, 1.45, 1.95]))
_CABINET = (np.array([-2.7, 0.45, -0.2]), np.array([-2.2, 1.45, 1.7]))
_HALO = 2  # texels by which the pictures of an environment overlap, so that no edge of the cube shows

Painter = Callable[[np.random.Generator, tuple[int, int]], Paint]


def furnished_room(seed: int = 0, texel_mm: float = 3.2) -> PanelScene:
    """The room as textured rectangles; it can be seen from other places (`seen_from`), with true parallax."""
    random = np.random.default_rng(seed)
    walls: dict[str, Painter] = {
        "front": world_walls.window_wall,
        "right": world_walls.library_wall,
        "back": world_walls.brick_wall,
        "left": world_walls.gallery_wall,
        "down": world_walls.floor,
        "up": world_walls.timber_ceiling,
    }
    panels = [_face(random, _LOW, _HIGH, side, painter, texel_mm, inside=True) for side, painter in walls.items()]
    for (low, high), painter in ((_CHEST, world_walls.chest), (_CABINET, world_walls.cabinet)):
        panels += [_face(random, low, high, side, painter, texel_mm, inside=False) for side in _seen_sides(low, high)]
    return PanelScene(tuple(panels))


def environment(scene: PanelScene, face_px: int = 1280, executor: Executor | None = None) -> PanelScene:
    """What a scene looks like from its position, as six pictures of a cube round it.

    For a camera that only turns it is the same world, quicker, and free of the aliasing of far textures.  `face_px`
    texels span 90 degrees.
    """
    panels = []
    grown = (face_px + 2 * _HALO) / face_px
    for side in ("front", "right", "back", "left", "down", "up"):
        corner, across, down = _rectangle(np.full(3, -1.0), np.full(3, 1.0), side, inside=True)
        middle = corner + across / 2 + down / 2
        corner = middle + grown * (corner - middle)
        across, down = grown * across, grown * down
        picture = window(scene, corner, across, down, (face_px + 2 * _HALO,) * 2, executor=executor)
        panels.append(Panel(corner, across, down, picture))
    return PanelScene(tuple(panels))


def _rectangle(low: np.ndarray, high: np.ndarray, side: str, inside: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corner and sides of one face of a box, as its viewer inside (or outside) sees them upright."""
    axes = {  # right and down of one who looks at it from inside, facing the wall
        "front": ((1, 0, 0), (0, 1, 0)),
        "right": ((0, 0, -1), (0, 1, 0)),
        "back": ((-1, 0, 0), (0, 1, 0)),
        "left": ((0, 0, 1), (0, 1, 0)),
        "down": ((1, 0, 0), (0, 0, -1)),
        "up": ((1, 0, 0), (0, 0, 1)),
    }
    right, down = (np.array(a, float) for a in axes[side])
    outward = np.cross(right, down)
    middle, extent = (low + high) / 2, high - low
    centre = middle + outward * extent / 2
    if not inside:
        right = -right
    across, downward = right * extent, down * extent
    return centre - across / 2 - downward / 2, across, downward


def _face(
    random: np.random.Generator,
    low: np.ndarray,
    high: np.ndarray,
    side: str,
    painter: Painter,
    texel_mm: float,
    inside: bool,
) -> Panel:
    corner, across, down = _rectangle(low, high, side, inside)
    metres = np.abs(down).sum(), np.abs(across).sum()
    shape = (max(8, round(1000 * metres[0] / texel_mm)), max(8, round(1000 * metres[1] / texel_mm)))
    texture = painter(random, shape) * (_corner_shadow(shape) if inside else _side_light(side))
    return Panel(corner, across, down, np.clip(texture, 0.01, 1.0).astype(np.float32))


def _seen_sides(low: np.ndarray, high: np.ndarray) -> list[str]:
    """The faces of a box that the room's middle sees."""
    low_sides = [side for side, at in zip(("left", "up", "back"), low, strict=True) if at > 0]
    return low_sides + [side for side, at in zip(("right", "down", "front"), high, strict=True) if at < 0]


def _corner_shadow(shape: tuple[int, int]) -> Paint:
    """Light (h, w, 1) that falls off into the corners of a room."""
    reach = 0.28 * min(shape)
    y = np.minimum(np.arange(shape[0]) + 0.5, shape[0] - np.arange(shape[0]) - 0.5)
    x = np.minimum(np.arange(shape[1]) + 0.5, shape[1] - np.arange(shape[1]) - 0.5)
    level = (1 - 0.42 * np.exp(-y / reach))[:, None] * (1 - 0.42 * np.exp(-x / reach))[None, :]
    return np.asarray(level[..., None], np.float32)


def _side_light(side: str) -> float:
    return {"up": 1.15, "front": 0.75, "back": 0.55, "left": 0.7, "right": 0.65}.get(side, 0.6)
