"""What the tests of laws share: derivatives by differences, random cameras, and rays with the hard ones among them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from hypothesis import HealthCheck, Phase, reject, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera, FastProjection, Projection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.errors import CameraError
from fullsphere.model.lens import (
    LENSES,
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    EnhancedUnifiedCamera,
    FloatArray,
    KannalaBrandt,
    Lens,
    ScaledStereographic,
    Scaramuzza,
    UnifiedCamera,
)
from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator, Mosaic360

PROJECTIONS = sorted(LENSES)

SURFACES: dict[str, FastProjection] = {
    "sphere": Equirectangular((400, 200)),
    "window": Equirectangular((300, 180), (-1.0, 2.5), (-0.4, 0.9)),
    "window behind": Equirectangular((310, 90), (2.5, 4.0), (0.1, 1.2)),
    "belt": Equirectangular((500, 90), (-math.pi, math.pi), (-0.4, 0.9)),
    "cylinder": Cylindrical((400, 150)),
    "part of a cylinder": Cylindrical((300, 200), 2.0, (-0.3, 1.1)),
    "mercator": Mercator((400, 300)),
    "part of mercator": Mercator((300, 250), 3.0, (-1.2, 1.0)),
    "360x360": Mosaic360((240, 300)),
    "cube strip": CubeMap(50, "strip"),
    "cube 3x2": CubeMap(51),
    "cube cross": CubeMap(40, "cross"),
    "cube vertical cross": CubeMap(40, "vertical-cross"),
}
"""A small picture of every surface that is no lens, and of its windows."""

SEEDS = st.integers(0, 2**32 - 1)


def law(examples: int = 25) -> settings:
    """The same examples every time, and no clock."""
    return settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        phases=(Phase.explicit, Phase.generate),  # a failing example is shown as found: shrinking takes minutes
        suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
    )


def central_difference(
    function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float | FloatArray
) -> FloatArray:
    """d function / d at by differences of fourth order: (..., n) -> (..., m) gives (..., m, n), a `step` for each n."""
    steps = np.broadcast_to(np.asarray(step, float), (at.shape[-1],))
    columns = []
    for k, h in enumerate(steps):
        move = np.zeros(at.shape[-1])
        move[k] = h
        near = function(at + move) - function(at - move)
        far = function(at + 2 * move) - function(at - 2 * move)
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, -1)


def widest(lens: Lens) -> float:
    """The largest angle of a picture that could be: r(theta) grows and is at most 200 times as steep as on the axis."""
    theta = np.linspace(0, lens.theta_max, 4001)
    steep = np.flatnonzero(~(lens.slope(theta) <= 200 * lens.slope(0.0)))
    return lens.theta_max if steep.size == 0 else float(theta[steep[0] - 1])


def steps(lens: Lens) -> FloatArray:
    """For each value of a lens (P,) a thousandth of what it is, or of what would bend its curve."""
    focal = float(lens.slope(0.0))
    small = [1e-3 * focal**p.length_power if p.length_power < 0 else 1e-3 for p in lens.parameters]
    return np.maximum(np.abs(lens.values), small)


def _bakstein_pajdla(draw: st.DrawFn, scale: float) -> Lens:
    share = round(draw(st.floats(-0.5, 1.5)), 3)  # of the slope on the axis that the tangent has
    b, d = draw(st.floats(0.6, 3.0)), draw(st.floats(0.4, 3.0))
    return BaksteinPajdla(scale * share * b, b, scale * (1 - share) * d, d)


def _scaramuzza(draw: st.DrawFn, scale: float) -> Lens:
    bend = [round(draw(st.floats(*ends)), 4) for ends in ((-0.8, 0.1), (-0.1, 0.1), (-0.1, 0.05))]
    return Scaramuzza(scale, *(c / scale**n for n, c in enumerate(bend, 1)))


def _either_sign(draw: st.DrawFn, *largest: float) -> list[float]:
    return [round(draw(st.floats(-limit, limit)), 5) for limit in largest]


_SAMPLERS: dict[type[Lens], Callable[[st.DrawFn, float], Lens]] = {  # of lenses with more values than a length
    ScaledStereographic: lambda draw, scale: ScaledStereographic(scale, draw(st.floats(0.5, 3.0))),
    BaksteinPajdla: _bakstein_pajdla,
    KannalaBrandt: lambda draw, scale: KannalaBrandt(scale, *_either_sign(draw, 0.2, 0.1, 0.02, 0.005)),
    Brown: lambda draw, scale: Brown(scale, *_either_sign(draw, 0.4, 0.2, 0.1)),
    Scaramuzza: _scaramuzza,
    UnifiedCamera: lambda draw, scale: UnifiedCamera(scale, draw(st.floats(0.02, 0.98))),
    EnhancedUnifiedCamera: lambda draw, scale: EnhancedUnifiedCamera(
        scale, draw(st.floats(0.02, 0.98)), draw(st.floats(0.3, 3.0))
    ),
    DoubleSphere: lambda draw, scale: DoubleSphere(scale, draw(st.floats(-0.7, 0.7)), draw(st.floats(0.02, 0.98))),
}


@st.composite
def lenses(draw: st.DrawFn, projection: str) -> Lens:
    """Any lens of a kind, with a focal length of about one pixel to some thousands."""
    kind = LENSES[projection]
    scale = draw(st.floats(1.0, 3000.0))
    try:
        lens = _SAMPLERS[kind](draw, scale) if kind in _SAMPLERS else kind(scale)  # type: ignore[call-arg]
    except CameraError:
        reject()
    if widest(lens) < 0.3:
        reject()
    return lens


@st.composite
def cameras(draw: st.DrawFn, projection: str) -> Camera:
    """A picture of 100 to 4000 px of any lens of a kind, the centre off the middle, the whole domain of the lens."""
    lens = draw(lenses(projection))
    part = draw(st.one_of(st.just(1.0), st.floats(0.2, 1.0)))
    half_fov = part * widest(lens)
    width, height = draw(st.integers(100, 4000)), draw(st.integers(100, 4000))
    circle = draw(st.floats(0.3, 0.8)) * min(width, height)
    off_u, off_v = draw(st.floats(-0.1, 0.1)), draw(st.floats(-0.1, 0.1))
    return Camera(
        lens.scaled(circle / float(lens.radius(half_fov))),
        (width, height),
        ((width - 1) / 2 + off_u * width, (height - 1) / 2 + off_v * height),
        aspect=draw(st.floats(0.9, 1.1)),
        half_fov=half_fov,
    )


def hard_angles(limit: float, seed: int, count: int = 60) -> FloatArray:
    """Angles from the axis over all of [0, limit]: random ones, and those where formulas break."""
    angle = np.random.default_rng(seed).uniform(0, limit, count)
    hard = np.array([0.0, 1e-12, 1e-9, 1e-6, 1e-3, math.pi / 2, limit * (1 - 1e-9), limit])
    return np.concatenate([angle, hard[hard <= limit]])


def rays_at(theta: FloatArray, seed: int) -> FloatArray:
    """Unit rays (n, 3) at angles (n,) from the axis, all round it, some exactly along the picture's axes."""
    rng = np.random.default_rng(seed)
    phi = np.where(
        rng.random(len(theta)) < 0.7,
        rng.uniform(-math.pi, math.pi, len(theta)),
        rng.integers(-2, 3, len(theta)) * (math.pi / 2),
    )
    sine = np.sin(theta)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], -1)


