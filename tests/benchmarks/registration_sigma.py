"""Whether stated sigmas are honest: matches from known cameras and rotations through the adjustment, seed after seed.

A keypoint is one error, however many partners it has: a frame's pixel of a thing serves all of its matches, as that
of a real frame does.  Errors of keypoints are normal, of a standard deviation that differs from keypoint to keypoint;
some matches are wrong by a few pixels, as many as get past a gate, and some altogether.
"""

import math
from typing import NamedTuple

import numpy as np
from registration_scores import sigma_factor
from remap_table import Row, note
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera
from fullsphere.model.lens import BaksteinPajdla, FloatArray, Perspective
from fullsphere.mosaic.project import Link
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.solution import solve_links
from fullsphere.mosaic.truth import rotation_errors_deg

HONEST = 1.5  # true errors over stated ones, or the other way round
_NOISE_PX = (0.15, 0.6)  # standard deviation of a keypoint's error along each axis, uniform between
_DETECTED, _MATCHED = 0.6, 0.7  # chance that a thing becomes a keypoint of a frame, and that a pair of them is matched
_NEAR_MISS, _WRONG = 0.03, 0.01  # share of matches that are off by up to 4 px, and by anything


class Turn(NamedTuple):
    """How the made-up frames are taken."""

    name: str
    camera: Camera
    angles_deg: FloatArray
    things: int


def turns() -> tuple[Turn, ...]:
    """A hand-held turn and a pair through a fisheye lens, and a row through an ordinary one."""
    fisheye, wider = _fisheye(91.5), _fisheye(97.5)
    ordinary = Camera(Perspective(1000.0), (1200, 800), (599.5, 399.5), half_fov=math.atan(721 / 1000))
    eight = np.array([(45 * i, 25 * (-1) ** i, 10 * (i % 3 - 1)) for i in range(8)], float)
    row = np.array([(30 * i, 3 * math.sin(i), 0) for i in range(12)], float)
    return (
        Turn("8 frames by hand, fisheye", fisheye, eight, 1500),
        Turn("4 frames on a tripod, fisheye", fisheye, eight[::2] * (1, 0.05, 0.1), 800),
        Turn("2 frames back to back, fisheye", wider, np.array([(0, 0, 0), (180, 0, 0)], float), 8000),
        Turn("12 frames in a row, ordinary lens", ordinary, row, 15000),
    )


def _fisheye(half_fov_deg: float) -> Camera:
    half = math.radians(half_fov_deg)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    return Camera(lens.scaled(580 / float(lens.radius(half))), (1200, 1200), (602.0, 596.0), half_fov=half)


def sigma_rows(seeds: int) -> list[Row]:
    """For each turn, with the lens known and found: true errors of the rotations over the stated ones."""
    rows = []
    for turn in turns():
        for lens in ("known", "found"):
            note(f"sigma: {turn.name}, lens {lens}, {seeds} seeds")
            free = () if lens == "known" else _free(turn.camera)
            factors, errors = zip(*(_one(turn, free, seed) for seed in range(seeds)), strict=True)
            factor = float(np.sqrt(np.mean(np.square(factors))))
            rows.append(
                Row(
                    f"true errors over stated sigma, {turn.name}, lens {lens}",
                    f"{factor:.2f}",
                    f"error {np.sqrt(np.mean(np.square(errors))):.5f} deg rms",
                    "",
                    f"1/{HONEST} to {HONEST}",
                    "yes" if 1 / HONEST <= factor <= HONEST else "NO",
                )
            )
    return rows


def _free(camera: Camera) -> tuple[str, ...]:
    return (*(p.key for p in camera.lens.parameters), "centre_u_px", "centre_v_px")


def _one(turn: Turn, free: tuple[str, ...], seed: int) -> tuple[float, float]:
    """The factor of one seed, and the errors' root mean square in degrees."""
    random = np.random.default_rng(seed)
    angles = turn.angles_deg + random.normal(0, 2, turn.angles_deg.shape)
    true = Rotation.from_euler("YXZ", angles, degrees=True).inv().as_matrix()
    links = _links(turn, true, random)
    adjustment = solve_links(links, Rig.of_one_camera(len(true)), [turn.camera], free).adjustment
    errors, _ = rotation_errors_deg(list(adjustment.rotations), list(true))
    return sigma_factor(errors, np.rad2deg(adjustment.sigma)), float(np.sqrt(np.mean(errors**2)))


def _links(turn: Turn, true: FloatArray, random: np.random.Generator) -> list[Link]:
    things = random.normal(size=(turn.things, 3))
    things /= np.linalg.norm(things, axis=1, keepdims=True)
    pixels = np.array([turn.camera.project(things @ r.T) for r in true])
    pixels += random.normal(size=pixels.shape) * random.uniform(*_NOISE_PX, pixels.shape[:2])[..., None]
    inside = np.all((pixels > 0) & (pixels < np.array(turn.camera.size) - 1), axis=-1)  # NaN is not
    seen = inside & np.isfinite(turn.camera.unproject(pixels)[..., 0])
    seen &= random.random(pixels.shape[:2]) < _DETECTED
    links = []
    for i in range(len(true)):
        for j in range(i + 1, len(true)):
            both = np.flatnonzero(seen[i] & seen[j] & (random.random(turn.things) < _MATCHED))
            if len(both) < 30:
                continue
            a, b = pixels[i, both], pixels[j, both].copy()
            near = random.random(len(both)) < _NEAR_MISS
            b[near] += random.uniform(-4, 4, (int(near.sum()), 2))
            wrong = random.random(len(both)) < _WRONG
            b[wrong] = b[random.permutation(np.flatnonzero(wrong))]
            links.append(Link(i, j, a, b, true[j] @ true[i].T))
    return links
