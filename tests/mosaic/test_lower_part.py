"""The lower rows of a surface are the same numbers as in the whole, to the last bit."""

import numpy as np
import pytest
from turning import orientation

from fullsphere.model.positions import Geometry, fast
from fullsphere.mosaic.lower_part import lower_part
from laws import SURFACES, fisheye

TARGETS = {**SURFACES, "camera": fast(fisheye(90))}


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("top", [0, 32])
def test_the_geometry_of_a_part_is_that_of_the_whole(name: str, top: int) -> None:
    whole = TARGETS[name]
    part = lower_part(whole, top)
    width, height = part.size
    assert (width, height + top) == whole.size
    rotation = orientation(30, 20, 10)
    camera = fisheye(120)
    found = Geometry(camera, part, rotation, 2).positions(slice(-1, height + 1), slice(-1, width + 1))
    expected = Geometry(camera, whole, rotation, 2).positions(slice(top - 1, whole.size[1] + 1), slice(-1, width + 1))
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found.u, expected.u)
    np.testing.assert_array_equal(found.v, expected.v)
    rays = fast(part).window_rays(slice(0, width), slice(0, height), np.float32)
    np.testing.assert_array_equal(rays, whole.window_rays(slice(0, width), slice(top, top + height), np.float32))
    np.testing.assert_allclose(part.unproject([[3.0, 5.0]]), whole.unproject([[3.0, 5.0 + top]]), atol=1e-12)
    np.testing.assert_allclose(part.project(rays[5]), whole.project(rays[5]) - [0, top], atol=1e-9)
