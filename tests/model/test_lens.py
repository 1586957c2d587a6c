"""The laws of radial projections, over every lens and its whole domain."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fullsphere.model.errors import CameraError
from fullsphere.model.lens import (
    LENSES,
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    EnhancedUnifiedCamera,
    KannalaBrandt,
    Lens,
    ScaledStereographic,
    Scaramuzza,
    Stereographic,
    Thoby,
    UnifiedCamera,
    angle_of_radius,
)
from fullsphere.model.radial import first_root
from laws import PROJECTIONS, SEEDS, central_difference, hard_angles, law, lenses, steps, widest

every_lens = pytest.mark.parametrize("projection", PROJECTIONS)


TYPICAL: dict[str, tuple[float, ...]] = {
    "scaled-stereographic": (300.0, 1.7),
    "bakstein-pajdla": (1350.0, 2.11, 420.0, 1.13),
    "kannala-brandt": (600.0, -0.031, 0.0043, -0.0005, 0.0001),
    "brown": (900.0, -0.29, 0.11, -0.02),
    "scaramuzza": (400.0, -7e-4, 4e-7, -1e-9),
    "ucm": (400.0, 0.62),
    "eucm": (300.0, 0.6, 1.1),
    "double-sphere": (280.0, -0.2, 0.58),
}


def made(projection: str, *values: float) -> Lens:
    return LENSES[projection](*values)


def typical(projection: str) -> Lens:
    return made(projection, *TYPICAL.get(projection, (300.0,)))


@every_lens
@given(data=st.data())
@law()
def test_slope_is_the_derivative_of_radius(projection: str, data: st.DataObject) -> None:
    lens = data.draw(lenses(projection))
    theta = hard_angles(0.98 * widest(lens), data.draw(SEEDS))
    measured = central_difference(lambda t: lens.radius(t), theta[:, None], 1e-4)[:, 0, 0]
    steepest = np.max(np.abs(lens.slope(theta)))
    np.testing.assert_allclose(lens.slope(theta), measured, rtol=1e-7, atol=1e-8 * steepest)


@every_lens
@given(data=st.data())
@law()
def test_radius_by_parameter_is_the_derivative_of_radius(projection: str, data: st.DataObject) -> None:
    lens = data.draw(lenses(projection))
    theta = hard_angles(0.9 * widest(lens), data.draw(SEEDS))
    values = np.array(lens.values)
    step = 1e-4 * steps(lens)
    measured = central_difference(lambda v: lens.with_values(v).radius(theta), values, step)
    by_parameter = lens.radius_by_parameter(theta)
    assert by_parameter.shape == (*theta.shape, len(lens.parameters))
    scale = np.max(np.abs(by_parameter), axis=0) + np.max(np.abs(lens.radius(theta))) / steps(lens)
    np.testing.assert_allclose(by_parameter / scale, measured / scale, atol=1e-8)


@every_lens
@given(data=st.data())
@law()
def test_radius_grows_from_zero_over_the_whole_domain(projection: str, data: st.DataObject) -> None:
    lens = data.draw(lenses(projection))
    assert lens.radius(0.0) == 0
    assert 0 < lens.theta_max <= math.pi
    theta = np.linspace(0, lens.theta_max * (1 - 1e-6), 3001)
    assert np.all(np.isfinite(lens.radius(theta)))
    assert np.all(np.diff(lens.radius(theta)) > 0)
    assert np.all(lens.slope(theta) > 0)


@every_lens
@given(data=st.data())
@law()
def test_angle_of_radius_inverts_radius(projection: str, data: st.DataObject) -> None:
    lens = data.draw(lenses(projection))
    limit = data.draw(st.one_of(st.just(1.0), st.floats(0.1, 1.0))) * widest(lens)
    lens = lens.scaled(2000 / float(lens.radius(limit)))  # a radius of 2000 px: 1e-9 px is then 5e-13 of it
    seed = data.draw(SEEDS)
    radius = np.concatenate([np.random.default_rng(seed).uniform(0, 2000, 200), [0.0, 1e-300, 1e-12, 1e-6, 2000.0]])
    found = angle_of_radius(lens, radius, limit)
    assert np.all((found >= 0) & (found <= limit))
    np.testing.assert_allclose(lens.radius(found), radius, rtol=0, atol=1e-9)
    theta = hard_angles(limit, seed)
    back = angle_of_radius(lens, lens.radius(theta), limit)
    np.testing.assert_allclose((back - theta) * lens.slope(theta), 0, atol=1e-9)


@every_lens
def test_angle_of_radius_keeps_the_shape_and_is_nan_outside(projection: str) -> None:
    lens, limit = typical(projection), 0.9 * widest(typical(projection))
    rim = float(lens.radius(limit))
    radius = np.array([[-1.0, -1e-6, 0.0], [rim, rim * (1 + 1e-9), np.nan], [rim / 2, rim + 1, math.inf]])
    found = angle_of_radius(lens, radius, limit)
    np.testing.assert_array_equal(np.isnan(found), [[1, 1, 0], [0, 1, 1], [0, 1, 1]])
    assert angle_of_radius(lens, rim / 3, limit).shape == ()


@every_lens
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e8, -1e8])
def test_a_value_that_is_no_parameter_is_refused_by_its_key(projection: str, bad: float) -> None:
    values = typical(projection).values
    for k, parameter in enumerate(typical(projection).parameters):
        with pytest.raises(CameraError, match=parameter.key):
            made(projection, *values[:k], bad, *values[k + 1 :])


@every_lens
def test_lengths_and_ratios_are_positive(projection: str) -> None:
    lens = typical(projection)
    for k, parameter in enumerate(lens.parameters):
        if parameter.lower == 0:
            for bad in (0.0, -lens.values[k]):
                with pytest.raises(CameraError, match=parameter.key):
                    lens.with_values([*lens.values[:k], bad, *lens.values[k + 1 :]])


@pytest.mark.parametrize("values", [(100.0, 2.0, -100.0, 1.0), (-100.0, 2.0, 10.0, 1.0), (0.0, 2.0, 0.0, 1.0)])
def test_a_lens_that_falls_at_the_axis_is_refused(values: tuple[float, float, float, float]) -> None:
    with pytest.raises(CameraError, match="grow"):
        BaksteinPajdla(*values)


@given(lens=lenses("bakstein-pajdla"))
@law(60)
def test_bakstein_pajdla_ends_where_its_slope_vanishes(lens: BaksteinPajdla) -> None:
    end = lens.theta_max
    if end < min(lens.b * math.pi / 2, math.pi):
        assert lens.slope(end) == pytest.approx(0, abs=1e-9 * float(np.abs(lens.slope(np.linspace(0, end, 99))).max()))
        assert lens.slope(end + 1e-6) < 0 < lens.slope(end - 1e-6)


@pytest.mark.parametrize("a", [-1e-3, -1e-9])
def test_bakstein_pajdla_turns_before_the_pole_of_a_falling_tangent(a: float) -> None:
    lens = BaksteinPajdla(a, 1.0, 100.0, 2.0)
    assert lens.theta_max < math.pi / 2
    assert lens.slope(lens.theta_max + 1e-7) < 0
    assert lens.radius(lens.theta_max) == pytest.approx(100 * math.sin(math.pi / 4), abs=0.5)


def test_bakstein_pajdla_of_a_sine_alone_ends_at_its_crest() -> None:
    assert BaksteinPajdla(1e-9, 2.5, 300.0, 1.2).theta_max == pytest.approx(1.2 * math.pi / 2, abs=1e-9)
    assert ScaledStereographic(300.0, 1.3).theta_max == pytest.approx(1.3 * math.pi / 2)
    assert ScaledStereographic(300.0, 2.3).theta_max == math.pi


@every_lens
@given(data=st.data(), factor=st.floats(0.01, 50))
@law(10)
def test_scaled_lens_images_everything_that_much_further_out(
    projection: str, data: st.DataObject, factor: float
) -> None:
    lens = data.draw(lenses(projection))
    theta = hard_angles(widest(lens), 0)
    np.testing.assert_allclose(lens.scaled(factor).radius(theta), factor * lens.radius(theta), rtol=1e-10, atol=1e-10)
    assert lens.scaled(factor).theta_max == pytest.approx(lens.theta_max, abs=1e-6)


@every_lens
def test_with_values_replaces_all_in_the_order_of_parameters(projection: str) -> None:
    lens = typical(projection)
    assert lens.with_values(lens.values) == lens
    assert tuple(getattr(lens, p.name) for p in lens.parameters) == lens.values


@every_lens
@given(data=st.data())
@law()
def test_the_domain_ends_where_the_lens_does(projection: str, data: st.DataObject) -> None:
    """At 180 degrees, or where r turns, or grows without bound or suddenly: not before."""
    lens = data.draw(lenses(projection))
    before = lens.theta_max - 1e-9
    slopes = lens.slope(np.linspace(0, before, 2001))
    turns, jumps = slopes[-1] < 1e-4 * slopes.max(), slopes[-1] > 1000 * slopes[0]
    pole = lens.b * math.pi / 2 if isinstance(lens, BaksteinPajdla) else math.pi  # of a tangent of no weight, perhaps
    assert lens.theta_max in (math.pi, pole) or turns or jumps


# The formulas by other ways: plain arithmetic, or the projection of a point in space as the model defines it.


def test_kannala_brandt_by_hand() -> None:
    lens = KannalaBrandt(100.0, 0.1, 0.01, 0.001, 0.0001)
    assert lens.radius([1.0, 2.0]) == pytest.approx([111.11, 329.92])  # 2 + 0.8 + 0.32 + 0.128 + 0.0512
    assert lens.theta_max == math.pi
    assert KannalaBrandt(100.0, -1 / 12, 0.0, 0.0, 0.0).theta_max == pytest.approx(2.0)  # 1 - theta^2/4 vanishes


def test_brown_by_hand() -> None:
    lens = Brown(100.0, 0.1, 0.01, 0.001)
    assert lens.radius([math.pi / 4, math.atan(2.0)]) == pytest.approx([111.1, 100 * (2 + 0.8 + 0.32 + 0.128)])
    assert lens.theta_max == math.pi / 2
    assert Brown(100.0, -1 / 3, 0.0, 0.0).theta_max == pytest.approx(math.pi / 4)  # 1 - tan^2 vanishes


def test_thoby_by_hand() -> None:
    assert Thoby(100.0).radius(math.pi / 2) == pytest.approx(132.314, abs=0.001)  # 147 sin(64.17 degrees)
    assert math.degrees(Thoby(100.0).theta_max) == pytest.approx(126.227, abs=0.001)


def test_scaramuzza_images_the_ray_of_a_pixel_at_that_pixel() -> None:
    a0, a2, a3, a4 = 400.0, -7e-4, 4e-7, -1e-9
    lens = Scaramuzza(a0, a2, a3, a4)
    p = np.array([1.0, 100.0, 300.0, 600.0, 750.0])
    w = a0 + a2 * p**2 + a3 * p**3 + a4 * p**4
    assert w[-1] < 0 < w[2]  # beyond 90 degrees and before
    np.testing.assert_allclose(lens.radius(np.arctan2(p, w)), p, rtol=1e-13)


POINTS = np.array([[3.0, 4.0, 12.0], [-1.0, 2.0, 0.0], [3.0, 4.0, -1.0], [0.1, -0.2, 1.0]])
THETA = np.arctan2(np.hypot(POINTS[:, 0], POINTS[:, 1]), POINTS[:, 2])


def test_unified_camera_is_a_sphere_seen_by_a_pinhole() -> None:
    """Mei's form: the point on the unit sphere, seen from xi behind its centre."""
    alpha = 0.62
    xi = alpha / (1 - alpha)
    on_sphere = POINTS / np.linalg.norm(POINTS, axis=1)[:, None]
    seen = on_sphere[:, :2] / (on_sphere[:, 2:] + xi) * (1 + xi)
    np.testing.assert_allclose(UnifiedCamera(300.0, alpha).radius(THETA), 300 * np.hypot(*seen.T), rtol=1e-13)
    np.testing.assert_allclose(UnifiedCamera(300.0, 0.5).radius(THETA), Stereographic(300.0).radius(THETA), rtol=1e-13)


