"""A panorama is in the colour space of its frames, and says so."""

import argparse
import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest
from icc_profiles import ADOBE, P3, SRGB_CURVE, gamma, parametric, profile
from turning import frames_of, ring

from fullsphere.cli.composing import plain
from fullsphere.cli.rendering import write_panorama
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.icc import SRGB, profile_of
from fullsphere.model.images import linear_from_encoded, read_picture
from fullsphere.model.lens import FloatArray
from fullsphere.model.surface import Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.project import Mosaic, Picture
from laws import fisheye, smooth_light

CAMERA = fisheye(200)
SPHERE = Equirectangular((200, 100))
ADOBE_ICC, P3_ICC = profile(ADOBE, gamma(2.19921875)), profile(P3, parametric(3, SRGB_CURVE))


def coloured(rays: FloatArray) -> FloatArray:
    light: FloatArray = 0.5 * smooth_light(rays) * np.array([1.0, 0.8, 0.6])
    return light


@pytest.mark.parametrize(
    ("icc", "ending", "dtype", "expected"),
    [
        ([ADOBE_ICC] * 4, "png", np.uint8, ADOBE_ICC),
        ([ADOBE_ICC] * 4, "tif", np.uint16, ADOBE_ICC),
        ([ADOBE_ICC] * 4, "jpg", np.uint16, ADOBE_ICC),
        ([b""] * 4, "png", np.uint8, None),
        ([ADOBE_ICC, P3_ICC, b"", P3_ICC], "png", np.uint8, None),
    ],
)
def test_the_panorama_shows_the_colours_of_the_scene(
    tmp_path: Path, icc: list[bytes], ending: str, dtype: type, expected: bytes | None
) -> None:
    def recorded(k: int, light: FloatArray) -> Picture:
        own = profile_of(icc[k])
        return encoded_from_linear((light @ np.linalg.inv(own.srgb_from_own).T).astype(np.float32), dtype, own)

    frames = frames_of(coloured, CAMERA, ring(4), recorded)
    own = [dataclasses.replace(f, profile=functools.partial(profile_of, i)) for f, i in zip(frames, icc, strict=True)]
    args, path = argparse.Namespace(json=True, overwrite=False, threads=1), tmp_path / f"panorama.{ending}"
    with thread_pool(1) as executor:
        write_panorama(path, Mosaic((CAMERA,), tuple(own), ()), plain(200), executor, args)
    picture = read_picture(path)
    assert picture.icc_profile == expected
    shown = profile_of(expected) if expected else SRGB
    light = linear_from_encoded(picture.pixels, shown)[..., :3] @ shown.srgb_from_own.T
    truth = coloured(SPHERE.window_rays(slice(0, 200), slice(0, 100)))
    np.testing.assert_allclose(light, truth, atol=0.02)
