"""Other lenses against the measured curve: the right shape leaves noise, a wrong one its own wave."""

from __future__ import annotations

import math

import numpy as np
from calibrations import made_calibration

from fullsphere.model.calibration.candidates import misfits_of_calibrations, misfits_of_fitted_lenses
from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equisolid

SIGMA = 0.1


def test_a_lens_of_the_right_shape_leaves_the_noise_and_others_more() -> None:
    equisolid = Camera(Equisolid(300.0), (640, 600), (318.0, 301.0), half_fov=math.radians(92))
    calibration = made_calibration(sigma_px=SIGMA, rejected=6, camera=equisolid, reach_deg=91.5)
    found = {misfit.lens: misfit for misfit in misfits_of_fitted_lenses(calibration)}
    assert len(found["equisolid"].theta) == calibration.points
    for flexible in ("equisolid", "bakstein-pajdla", "kannala-brandt"):  # that hold the equisolid shape, or nearly so
        assert 0.9 * SIGMA < found[flexible].rms_px < 1.1 * SIGMA
    assert found["stereographic"].rms_px > found["equidistant"].rms_px > 20 * SIGMA
    assert not {"perspective", "orthographic", "brown"} & set(found)  # the points are further out


def test_what_a_fitted_lens_leaves_has_no_part_along_its_own_values() -> None:
    calibration = made_calibration(sigma_px=SIGMA)
    for misfit in misfits_of_fitted_lenses(calibration):
        if misfit.lens in ("equidistant", "equisolid", "stereographic"):  # one length: r is f times a shape
            shape = {"equidistant": 1.0, "equisolid": 0.5, "stereographic": 0.5}[misfit.lens] * misfit.theta
            along = {"equidistant": shape, "equisolid": np.sin(shape), "stereographic": np.tan(shape)}[misfit.lens]
            share = misfit.radial_px @ along / np.linalg.norm(misfit.radial_px) / np.linalg.norm(along)
            assert abs(share) < 0.05  # not zero: it is fitted to means of neighbours


def test_calibrations_are_compared_by_their_own_residuals() -> None:
    one, two = made_calibration(sigma_px=SIGMA), made_calibration(sigma_px=3 * SIGMA)
    first, second = misfits_of_calibrations({"one": one, "two": two})
    assert (first.lens, second.lens) == ("one", "two")
    np.testing.assert_allclose(second.radial_px, 3 * first.radial_px, rtol=1e-6)
    assert 0.9 * SIGMA < first.rms_px < 1.1 * SIGMA