def test_enhanced_unified_camera_by_its_inverse() -> None:
    alpha, beta = 0.6, 1.1
    m = EnhancedUnifiedCamera(1.0, alpha, beta).radius(THETA)
    z = (1 - beta * alpha**2 * m**2) / (alpha * np.sqrt(1 - (2 * alpha - 1) * beta * m**2) + 1 - alpha)
    np.testing.assert_allclose(np.arctan2(m, z), THETA, rtol=1e-13)


def test_double_sphere_by_its_two_spheres_and_by_its_inverse() -> None:
    xi, alpha = -0.2, 0.58
    x, y, z = POINTS.T
    d1 = np.linalg.norm(POINTS, axis=1)
    d2 = np.sqrt(x**2 + y**2 + (xi * d1 + z) ** 2)
    seen = POINTS[:, :2] / (alpha * d2 + (1 - alpha) * (xi * d1 + z))[:, None]
    m = DoubleSphere(1.0, xi, alpha).radius(THETA)
    np.testing.assert_allclose(m, np.hypot(*seen.T), rtol=1e-13)
    mz = (1 - alpha**2 * m**2) / (alpha * np.sqrt(1 - (2 * alpha - 1) * m**2) + 1 - alpha)
    gain = (mz * xi + np.sqrt(mz**2 + (1 - xi**2) * m**2)) / (mz**2 + m**2)
    np.testing.assert_allclose(np.arctan2(gain * m, gain * mz - xi), THETA, rtol=1e-13)


