"""Steps of a lens's values that are taken in its curve."""

import numpy as np
import pytest

from fullsphere.model.lens import BaksteinPajdla, Equidistant, FloatArray, KannalaBrandt, Lens
from fullsphere.mosaic.lens_step import lens_moved

HALF = 1.6
THETA = np.linspace(0, HALF, 200)
LENS = BaksteinPajdla(293.0, 2.11, 91.0, 1.13)


def off_px(lens: Lens, values: FloatArray, step: FloatArray) -> float:
    """How far, in rms, the curve with `values` is from that of the lens and what the step adds to first order."""
    wanted = lens.radius(THETA) + lens.radius_by_parameter(THETA) @ step
    return float(np.sqrt(np.mean((lens.with_values(values).radius(THETA) - wanted) ** 2)))


def test_a_step_along_the_valley_keeps_the_curve() -> None:
    relative = LENS.radius_by_parameter(THETA) * LENS.values
    step = 0.3 * np.linalg.svd(relative, full_matrices=False)[2][-1] * LENS.values
    plain = np.array(LENS.values) + step
    moved = lens_moved(LENS, step, HALF)
    assert off_px(LENS, plain, step) > 0.5
    assert off_px(LENS, moved, step) < 0.02 * off_px(LENS, plain, step)


@pytest.mark.parametrize("lens", [Equidistant(300.0), KannalaBrandt(300.0, 0.01, -0.002, 1e-4, 1e-5)])
def test_where_the_curve_is_nearly_linear_in_the_values_the_step_is_the_plain_one(lens: Lens) -> None:
    step = np.zeros(len(lens.values))
    step[0] = 1.5
    np.testing.assert_allclose(lens_moved(lens, step, HALF), np.array(lens.values) + step)
    step[-1] += 1e-7 * lens.values[-1]
    assert off_px(lens, lens_moved(lens, step, HALF), step) < 1e-3


def test_values_that_do_not_move_stay() -> None:
    moved = lens_moved(LENS, np.array([4.0, 0.02, 0.0, 0.0]), HALF)
    np.testing.assert_array_equal(moved[2:], LENS.values[2:])


def test_a_step_out_of_the_domain_still_answers() -> None:
    moved = lens_moved(LENS, np.array([-900.0, 0.5, 20.0, 0.1]), HALF)
    assert moved.shape == (4,)
    assert np.isfinite(moved).all()
