"""Whether seams show as steps of brightness: a scene without edges, and exposures that the mosaic knows badly."""

import functools
from concurrent.futures import Executor
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from registration_pictures import circular, diagonal
from remap_table import Row, note

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.compose import compose, plan
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.worlds import panorama, photograph, turn

_WIDTH = 2048
_OFF_EV = 0.1  # by which the mosaic's exposures are wrong, up and down in turn
_LOW_PASS_PX = 4.0
_SIDE_PX = 6  # of a seam, 1 degree: it is compared there, and as far again beyond
_HIGHEST_DEG = 75.0  # to which columns are compared; rows are to the poles
_LIMIT = 0.5


class Smooth:
    """Light between 0.15 and 0.7 that changes slowly with direction."""

    def radiance(self, rays: ArrayLike) -> NDArray[np.float32]:
        x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
        level = 0.4 + 0.12 * np.sin(2.5 * x + 0.4) + 0.1 * np.cos(2 * y - 0.7) * np.sin(2 * z + 1) + 0.06 * y
        light = level[..., None] * np.array([1.0, 0.95, 0.9])
        return np.asarray(np.nan_to_num(light), np.float32)


def step_rows(executor: Executor) -> list[Row]:
    """The largest step along all seams, beside that of frames put side by side as they are."""
    return [
        _row("circular fisheye, 8 frames", circular(1000), executor),
        _row("diagonal fisheye, 12 frames", diagonal(1200, 800), executor, 12, 45.0),
    ]


def _row(name: str, camera: Camera, executor: Executor, shots: int = 8, pitch_deg: float = 20.0) -> Row:
    note(f"steps: {name}")
    scene = Smooth()
    off_ev = _OFF_EV * np.random.default_rng(1).choice([-1.0, 1.0], shots)
    frames = []
    for k, shot in enumerate(turn(shots, pitch_deg=pitch_deg, exposure_ev=0.3)):
        picture = photograph(
            scene, camera, shot.camera_from_world, exposure_ev=shot.exposure_ev, noise=0.003, seed=k, executor=executor
        )
        frames.append(
            Frame(
                f"{k}",
                f"{k}",
                camera.size,
                functools.partial(_itself, picture),
                camera_from_world=shot.camera_from_world,
                exposure_ev=shot.exposure_ev + float(off_ev[k]),
            )
        )
    mosaic = Mosaic((camera,), tuple(frames), ())
    shares = plan(mosaic, executor)
    surface = Equirectangular((_WIDTH, _WIDTH // 2))
    found = np.concatenate([band.rows for band in compose(mosaic, surface, np.float32, executor, shares)])
    covered = found[..., 3] > 0
    truth = panorama(scene, _WIDTH, executor=executor)
    times = _WIDTH // shares.owners.shape[1]
    owners = np.repeat(np.repeat(shares.owners, times, axis=0), times, axis=1)
    hard = truth * np.exp2(-off_ev[owners])[..., None].astype(np.float32)
    steps, cut = (_largest(_grey(light) - _grey(truth), owners, covered) for light in (found[..., :3], hard))
    return Row(
        f"step across seams, smooth scene, {name}, exposures off by +-{_OFF_EV} EV / not evened out",
        f"{steps.step:.2f} levels, {steps.a_degree:.2f} a degree",
        f"{cut.step:.2f} levels",
        f"{steps.step / cut.step:.3f}",
        f"<= {_LIMIT}",
        "yes" if steps.step <= _LIMIT else "NO",
    )


def _itself(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return picture


def _grey(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Codes of sRGB, 0 to 255, unrounded."""
    return (encoded_from_linear(np.ascontiguousarray(light[..., :3]), np.uint16) / 257).astype(np.float32)


class _Steps(NamedTuple):
    """The largest step at any seam, and the largest difference over a degree there, in grey levels."""

    step: float
    a_degree: float


def _largest(off: NDArray[np.float32], owners: NDArray[np.integer], covered: NDArray[np.bool_]) -> _Steps:
    """Of errors (h, w, 3) after a low-pass, where owners change.

    A step is what is left between the two sides of a seam after the shading of each side is carried on to it.
    """
    soft = cv2.GaussianBlur(off, (0, 0), _LOW_PASS_PX, borderType=cv2.BORDER_REPLICATE)
    reach = 2 * _SIDE_PX + 1
    inside = cv2.erode(covered.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
    latitude = (0.5 - (np.arange(len(off)) + 0.5) / len(off)) * np.pi
    low = np.abs(latitude) < np.radians(_HIGHEST_DEG)
    largest = _Steps(0.0, 0.0)
    for axis, rows in ((1, low), (0, np.ones_like(low))):
        seam = (np.roll(owners, -1, axis=axis) != owners) & inside & rows[:, None]
        if axis == 0:
            seam[:reach] = seam[-reach:] = False

        def at(pixels: int, axis: int = axis) -> NDArray[np.float32]:
            return np.roll(soft, -pixels, axis=axis)

        near = at(_SIDE_PX + 1) - at(-_SIDE_PX)
        step = 2 * near - (at(2 * _SIDE_PX + 1) - at(-2 * _SIDE_PX))
        degrees = (2 * _SIDE_PX + 1) * 360 / _WIDTH
        here = [float(np.abs(values[seam]).max(initial=0)) for values in (step, near / degrees)]
        largest = _Steps(max(largest.step, here[0]), max(largest.a_degree, here[1]))
    return largest