def hard_rays(limit: float, seed: int) -> FloatArray:
    """Rays (n, 3) of any length up to `limit` from the axis: `hard_angles` of them."""
    theta = hard_angles(limit, seed)
    length = 10 ** np.random.default_rng(seed + 1).uniform(-3, 3, len(theta))
    return rays_at(theta, seed) * length[:, None]


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (n,) between rays (n, 3) of any length, exact for small ones and near 180 degrees too."""
    cross, dot = np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1)
    return np.asarray(np.arctan2(cross, dot))


def rotation(seed: int) -> FloatArray:
    """A random rotation (3, 3)."""
    return np.asarray(Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix())


def fisheye(side: int, half_fov_deg: float = 95.0, aspect: float = 1.0) -> Camera:
    """A circular fisheye like the paper's: Bakstein-Pajdla beyond 180 degrees, the centre off the middle."""
    half = math.radians(half_fov_deg)
    lens = BaksteinPajdla(1350.0, 2.11, 420.0, 1.13)
    return Camera(
        lens.scaled(0.48 * side / float(lens.radius(half))),
        (side, side),
        (side / 2 + 2.3, side / 2 - 1.7),
        aspect=aspect,
        half_fov=half,
    )


def smooth_light(rays: FloatArray, channels: int = 3) -> FloatArray:
    """A smooth function on the sphere, 0.2 to 0.8: (..., 3) -> (..., channels)."""
    x, y, z = np.moveaxis(rays, -1, 0)
    waves = [
        0.5 + 0.15 * np.sin(3 * x + k) + 0.15 * np.cos(2 * y - k) * np.sin(2.5 * z + 2 * k) for k in range(channels)
    ]
    return np.stack(waves, -1)


def pixel_rays(projection: Projection) -> FloatArray:
    """Unit rays (height, width, 3) of all pixels of a picture, by the exact projection."""
    u, v = np.meshgrid(np.arange(projection.size[0], dtype=float), np.arange(projection.size[1], dtype=float))
    return projection.unproject(np.stack([u, v], -1))


def smooth_panorama(width: int) -> NDArray[np.float32]:
    """`smooth_light` as an equirectangular picture (width / 2, width, 3)."""
    return smooth_light(pixel_rays(Equirectangular((width, width // 2)))).astype(np.float32)
