"""How close a panorama is to the scene that its frames were rendered from, and how close perfect knowledge comes.

Written apart from the program that it measures: only the truth and the pixels are used, and OpenCV to sample them.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.lens import FloatArray

Picture = NDArray[np.float32]

WIDTH = 4096  # of panoramas that are compared
_BRIGHT = 0.97  # of white, in codes: brighter is left out, for no tone curve brings back what is clipped
_RIM = np.radians(0.7)  # the last of a field of view, which every lens shows dark and soft
_PAD = 8


class RenderedTruth(NamedTuple):
    """All that a truth.json says: how each frame was turned and exposed, the lens as a curve, vignetting, the scene.

    A frame's light is the scene's times `gain` times 1 - `vignette` (theta/half field of view)^2.
    """

    folder: Path
    files: tuple[str, ...]
    rotations: FloatArray
    gains: FloatArray
    vignette: float
    theta: FloatArray
    radius_px: FloatArray
    centre: tuple[float, float]
    aspect: float
    scene: Path

    @classmethod
    def read(cls, folder: Path, scenes: Path | None = None) -> Self:
        """From the folder's truth.json; the scene that it names lies in the folder `scenes`, or where it says.

        Raises
        ------
        SystemExit
            If the file holds no photometry or no scene.
        """
        held = json.loads((folder / "truth.json").read_text())
        try:
            scene = Path(held["pano"])
            frames = held["frames"]
            return cls(
                folder,
                tuple(frame["file"] for frame in frames),
                np.array([frame["R"] for frame in frames], float),
                np.array([frame["gain"] for frame in frames], float),
                float(held["vignette"]),
                np.array(held["theta"], float),
                np.array(held["r"], float),
                (float(held["cx"]), float(held["cy"])),
                float(held["beta"]),
                scenes / scene.name if scenes else scene,
            )
        except KeyError as missing:
            raise SystemExit(f"{folder / 'truth.json'}: {missing} is not there") from None


class Seen(NamedTuple):
    """A panorama as codes of sRGB from 0 to 1 (h, w, 3), and which of its pixels show something (h, w)."""

    codes: Picture
    covered: NDArray[np.bool_]

    @classmethod
    def read(cls, path: Path) -> Self:
        """From a file with alpha."""
        held: NDArray[Any] | None = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if held is None or held.ndim != 3 or held.shape[2] != 4:
            raise SystemExit(f"{path}: no picture with alpha")
        full = np.float32(np.iinfo(held.dtype).max)
        return cls(held[..., 2::-1].astype(np.float32) / full, held[..., 3] == full)


class Likeness(NamedTuple):
    """PSNR in dB over the sphere, and the share of the sphere that is covered."""

    psnr_db: float
    cover: float


def likeness(panorama: Seen, scene: Picture, scene_from_panorama: FloatArray) -> Likeness:
    """Compare a panorama (h, w) with its scene (linear light), which is turned by a rotation (3, 3).

    In codes of sRGB, each direction by its solid angle.  Exposure is free in a panorama: each channel goes through
    a + b v + c sqrt(v) that suits best.  Uncovered pixels count as black, those of a clipped scene not at all.
    """
    height, width = panorama.covered.shape
    truth = _srgb(np.clip(_sampled(scene, _rays(width) @ scene_from_panorama.T.astype(np.float32)), 0, 1))
    weight = np.broadcast_to(np.cos(_latitudes(height))[:, None], (height, width))
    counts = truth.max(-1) < _BRIGHT
    both, lost = counts & panorama.covered, counts & ~panorama.covered
    error, root = 0.0, np.sqrt(weight[both])
    for channel in range(3):
        value, wanted = panorama.codes[..., channel][both], truth[..., channel][both]
        design = np.stack([value, np.sqrt(value), np.ones_like(value)], -1)
        curve, *_ = np.linalg.lstsq(design * root[:, None], wanted * root, rcond=None)
        error += float(((design @ curve - wanted) ** 2 * weight[both]).sum())
        error += float((truth[..., channel][lost] ** 2 * weight[lost]).sum())
    error /= 3 * float(weight[counts].sum())
    return Likeness(10 * float(np.log10(1 / error)), float(np.average(panorama.covered, weights=weight)))


def oracle(truth: RenderedTruth) -> Seen:
    """The panorama that perfect knowledge of lens, orientations and light gives, as a plain weighted mean of frames."""
    light, weight = np.zeros((WIDTH // 2, WIDTH, 3), np.float32), np.zeros((WIDTH // 2, WIDTH), np.float32)
    rays = _rays(WIDTH)
    for more, how_much in _oracle_frames(truth, rays):
        light += more * how_much[..., None]
        weight += how_much
    light /= np.maximum(weight, np.float32(1e-12))[..., None]
    codes = np.round(255 * _srgb(np.clip(light, 0, 1))) / np.float32(255)
    return Seen(codes.astype(np.float32), weight > 0)


def _oracle_frames(truth: RenderedTruth, rays: Picture) -> Iterator[tuple[Picture, Picture]]:
    """Each frame's light on the sphere, exposure and vignetting taken out, and its weight: more near its axis."""
    half = truth.theta[-1]
    for file, rotation, gain in zip(truth.files, truth.rotations, truth.gains, strict=True):
        x, y, z = np.moveaxis(rays @ rotation.T.astype(np.float32), -1, 0)
        theta = np.arccos(np.clip(z, -1, 1))
        scale = np.interp(theta, truth.theta, truth.radius_px) / np.maximum(np.hypot(x, y), 1e-9)
        u = (truth.centre[0] + scale * x).astype(np.float32)
        v = (truth.centre[1] + truth.aspect * scale * y).astype(np.float32)
        picture = _linear_file(truth.folder / file)
        height, width = picture.shape[:2]
        light = np.asarray(cv2.remap(picture, u, v, cv2.INTER_CUBIC), np.float32)
        inside = (theta < half - _RIM) & (u > 1) & (v > 1) & (u < width - 2) & (v < height - 2)
        weight = np.where(inside, np.cos(np.minimum(theta / half, 1) * np.pi / 2) ** 4 + 1e-6, 0)
        weight *= np.where(light.max(-1) > _BRIGHT, 1e-4, 1)
        light /= (gain * (1 - truth.vignette * np.minimum(theta / half, 1) ** 2))[..., None].astype(np.float32)
        yield light, weight.astype(np.float32)


