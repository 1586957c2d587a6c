"""What the points determine worst, in words: which unknowns can change together and leave the pictures as they are.

Unknowns are taken in groups that mean something to whoever holds the camera, each scaled to what it does in the
picture: the lens's scale and the shape of its curve (whatever numbers its formula has), centre, aspect, and the tilt,
distance and sideways place of the target in each view.  The smallest singular value of the columns, all of length 1,
is how much of a change is left in the picture once the others have made up for it; its vector says who they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_SAMPLE = 3000  # points that are looked at
_IDLE = 1e-3  # of a curve's largest change: a value of the formula that does nothing here
_TAKES_PART = 0.1  # of the squared vector, that makes a group worth naming

_LENS = ("the scale of the lens", "the shape of its curve", "the image centre", "the aspect of the pixels")
_TARGET = ("the tilt of the target", "the distance of the target", "the place of the target sideways")
_ADVICE = {
    _LENS[0]: "add views from other distances and steeply tilted ones, or points at several depths",
    _LENS[1]: "add views from other distances, so that each angle is seen at several depths",
    _LENS[2]: "add views with the target tilted to several sides, or the camera turned about its axis",
    _LENS[3]: "add views with the camera turned about its axis by 90 degrees",
    _TARGET[0]: "add points further apart in depth",
    _TARGET[1]: "add points further apart in depth",
    _TARGET[2]: "add points further apart in depth",
}


class Weakest(NamedTuple):
    """The change of all unknowns together that the pictures show least.

    Attributes
    ----------
    groups
        Names of the groups of unknowns that take part, the strongest first.
    hidden
        How many times smaller the change is in the picture than the changes of the groups one by one.
    text
        The same in words, with what would help.
    """

    groups: tuple[str, ...]
    hidden: float
    text: str


def weakest(camera: Camera, rays: FloatArray, view: NDArray[np.intp]) -> Weakest:
    """Which combination of lens and poses the points determine worst.

    Parameters
    ----------
    camera
        As fitted, or as near as it came; it must see the rays.
    rays
        Points (N, 3) in the camera frames of their views, with their distances.
    view
        (N,) number of the view of each.
    """
    if len(rays) > _SAMPLE:
        chosen = np.sort(np.random.default_rng(0).choice(len(rays), _SAMPLE, replace=False))
        rays, view = rays[chosen], view[chosen]
    columns, group = _columns(camera, rays, view)
    columns /= np.linalg.norm(columns, axis=0)
    _, singular, vt = np.linalg.svd(columns, full_matrices=False)
    names = (*_LENS, *_TARGET)
    share = np.bincount(group, vt[-1] ** 2, minlength=len(names))
    order = np.argsort(-share, kind="stable")
    groups = tuple(names[k] for k in order if share[k] >= _TAKES_PART)
    hidden = float(1 / max(singular[-1], 1e-15))
    partners = f" against {' and '.join(groups[1:])}" if len(groups) > 1 else ""
    advice = next(_ADVICE[name] for name in (*_LENS, *_TARGET) if name in groups)
    views = len(np.unique(view))
    return Weakest(
        groups,
        hidden,
        f"worst determined is {groups[0]}{partners}: changed together they alter the picture{'s' * (views > 1)} "
        f"{hidden:.0f} times less than one by one; {advice}",
    )


def _columns(camera: Camera, rays: FloatArray, view: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.intp]]:
    """What each unknown does to the pixels (2N, K), and the number of its group (K,)."""
    _, by_ray, by_camera = camera.project_with_jacobians(rays)
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    phi = np.arctan2(rays[:, 1], rays[:, 0])
    outward = np.stack([np.cos(phi), camera.aspect * np.sin(phi)], -1)
    curves = _curves(camera, theta)
    moved = outward[:, :, None] * curves[:, None, :]
    parts = [(moved[..., :1], 0), (moved[..., 1:], 1)]
    parts += [(by_camera[..., -3:-1], 2), (by_camera[..., -1:], 3)]
    for each in np.unique(view):
        mine = np.asarray(view == each)[:, None, None]
        centre = rays[view == each].mean(0)
        sight = centre / np.linalg.norm(centre)
        aside = np.linalg.svd(sight[None])[2][1:]
        parts += [
            (mine * np.cross((rays - centre)[:, None, :], by_ray), 4),
            (mine * (by_ray @ sight)[..., None], 5),
            (mine * (by_ray @ aside.T), 6),
        ]
    columns = np.concatenate([part.reshape(2 * len(rays), -1) for part, _ in parts], 1)
    group = np.repeat([number for _, number in parts], [part.shape[-1] for part, _ in parts])
    seen = np.linalg.norm(columns, axis=0) > 0
    return columns[:, seen], group[seen]


def _curves(camera: Camera, theta: FloatArray) -> FloatArray:
    """Changes of r(theta) (N, k): the lens's own scale, then what else its formula can do, at right angles to it."""
    scale = camera.lens.radius(theta)
    others = camera.lens.radius_by_parameter(theta)
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    unit = scale / np.linalg.norm(scale)
    u, singular, _ = np.linalg.svd(others - unit[:, None] * (unit @ others), full_matrices=False)
    return np.concatenate([unit[:, None], u[:, singular > _IDLE]], 1)
