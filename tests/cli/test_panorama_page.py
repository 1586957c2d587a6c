"""The page about a composition."""

from pathlib import Path

import numpy as np
import pytest
from turning import frames_of, orientation

from fullsphere.cli.page import write_page
from fullsphere.cli.panorama_page import page_of_panorama
from fullsphere.mosaic.planning import Plan, planned
from fullsphere.mosaic.project import Mosaic
from laws import fisheye, smooth_light

CAMERA = fisheye(160)


@pytest.mark.parametrize("count", [1, 4])
def test_the_page_tells_of_light_seams_and_coverage(tmp_path: Path, count: int) -> None:
    rotations = np.array([orientation(360 * k / count) for k in range(count)])
    frames = frames_of(smooth_light, CAMERA, rotations, lambda k, light: (light * (1 + 0.2 * k)).astype(np.float32))
    plan = planned(Mosaic((CAMERA,), tuple(frames), ()))
    plan = Plan(plan.mosaic, plan.shares, plan.exposure_ev, ("a note to be read",))
    page = tmp_path / "page.html"
    write_page(page, page_of_panorama("pano.tif", plan), False)
    text = page.read_text()
    for said in (f"{count} frames", "a note to be read", "Who is shown where", "Zenith and nadir", "of the sphere"):
        assert said in text
    names = {file.stem for file in (tmp_path / "page-figures").iterdir()}
    assert names == {"exposures", "seams", "differences", "coverage", "poles"}
    again = tmp_path / "again.html"
    write_page(again, page_of_panorama("pano.tif", plan), False)
    assert again.read_bytes() == page.read_bytes()
