"""What frames say of each other where they overlap, of known differences."""

import dataclasses

import numpy as np
import pytest
from turning import frames_of, orientation

from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.agreement import agreement
from fullsphere.mosaic.overview import overviews
from fullsphere.mosaic.project import Mosaic
from laws import fisheye, smooth_light, smooth_panorama

CAMERA = fisheye(200)
ROTATIONS = np.array([orientation(yaw) for yaw in (0, 120, 240)])
SPHERE = Equirectangular((256, 128))


def mosaic_of(told: float) -> Mosaic:
    """Each frame brighter than the one before by half a stop, of which a share is told."""
    frames = frames_of(smooth_light, CAMERA, ROTATIONS, lambda k, light: (light * 2 ** (0.5 * k)).astype(np.float32))
    return Mosaic(
        (CAMERA,), tuple(dataclasses.replace(f, exposure_ev=told * 0.5 * k) for k, f in enumerate(frames)), ()
    )


@pytest.mark.parametrize("told", [0.0, 0.5, 1.0])
def test_brightness_before_and_after(told: float) -> None:
    mosaic = mosaic_of(told)
    found = agreement(mosaic, overviews(mosaic, SPHERE))
    assert len(found.pairs) == 3
    for pair in found.pairs:
        recorded = 0.5 * (pair.i - pair.j)
        assert pair.recorded_ev == pytest.approx(recorded, abs=0.01)
        assert pair.evened_ev == pytest.approx((1 - told) * recorded, abs=0.01)


def test_what_frames_show_together_and_how_many_see_it() -> None:
    mosaic = mosaic_of(1.0)
    seen = overviews(mosaic, SPHERE)
    found = agreement(mosaic, seen)
    np.testing.assert_array_equal(found.frames, np.sum([one.seen for one in seen], 0))
    covered = found.frames > 0
    assert covered.mean() > 0.9
    np.testing.assert_allclose(found.light[covered], smooth_panorama(SPHERE.size[0])[covered], atol=0.02)
    assert found.difference.max() < 0.03
    assert not found.difference[found.frames < 2].any()


def test_what_moved_is_a_difference() -> None:
    mosaic = mosaic_of(1.0)
    seen = overviews(mosaic, SPHERE)
    spot = np.zeros(seen[0].quality.shape, bool)
    spot[60:66] = (seen[0].seen & (seen[1].seen | seen[2].seen))[60:66]
    changed = dataclasses.replace(seen[0], light=np.where(spot[..., None], np.float32(0), seen[0].light))
    found = agreement(mosaic, [changed, *seen[1:]])
    assert spot.any()
    assert found.difference[spot].min() > 0.3
    assert found.difference[~spot].max() < 0.03
