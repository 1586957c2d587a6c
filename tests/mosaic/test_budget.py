"""Memory is shared out: tiles get smaller with the width, frames take what is left, and too little is said."""

import re

import numpy as np
import pytest
from turning import frame_of, ring

from fullsphere.model.errors import ResourceError
from fullsphere.mosaic.budget import shared_out
from fullsphere.mosaic.project import Mosaic
from laws import fisheye

MB = 10**6


def mosaic_of(count: int, side: int) -> Mosaic:
    picture = np.broadcast_to(np.uint8(0), (side, side, 3))
    return Mosaic((fisheye(side),), tuple(frame_of(f"frame {k}", picture, r) for k, r in enumerate(ring(count))), ())


def test_frames_take_what_is_left() -> None:
    mosaic = mosaic_of(4, 1000)
    less, more = (shared_out(memory * MB, mosaic, (4096, 2048), np.uint8, 2) for memory in (1500, 2500))
    assert less.tile_px == more.tile_px == 256
    assert more.frame_bytes - less.frame_bytes == 1000 * MB


@pytest.mark.parametrize(("width", "dtype"), [(32768, np.uint8), (8192, np.float32)])
def test_bands_take_no_more_where_the_panorama_is_wider(width: int, dtype: type) -> None:
    mosaic = mosaic_of(4, 1000)
    wide, wider = (shared_out(2000 * MB, mosaic, (across, across // 2), dtype, 2) for across in (width, 2 * width))
    assert wider.tile_px == wide.tile_px // 2


def test_the_least_that_is_needed_is_enough() -> None:
    mosaic, size = mosaic_of(8, 2000), (32768, 16384)
    with pytest.raises(ResourceError, match=r"--memory 100MB is too little for 8 frames and 32768 x 16384") as told:
        shared_out(100 * MB, mosaic, size, np.uint8, 2, "p.tif")
    found = re.search(r"at least (\d+)MB", str(told.value))
    assert found
    least = int(found[1])
    assert 300 < least < 1500
    assert shared_out(least * MB, mosaic, size, np.uint8, 2).tile_px == 128
    with pytest.raises(ResourceError):
        shared_out((least - 1) * MB, mosaic, size, np.uint8, 2)