@pytest.mark.parametrize("xi", [-0.6, -0.2, 0.3, 0.6])
@pytest.mark.parametrize("alpha", [0.2, 0.4, 0.6, 0.8])
def test_double_sphere_ends_at_its_pole_or_summit(xi: float, alpha: float) -> None:
    """Where the model's article, with w2 = (w1 + xi)/sqrt(2 w1 xi + xi^2 + 1), states another angle."""
    lens = DoubleSphere(1.0, xi, alpha)
    if alpha > 0.5:
        assert lens.slope(lens.theta_max - 1e-5) > 0 > lens.slope(lens.theta_max + 1e-5)
    else:
        assert lens.radius(lens.theta_max - 1e-5) > 1e3
        assert lens.radius(lens.theta_max + 1e-5) < -1e3
    w1 = min(alpha, 1 - alpha) / max(alpha, 1 - alpha)
    stated = math.acos(-(w1 + xi) / math.sqrt(2 * w1 * xi + xi**2 + 1))
    assert abs(stated - lens.theta_max) > 0.005


def test_values_in_powers_of_a_pixel_say_so_by_their_keys() -> None:
    assert [(p.key, p.length_power) for p in Scaramuzza.parameters] == [
        ("a0_px", 1),
        ("a2_per_px", -1),
        ("a3_per_px2", -2),
        ("a4_per_px3", -3),
    ]
    assert [p.length_power for p in BaksteinPajdla.parameters] == [1, 0, 1, 0]
    assert Scaramuzza(400.0, -8e-4, 4e-7, -8e-10).scaled(2.0) == Scaramuzza(800.0, -4e-4, 1e-7, -1e-10)


def test_the_first_root_is_the_least_positive_one() -> None:
    assert first_root([]) == math.inf
    assert first_root([0.0, 0.0]) == math.inf
    assert first_root([1.0, 1.0]) == math.inf
    assert first_root([-0.5]) == pytest.approx(2.0)
    assert first_root([-1.5, 0.5, 0.0]) == pytest.approx(1.0)  # (1 - x)(1 - x/2)
    assert first_root([-2.0, 1.0]) == pytest.approx(1.0)  # a double root