def scene_of(truth: RenderedTruth) -> Picture:
    """The scene in linear light, as wide as panoramas that are compared."""
    return np.asarray(cv2.resize(_linear_file(truth.scene), (WIDTH, WIDTH // 2), interpolation=cv2.INTER_AREA))


def _linear_file(path: Path) -> Picture:
    held = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if held is None or held.dtype != np.uint8:
        raise SystemExit(f"{path}: no picture of 8 bits")
    codes = np.arange(256, dtype=np.float32) / 255
    table = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype(np.float32)
    light: Picture = table[held]
    return light


def _srgb(light: Picture) -> Picture:
    curved = 1.055 * np.maximum(light, np.float32(1e-9)) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, curved).astype(np.float32)


def _latitudes(height: int) -> FloatArray:
    return (0.5 - (np.arange(height) + 0.5) / height) * np.pi


def _rays(width: int) -> Picture:
    """Unit rays (width/2, width, 3) of an equirectangular picture's pixels."""
    lon = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    lat = _latitudes(width // 2)[:, None]
    parts = np.broadcast_arrays(np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon))
    return np.stack(parts, -1).astype(np.float32)


def _sampled(scene: Picture, rays: Picture) -> Picture:
    """An equirectangular picture along rays (h, w, 3), across its edges too."""
    height, width = scene.shape[:2]
    past = [np.roll(rows[::-1], width // 2, axis=1) for rows in (scene[:_PAD], scene[-_PAD:])]
    whole = np.concatenate([past[0], scene, past[1]])
    whole = np.concatenate([whole[:, -_PAD:], whole, whole[:, :_PAD]], axis=1)
    x = (np.arctan2(rays[..., 0], rays[..., 2]) / (2 * np.pi) + 0.5) * width - 0.5 + _PAD
    y = (0.5 + np.arcsin(np.clip(rays[..., 1], -1, 1)) / np.pi) * height - 0.5 + _PAD
    strips = [slice(top, top + 256) for top in range(0, len(rays), 256)]
    return np.concatenate(
        [cv2.remap(whole, x[s].astype(np.float32), y[s].astype(np.float32), cv2.INTER_LANCZOS4) for s in strips]
    )
