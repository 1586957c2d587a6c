"""The faces of the furnished room: every painter takes a random generator and a size (h, w) in texels.

They return linear light (h, w, 3) without the light of the room; the proportions suit the room of `world_room`.
"""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np

from fullsphere.mosaic import world_paint as paint
from fullsphere.mosaic.world_paint import Paint


def _hang(wall: Paint, picture: Paint, top: int, left: int, frame: int, colour: paint.Colour) -> None:
    """Put a framed picture on a wall, with the shadow it casts."""
    height, width = picture.shape[0] + 2 * frame, picture.shape[1] + 2 * frame
    shade = np.ones(wall.shape[:2], np.float32)
    shade[top + frame : top + height + frame, left + frame // 2 : left + width + frame // 2] = 0.6
    wall *= np.asarray(cv2.GaussianBlur(shade, (0, 0), frame / 2), np.float32)[..., None]
    wall[top : top + height, left : left + width] = colour
    wall[top + 2 : top + height // 2, left + 2 : left + frame // 3] = paint.rgb(*colour) * 1.5
    wall[top + frame : top + height - frame, left + frame : left + width - frame] = picture


def _trim(wall: Paint, random: np.random.Generator) -> None:
    """Cornice and skirting: bands along the top and bottom, with a shadow line each."""
    height, width = wall.shape[:2]
    band = max(4, height // 26)
    for top, sign in ((0, 1), (height - band, -1)):
        board = paint.wood(random, (band, width), (0.55, 0.5, 0.42))
        wall[top : top + band] = 0.35 * board + 0.65 * paint.rgb(0.55, 0.52, 0.47)
        edge = band if sign > 0 else height - band - 2
        wall[edge : edge + 2] *= 0.35
        groove = top + band // 2
        wall[groove : groove + 1] *= 0.5


def window_wall(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Two windows onto one landscape, with a picture between them."""
    height, width = shape
    wall = paint.plaster(random, shape, (0.50, 0.47, 0.38))
    view = paint.outdoors(random, shape)
    for left, right in ((0.07, 0.40), (0.60, 0.93)):
        _window(wall, view, slice(int(0.14 * height), int(0.70 * height)), slice(int(left * width), int(right * width)))
    art = paint.artwork(random, (int(0.27 * height), int(0.11 * width)))
    _hang(wall, art, int(0.24 * height), int(0.435 * width), max(3, width // 120), (0.10, 0.06, 0.03))
    _trim(wall, random)
    return wall


def _window(wall: Paint, view: Paint, rows: slice, columns: slice) -> None:
    """A window with two mullions and a transom, and its sill."""
    frame = max(3, (columns.stop - columns.start) // 22)
    white = paint.rgb(0.72, 0.71, 0.68)
    wall[rows.start - frame : rows.stop + frame, columns.start - frame : columns.stop + frame] = white * 0.9
    wall[rows, columns] = view[rows, columns]
    for part in (1 / 3, 2 / 3):
        at = int(columns.start + part * (columns.stop - columns.start))
        wall[rows, at - frame // 3 : at + frame // 3 + 1] = white
        wall[rows, at + frame // 3 + 1 : at + frame // 3 + 3] *= 0.45
    at = int(rows.start + 0.3 * (rows.stop - rows.start))
    wall[at - frame // 3 : at + frame // 3 + 1, columns] = white
    wall[at + frame // 3 + 1 : at + frame // 3 + 3, columns] *= 0.45
    sill = slice(rows.stop + frame, rows.stop + 3 * frame)
    wall[sill, columns.start - 2 * frame : columns.stop + 2 * frame] = white
    wall[sill.stop : sill.stop + frame, columns.start - 2 * frame : columns.stop + 2 * frame] *= 0.55


def library_wall(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Books from wall to wall, but for a door."""
    height, width = shape
    wall = paint.plaster(random, shape, (0.30, 0.36, 0.34))
    shelf = slice(int(0.05 * width), int(0.66 * width))
    rows = slice(int(0.07 * height), int(0.955 * height))
    wall[rows, shelf] = paint.bookshelf(random, (rows.stop - rows.start, shelf.stop - shelf.start), 7)
    _door(random, wall, slice(int(0.24 * height), height), slice(int(0.73 * width), int(0.91 * width)))
    art = paint.artwork(random, (int(0.10 * height), int(0.13 * width)))
    _hang(wall, art, int(0.075 * height), int(0.745 * width), max(3, width // 200), (0.35, 0.28, 0.12))
    keep = wall[:, shelf].copy()
    door = wall[:, int(0.71 * width) : int(0.93 * width)].copy()
    _trim(wall, random)
    wall[rows, shelf] = keep[rows]
    wall[height // 2 :, int(0.71 * width) : int(0.93 * width)] = door[height // 2 :]
    return wall


def _door(random: np.random.Generator, wall: Paint, rows: slice, columns: slice) -> None:
    """A wooden door of four panels in its frame."""
    height, width = rows.stop - rows.start, columns.stop - columns.start
    border = max(3, width // 14)
    wall[rows.start - border :, columns.start - border : columns.stop + border] = paint.rgb(0.50, 0.47, 0.42)
    leaf = paint.wood(random, (width, height), (0.30, 0.14, 0.06)).transpose(1, 0, 2).copy()
    for top, bottom in ((0.06, 0.45), (0.53, 0.93)):
        for left, right in ((0.12, 0.46), (0.54, 0.88)):
            cut = np.s_[int(top * height) : int(bottom * height), int(left * width) : int(right * width)]
            leaf[cut] *= 0.35
            inner = np.s_[
                int(top * height) + 5 : int(bottom * height) - 3, int(left * width) + 5 : int(right * width) - 3
            ]
            panel = leaf[inner]
            panel[:] = paint.wood(random, panel.shape[:2], (0.34, 0.17, 0.075))
    centre = (int(0.07 * width), int(0.50 * height))
    cv2.circle(leaf, centre, max(2, width // 26), (0.75, 0.6, 0.25), -1, cv2.LINE_AA)
    wall[rows, columns] = leaf


def brick_wall(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Bare bricks with a large painting and two small ones."""
    height, width = shape
    wall = paint.bricks(random, shape, int(0.047 * width), int(0.031 * height))
    for top, left, tall, wide in ((0.20, 0.34, 0.38, 0.30), (0.24, 0.10, 0.26, 0.13), (0.30, 0.75, 0.30, 0.12)):
        art = paint.artwork(random, (int(tall * height), int(wide * width)))
        _hang(wall, art, int(top * height), int(left * width), max(4, width // 110), (0.05, 0.045, 0.04))
    _trim(wall, random)
    return wall


def gallery_wall(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Plaster hung with pictures of many sizes."""
    height, width = shape
    wall = paint.plaster(random, shape, (0.40, 0.22, 0.16))
    left = 0.05
    while left < 0.86:
        wide = random.uniform(0.07, 0.15)
        top = random.uniform(0.09, 0.15)
        while top < 0.60:
            tall = random.uniform(0.13, 0.30)
            if top + tall > 0.76:
                break
            art = paint.artwork(random, (int(tall * height), int(wide * width)))
            colour = [(0.55, 0.42, 0.16), (0.06, 0.05, 0.045), (0.6, 0.58, 0.54)][int(random.integers(3))]
            _hang(wall, art, int(top * height), int(left * width), max(3, width // 140), colour)
            top += tall + random.uniform(0.06, 0.1)
        left += wide + random.uniform(0.035, 0.06)
    _trim(wall, random)
    return wall


def floor(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Planks, a rug, and sunlight from both windows."""
    height, width = shape
    floor = paint.planks(random, shape, height // 22, width // 3, (0.30, 0.165, 0.08))
    rug = paint.rug(random, (int(0.42 * height), int(0.50 * width)))
    _hang(floor, rug, int(0.36 * height), int(0.22 * width), max(4, width // 90), (0.42, 0.35, 0.24))
    sun = np.zeros(shape, np.float32)
    for left in (0.10, 0.61):
        for pane in range(3):
            x, gap = left + 0.105 * pane, 0.092
            corners = np.array([[x, 0.05], [x + gap, 0.05], [x + gap + 0.13, 0.40], [x + 0.13, 0.40]])
            cv2.fillPoly(sun, [(corners * [width, height]).astype(np.int32)], 1.0, cv2.LINE_AA)
    sun = np.asarray(cv2.GaussianBlur(sun, (0, 0), max(1.0, width / 500)), np.float32)
    return np.asarray(floor * (1 + sun[..., None] * paint.rgb(1.9, 1.6, 1.2)), np.float32)


def timber_ceiling(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Boards between heavy beams at uneven distances, with lamps."""
    height, width = shape
    ceiling = paint.planks(random, shape, height // 24, width // 3, (0.44, 0.29, 0.16))
    for at in (0.12, 0.30, 0.53, 0.70, 0.90):
        top, thick = int(at * height), int(0.034 * height)
        ceiling[top + thick : top + 2 * thick] *= np.linspace(0.45, 1, thick, dtype=np.float32)[:, None, None]
        ceiling[top : top + thick] = paint.wood(random, (thick, width), (0.13, 0.07, 0.035))
        ceiling[top : top + 2] *= 0.4
    for x, y in ((0.27, 0.22), (0.71, 0.41), (0.33, 0.62), (0.80, 0.80)):
        centre, size = (int(x * width), int(y * height)), max(4, width // 60)
        glow = np.hypot(np.arange(height)[:, None] - centre[1], np.arange(width)[None, :] - centre[0])
        ceiling *= (1 + 0.9 * np.exp(-glow / (4 * size))).astype(np.float32)[..., None]
        cv2.circle(ceiling, centre, size, (0.30, 0.28, 0.25), -1, cv2.LINE_AA)
        cv2.circle(ceiling, centre, int(0.75 * size), (1.0, 0.93, 0.78), -1, cv2.LINE_AA)
    return ceiling


def chest(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Broad reddish boards."""
    return paint.planks(random, shape, max(20, shape[0] // 5), 4 * shape[1], (0.36, 0.17, 0.065))


def cabinet(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """Drawers with round handles, of uneven width."""
    height, width = shape
    front = paint.wood(random, shape, (0.12, 0.17, 0.17))
    rows = np.linspace(0, height, 4).astype(int)
    edges = np.concatenate([[0.0], np.cumsum(random.uniform(0.7, 1.3, max(1, width // 130)))])
    columns = (edges / edges[-1] * width).astype(int)
    for top, bottom in itertools.pairwise(rows.tolist()):
        for left, right in itertools.pairwise(columns.tolist()):
            front[top : top + 3, left:right] *= 0.2
            front[top:bottom, left : left + 3] *= 0.2
            middle = ((left + right) // 2, (top + bottom) // 2)
            cv2.circle(front, middle, max(2, math.ceil(height / 45)), (0.7, 0.55, 0.25), -1, cv2.LINE_AA)
    return front
