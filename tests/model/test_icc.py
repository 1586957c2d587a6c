"""Colour profiles of primaries and curves, against LittleCMS; and those that are not understood."""

import io
from typing import Any

import numpy as np
import pytest
from icc_profiles import ADOBE, P3, PROPHOTO, SRGB, SRGB_CURVE, assembled, gamma, parametric, profile, sampled
from numpy.typing import NDArray

from fullsphere.model.colour import decoding_table, encoded_from_linear, linear_from_encoded
from fullsphere.model.icc import SRGB as PLAIN
from fullsphere.model.icc import profile_of

PROFILES = {
    "adobe": profile(ADOBE, gamma(2.19921875), version=0x02400000),
    "p3": profile(P3, parametric(3, SRGB_CURVE)),
    "prophoto": profile(PROPHOTO, parametric(3, (1.8, 1, 0, 1 / 16, 1 / 32))),
    "linear": profile(PROPHOTO, gamma(1)),
    "identity": profile(SRGB, sampled([])),
    "sampled": profile(P3, sampled(np.linspace(0, 1, 300) ** 1.9)),
    "bt709": profile(SRGB, parametric(3, (1 / 0.45, 1 / 1.099, 0.099 / 1.099, 1 / 4.5, 0.081))),
    "steep": profile(ADOBE, gamma(2.6)),
}


def srgb8_by_littlecms(icc: bytes, codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    cms = pytest.importorskip("PIL.ImageCms")
    image = pytest.importorskip("PIL.Image").fromarray(codes)
    own = cms.ImageCmsProfile(io.BytesIO(icc))
    done = cms.profileToProfile(image, own, cms.createProfile("sRGB"), renderingIntent=1, outputMode="RGB")
    return np.asarray(done)


@pytest.mark.parametrize("name", PROFILES)
def test_colours_are_those_that_littlecms_finds(name: str) -> None:
    codes = np.random.default_rng(0).integers(60, 200, (40, 50, 3), dtype=np.uint8)
    own = profile_of(PROFILES[name])
    assert not own.doubt
    light = linear_from_encoded(codes, own) @ own.srgb_from_own.T.astype(np.float32)
    inside = (light > 0.001).all(-1) & (light < 0.999).all(-1)
    assert inside.mean() > 0.3
    ours = encoded_from_linear(light, np.uint8)
    difference = np.abs(ours.astype(int) - srgb8_by_littlecms(PROFILES[name], codes).astype(int))[inside]
    assert difference.max() <= 2 and difference.mean() < 0.3


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("name", PROFILES)
def test_every_code_comes_back_as_itself(name: str, dtype: type) -> None:
    own = profile_of(PROFILES[name])
    codes: NDArray[Any] = np.arange(np.iinfo(dtype).max + 1, dtype=dtype)[:, None].repeat(3, 1)
    back = encoded_from_linear(linear_from_encoded(codes, own), dtype, own)
    if name == "bt709" and dtype is np.uint16:  # two parts of a curve, rounded, overlap by some codes
        assert np.mean(back != codes) < 1e-3
        light = linear_from_encoded(np.stack([codes, back]), own)
        np.testing.assert_allclose(light[0], light[1], rtol=0, atol=3e-5)
    else:
        assert np.array_equal(back, codes)


def test_curves_are_those_of_the_specification() -> None:
    code = np.array([0, 0.02, 0.1, 0.5, 1])
    kinds = [
        (parametric(0, (2.0,)), code**2),
        (parametric(1, (2.0, 1.25, -0.25)), np.maximum(1.25 * code - 0.25, 0) ** 2),
        (parametric(2, (2.0, 1.0, -0.125, 0.234375)), np.maximum(code - 0.125, 0) ** 2 + 0.234375),
        (parametric(4, (2.0, 1.0, 0.0, 0.25, 0.25, 0.0, 0.0)), np.where(code < 0.25, code / 4, code**2)),
    ]
    for tag, expected in kinds:
        np.testing.assert_allclose(profile_of(profile(P3, tag)).curve(code), expected, atol=2e-5)


def test_srgb_by_any_name_is_srgb() -> None:
    grid = np.linspace(0, 1, 1024)
    sampled_srgb = sampled(np.where(grid <= 0.04045, grid / 12.92, ((grid + 0.055) / 1.055) ** 2.4))
    for curve in (parametric(3, SRGB_CURVE), sampled_srgb):
        found = profile_of(profile(SRGB, curve))
        assert found.is_srgb and not found.doubt and found.icc
        assert np.array_equal(decoding_table(np.uint8, found), decoding_table(np.uint8))
    assert profile_of(None) is profile_of(b"") is PLAIN
    for other in PROFILES.values():
        assert not profile_of(other).is_srgb


def test_white_and_grey_stay_so() -> None:
    for icc in PROFILES.values():
        np.testing.assert_allclose(profile_of(icc).srgb_from_own.sum(1), 1, atol=1e-12)


def test_grey_profiles_have_a_curve_alone() -> None:
    found = profile_of(profile((), gamma(1.8), space=b"GRAY"))
    assert found.grey and not found.doubt
    np.testing.assert_allclose(found.curve(np.array([0.5])), 0.5**1.80078125)


@pytest.mark.parametrize(
    ("icc", "doubt"),
    [
        (b"nothing of the kind", "is damaged"),
        (PROFILES["adobe"][:200], "is damaged"),
        (PROFILES["adobe"][:-40], "is damaged"),
        (profile(P3, gamma(2), space=b"CMYK"), "is for CMYK, not for RGB"),
        (assembled({b"A2B0": bytes(64)}), "is made of tables"),
        (profile(P3, gamma(0)), "does not rise"),
        (profile(P3, sampled([0, 0.6, 0.5, 1])), "does not rise"),
        (profile(P3, sampled([0, 0.5])), "does not rise"),
        (profile(P3, parametric(9, (1, 1, 1))), "of an unknown kind"),
        (profile(P3, b"mAB " + bytes(20)), "of an unknown kind"),
        (profile(P3, gamma(1.8), gamma(2.2), gamma(2.2)), "of its own for each colour"),
        (profile((P3[0], P3[0], P3[2]), gamma(2.2)), "no three colours"),
        (profile((P3[0], P3[1], (-2, -0.1, 0.1)), gamma(2.2)), "no white"),
    ],
)
def test_what_is_not_understood_is_taken_for_srgb_and_handed_on(icc: bytes, doubt: str) -> None:
    found = profile_of(icc)
    assert doubt in found.doubt
    assert found.is_srgb and found.icc == icc


def test_damage_is_never_an_exception() -> None:
    rng = np.random.default_rng(1)
    for name in ("adobe", "prophoto", "sampled"):
        for _ in range(400):
            spoilt = np.frombuffer(PROFILES[name], np.uint8).copy()
            at = rng.integers(0, min(len(spoilt), 600), 4)
            spoilt[at] = rng.integers(0, 256, 4)
            found = profile_of(spoilt.tobytes())
            assert np.isfinite(decoding_table(np.uint8, found)).all()
            assert np.isfinite(found.srgb_from_own).all()
