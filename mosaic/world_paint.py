"""Materials for synthetic worlds: textures in linear light (h, w, 3), made from a random generator and no files.

Nothing repeats: a repeated pattern would be matched with itself in the wrong place.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Paint = NDArray[np.float32]
Colour = tuple[float, float, float]

_WOOD: Colour = (0.32, 0.17, 0.075)
_PIGMENTS = np.array(
    [
        (0.045, 0.075, 0.26),  # ultramarine
        (0.50, 0.31, 0.08),  # ochre
        (0.27, 0.10, 0.045),  # sienna
        (0.74, 0.67, 0.51),  # cream
        (0.14, 0.16, 0.06),  # olive
        (0.05, 0.18, 0.19),  # teal
        (0.36, 0.055, 0.04),  # madder
        (0.03, 0.03, 0.035),  # charcoal
        (0.34, 0.46, 0.56),  # pale blue
        (0.53, 0.30, 0.24),  # rose
        (0.24, 0.24, 0.23),  # grey
    ]
)


def pigments(random: np.random.Generator, count: int) -> Paint:
    """Colours (count, 3) that painters and bookbinders would use, each mixed a little differently."""
    chosen = _PIGMENTS[random.permutation(len(_PIGMENTS))[np.arange(count) % len(_PIGMENTS)]]
    mixed = chosen * np.exp(random.normal(0, 0.18, (count, 1)) + random.normal(0, 0.07, (count, 3)))
    return np.asarray(np.clip(mixed, 0.012, 0.9), np.float32)


def noise(random: np.random.Generator, shape: tuple[int, int], coarse: float, fine: float = 2.0) -> Paint:
    """Grey noise (h, w) of unit deviation with details of `coarse` down to `fine` texels, each octave half as strong.

    `coarse` counts along the rows; a texture stretched along x is made by resizing.
    """
    height, width = shape
    total = np.zeros(shape, np.float32)
    size, strength = coarse, 1.0
    while size >= fine:
        grid = (max(2, round(height / size) + 1), max(2, round(width / size) + 1))
        octave = random.standard_normal(grid, np.float32)
        total += strength * np.asarray(cv2.resize(octave, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
        size, strength = size / 2, strength * 0.6
    return np.asarray(total / max(float(total.std()), 1e-6), np.float32)


def rgb(red: float, green: float, blue: float) -> Paint:
    """One colour (3,) of linear light."""
    return np.array([red, green, blue], np.float32)


def plain(shape: tuple[int, int], colour: Colour) -> Paint:
    """One colour."""
    return np.asarray(np.broadcast_to(np.array(colour, np.float32), (*shape, 3)).copy(), np.float32)


def plaster(random: np.random.Generator, shape: tuple[int, int], colour: Colour) -> Paint:
    """Painted plaster: trowel marks, slow stains and fine grain."""
    tone = 1 + 0.06 * noise(random, shape, 400, 50) + 0.07 * noise(random, shape, 24)
    return plain(shape, colour) * tone[..., None]


def wood(random: np.random.Generator, shape: tuple[int, int], colour: Colour = _WOOD) -> Paint:
    """A board with its grain along x: stretched noise, growth rings and a knot or two."""
    height, width = shape
    grain = noise(random, (height, max(8, width // 14)), max(4.0, height / 2))
    grain = np.asarray(cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
    y, x = np.indices(shape, np.float32)
    bend = 0.12 * height * random.standard_normal(max(3, width // 160))
    middle = np.interp(np.arange(width), np.linspace(0, width, bend.size), bend).astype(np.float32)
    across = y - middle - height * float(random.uniform(0.2, 0.8))
    knots = np.zeros(shape, np.float32)
    for _ in range(int(random.poisson(width / 300))):
        at_x, at_y, size = random.uniform(0, width), random.uniform(0, height), random.uniform(0.05, 0.11) * height
        distance = np.hypot((x - at_x) / 1.8, y - at_y) / size
        knots += np.exp(-(distance**6), dtype=np.float32) + 0.35 * np.exp(-((distance - 1.5) ** 2) / 0.06)
        across += np.asarray(6 * size * np.exp(-distance / 2) * np.sign(y - at_y), np.float32)
    rings = np.sin(across * float(random.uniform(0.25, 0.5)) + 1.5 * grain)
    streaks = noise(random, (height, max(8, width // 6)), 4)
    streaks = np.asarray(cv2.resize(streaks, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
    tone = np.exp(0.16 * grain + 0.08 * rings + 0.10 * streaks - 0.9 * np.minimum(knots, 1.2))
    stain = np.exp(random.normal(0, 0.16) + random.normal(0, 0.035, 3))
    return np.asarray(np.array(colour) * stain * tone[..., None] ** np.array([0.9, 1.0, 1.15]), np.float32)


def planks(
    random: np.random.Generator, shape: tuple[int, int], width: int, length: int, colour: Colour = _WOOD
) -> Paint:
    """Boards side by side along x, of uneven length, every one of its own tone, with dark gaps and nails."""
    painted = plain(shape, (0.02, 0.014, 0.01))
    top = 0
    while top < shape[0]:
        height = min(int(width * random.uniform(0.85, 1.15)), shape[0] - top)
        left = -int(random.uniform(0, length))
        while left < shape[1]:
            end = left + int(length * random.uniform(0.6, 1.4))
            start, stop = max(left, 0), min(end, shape[1])
            if height > 3 and stop - start > 3:
                board = wood(random, (height - 2, stop - start - 2), colour)
                for x in np.arange(left + 8, end, length / 3 * random.uniform(0.8, 1.2)) - start:
                    for y in (0.25, 0.75):
                        centre = (round(float(x + random.normal(0, 3))), round(float(y * height + random.normal(0, 2))))
                        cv2.circle(board, centre, 2, (0.03, 0.025, 0.02), -1, cv2.LINE_AA)
                painted[top : top + height - 2, start : stop - 2] = board * random.uniform(0.75, 1.25)
            left = end
        top += height
    return painted


def bricks(random: np.random.Generator, shape: tuple[int, int], length: int, height: int) -> Paint:
    """A wall of bricks, each of its own colour and wear."""
    painted = plaster(random, shape, (0.42, 0.38, 0.33))
    wear = noise(random, shape, 12) * 0.16 + noise(random, shape, 160, 40) * 0.12
    for row, top in enumerate(range(0, shape[0], height)):
        left = -(row % 2) * length // 2 - int(random.uniform(0, length / 4))
        while left < shape[1]:
            size = int(length * random.uniform(0.88, 1.1))
            colour = np.array([0.36, 0.14, 0.09]) * np.exp(random.normal(0, 0.22) + random.normal(0, 0.07, 3))
            if random.uniform() < 0.12:
                colour = colour * [0.5, 0.6, 0.75]
            cut = np.s_[top : top + height - 4, max(left, 0) : max(left + size - 4, 0)]
            painted[cut] = (colour * (1 + wear[cut][..., None])).astype(np.float32)
            left += size
    return painted


def artwork(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """An abstract painting: layered colour fields, strokes, discs and splashes of a few related colours."""
    height, width = shape
    palette = pigments(random, 5)
    field = noise(random, shape, max(height, width) / 2, 8)
    shades = np.digitize(field, np.sort(random.normal(0, 0.8, 4))).astype(int)
    painted = palette[np.clip(shades, 0, 4)]
    for _ in range(int(random.integers(25, 60))):
        colour = tuple(float(c) for c in palette[random.integers(5)] * random.uniform(0.5, 1.3))
        centre = (int(random.uniform(0, width)), int(random.uniform(0, height)))
        size = max(2, int(random.pareto(1.5) * 0.03 * min(shape)) + 2)
        if random.uniform() < 0.4:
            cv2.circle(painted, centre, min(size, min(shape) // 4), colour, -1, cv2.LINE_AA)
        elif random.uniform() < 0.5:
            step = random.normal(0, 0.25 * min(shape), 2).astype(int)
            end = (centre[0] + int(step[0]), centre[1] + int(step[1]))
            cv2.line(painted, centre, end, colour, min(size, 12), cv2.LINE_AA)
        else:
            axes = (min(2 * size, width // 3), min(size, height // 3))
            cv2.ellipse(painted, centre, axes, float(random.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    return np.asarray(painted * (1 + 0.12 * noise(random, shape, 8))[..., None], np.float32)


def rug(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """A knotted rug: a border of uneven lozenges round a field of nested ones, no two alike, of coarse wool."""
    height, width = shape
    ground = np.array([(0.24, 0.045, 0.035), (0.045, 0.06, 0.14), (0.55, 0.44, 0.28)], np.float32)
    painted = plain(shape, (0.045, 0.06, 0.14))
    edge = min(shape) // 9
    painted[edge:-edge, edge:-edge] = ground[2]
    painted[edge + edge // 5 : -edge - edge // 5, edge + edge // 5 : -edge - edge // 5] = ground[0]
    centres = random.uniform(0, 1, (420, 2)) * [width, height]
    inner = np.minimum(centres, [width, height] - centres).min(1)
    sizes = np.where(inner < edge, 0.28 * edge, min(shape) * 0.11 * random.uniform(0.15, 1.0, 420) ** 2.5 + 5)
    for (x, y), size in sorted(zip(centres.tolist(), sizes.tolist(), strict=True), key=lambda item: -item[1]):
        stretch, colours = random.uniform(0.6, 1.5), pigments(random, 4)
        for scale, colour in zip((1.0, 0.72, 0.45, 0.2), colours, strict=True):
            half_x, half_y = scale * size * stretch, scale * size
            diamond = np.array([[x - half_x, y], [x, y - half_y], [x + half_x, y], [x, y + half_y]])
            cv2.fillPoly(painted, [np.rint(diamond).astype(np.int32)], [float(c) for c in colour], cv2.LINE_AA)
    wool = 1 + 0.10 * noise(random, shape, 5) + 0.07 * noise(random, shape, 120, 30)
    return np.asarray(painted * np.maximum(wool, 0.3)[..., None], np.float32)


def outdoors(random: np.random.Generator, shape: tuple[int, int], horizon: float = 0.55) -> Paint:
    """A view from a window: sky with clouds, ranges of hills one behind the other, and trees in front."""
    height, width = shape
    y = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    clouds = np.asarray(cv2.resize(noise(random, (height, width // 2), height / 2.5), (width, height)), np.float32)
    cover = (1 / (1 + np.exp(-2.5 * (clouds - 0.2))))[..., None]
    blue = np.stack(np.broadcast_arrays(0.20 + 0.45 * y, 0.38 + 0.40 * y, 0.80 + 0.12 * y), -1)
    painted = np.asarray(blue * (1 - 0.85 * cover) + 0.85 * cover * rgb(0.95, 0.94, 0.92), np.float32)
    rows = np.indices(shape)[0]
    ranges = [((0.32, 0.42, 0.52), 0.0, 0.05), ((0.16, 0.26, 0.20), 0.09, 0.05), ((0.09, 0.19, 0.06), 0.17, 0.03)]
    for colour, lower, rough in ranges:
        ridge = (horizon + lower + rough * noise(random, (2, width), width / 3, 6)[0]) * height
        leaves = 1 + 0.28 * noise(random, shape, 30)[..., None]
        painted = np.where((rows > ridge)[..., None], rgb(*colour) * leaves, painted)
    crowns = noise(random, shape, height / 4, 4)
    near = (crowns - 6.0 * (0.86 - y)) > 0
    foliage = rgb(0.05, 0.115, 0.025) * np.exp(0.55 * noise(random, shape, 14))[..., None]
    return np.asarray(np.where(near[..., None], foliage, painted), np.float32)


def bookshelf(random: np.random.Generator, shape: tuple[int, int], shelves: int) -> Paint:
    """Shelves of upright books of many colours and sizes, some leaning gaps dark between them."""
    height, width = shape
    painted = wood(random, shape, (0.16, 0.085, 0.04))
    pitch, board = height // shelves, max(6, height // shelves // 14)
    for top in range(board, height - pitch // 2, pitch):
        floor, left = min(top + pitch - board, height - board), board
        painted[top:floor, board : width - board] = 0.018
        while left < width - board - 4:
            thick = min(int(random.uniform(0.05, 0.17) * pitch) + 3, width - board - left)
            if random.uniform() < 0.07:  # a gap
                left += thick
                continue
            tall = int((floor - top) * random.uniform(0.62, 0.95))
            painted[floor - tall : floor, left : left + thick] = _book(random, (tall, thick))
            left += thick
    return painted


def _book(random: np.random.Generator, shape: tuple[int, int]) -> Paint:
    """A spine: rounded shading, bands, and marks where a title would be."""
    height, width = shape
    colour = pigments(random, 1)[0]
    spine = plain(shape, (float(colour[0]), float(colour[1]), float(colour[2])))
    mark = rgb(1.0, 0.9, 0.65) * float(random.choice([0.75, 0.5, 0.04]))
    for at in random.uniform(0.05, 0.95, int(random.integers(1, 4))):
        spine[int(at * height) : int(at * height) + max(2, height // 40)] = mark
    inset = max(1, width // 4)
    title = np.s_[int(0.3 * height) : int(0.7 * height), inset : width - inset]
    letters = random.uniform(0, 1, (max(2, height // 12), 2)) < 0.55
    target = spine[title]
    if target.size:
        inked = cv2.resize(letters.astype(np.uint8), target.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        target[np.asarray(inked) > 0] = mark
    round_off = 1 - 0.55 * np.linspace(-1, 1, width, dtype=np.float32) ** 4
    return np.asarray(spine * round_off[None, :, None] * (1 + 0.06 * noise(random, shape, 8))[..., None], np.float32)
