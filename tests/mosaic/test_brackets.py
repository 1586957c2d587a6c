"""Brackets: which pictures belong together, their exposures, and the light that they are merged to."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lamps import LAMP, STEPS_EV, Lamps, bracket, brackets_in, written
from numpy.typing import NDArray
from turning import ring

from fullsphere.model.colour import decoding_table, encoded_from_linear, linear_from_encoded
from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.icc import SRGB
from fullsphere.model.images import read_picture
from fullsphere.mosaic import bracket_kernels
from fullsphere.mosaic.bracket_merge import Exposed, merged_light
from fullsphere.mosaic.brackets import counted_by_notes, described
from fullsphere.mosaic.frames import open_frames
from fullsphere.mosaic.masks import open_masks
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.store import load_mosaic, save_mosaic
from laws import fisheye, pixel_rays

CAMERA = fisheye(200)
TURN = np.eye(3)


@pytest.fixture(scope="module")
def shots() -> list[NDArray[np.uint8]]:
    return [bracket(CAMERA, TURN, ev, seed) for seed, ev in enumerate(STEPS_EV)]


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float32]:
    """The light (h, w, 3) of the scene, sampled as `photograph` does; 0 along the rim and outside of it."""
    v, u = np.mgrid[:200, :200].astype(float)
    quarters = [np.stack([u + across, v + down], -1) for across in (-0.25, 0.25) for down in (-0.25, 0.25)]
    light = np.mean([Lamps().radiance(CAMERA.unproject(at)) for at in quarters], axis=0, dtype=np.float32)
    return np.where(inside(0.97)[..., None], light, np.float32(0))


def inside(share: float) -> NDArray[np.bool_]:
    """Where (h, w) the picture shows something, less its rim."""
    theta = np.arccos(np.clip(np.nan_to_num(pixel_rays(CAMERA), nan=-1)[..., 2], -1, 1))
    return np.asarray(theta < share * CAMERA.half_fov)


def merged(
    pictures: Sequence[NDArray[Any]], exposures_ev: Sequence[float] = STEPS_EV, reference: int = 1
) -> NDArray[np.float32]:
    light: NDArray[np.float32] = merged_light(exposures_ev, reference, lambda k: Exposed(pictures[k], SRGB))
    return light


def test_light_is_recovered_over_more_stops_than_a_picture_has(
    shots: list[NDArray[np.uint8]], truth: NDArray[np.float32]
) -> None:
    light, clear = merged(shots), inside(0.95)
    single = linear_from_encoded(shots[1])
    brightness = truth.max(-1)
    stops = math.log2(brightness[clear].max() / np.percentile(brightness[clear], 0.5))
    assert stops > 8
    for low in 2.0 ** np.arange(-7, 1.6):
        level = clear & (brightness >= low) & (brightness < 2 * low) & (brightness < 0.98 * LAMP)
        if np.count_nonzero(level) < 100:
            continue
        error = light[level] / truth[level] - 1
        assert abs(np.median(error)) < 0.01
        assert np.sqrt(np.mean(error**2)) < 0.008 + 0.004 / math.sqrt(low)
        if low < 0.2:
            assert np.std(error) < 0.6 * np.std(single[level] / truth[level] - 1)  # the brightest one knows more
    lamp = clear & (truth.min(-1) == LAMP)
    assert np.count_nonzero(lamp) > 300
    assert (shots[1][lamp] == 255).all()
    assert np.abs(light[lamp] / LAMP - 1).max() < 0.03


def test_one_exposure_alone_stays_what_it_is(shots: list[NDArray[np.uint8]]) -> None:
    codes = np.minimum(shots[1], 200)
    np.testing.assert_allclose(merged([codes], [0.0], 0), linear_from_encoded(codes), rtol=1e-5)


def test_what_is_clipped_in_all_brackets_is_as_bright_as_the_darkest_tells(shots: list[NDArray[np.uint8]]) -> None:
    white = [np.full((20, 30, 3), 255, np.uint8)] * 3
    np.testing.assert_allclose(merged(white), 4.0, rtol=1e-5)


@pytest.mark.parametrize("moving", [0, 2])
def test_what_moved_is_where_the_reference_saw_it(moving: int, truth: NDArray[np.float32]) -> None:
    """A ball in one bracket only, brighter than anything around it; and one that only the reference shows."""
    direction = np.array([0.25, 0.3, 0.9])
    ball = pixel_rays(CAMERA) @ (direction / np.linalg.norm(direction)) > math.cos(0.16)
    with_ball = Lamps(direction / np.linalg.norm(direction))
    elsewhere = [bracket(CAMERA, TURN, ev, k, with_ball if k == moving else None) for k, ev in enumerate(STEPS_EV)]
    assert np.count_nonzero(ball) > 100
    assert np.abs(merged(elsewhere)[ball] / truth[ball] - 1).max() < 0.25
    only = [bracket(CAMERA, TURN, ev, k, with_ball if k == 1 else None) for k, ev in enumerate(STEPS_EV)]
    core = pixel_rays(CAMERA) @ (direction / np.linalg.norm(direction)) > math.cos(0.13)
    assert np.abs(merged(only)[core] / 0.5 - 1).max() < 0.05


def test_a_lamp_that_only_the_reference_shows_stays_white() -> None:
    still = [np.full((120, 120, 3), code, np.uint8) for code in (70, 130, 225)]
    light = linear_from_encoded(still[1])[0, 0, 0]
    still[1] = still[1].copy()
    still[1][40:70, 50:80] = 255
    found = merged(still, [-1.83, 0.0, 1.67])
    assert found[45:65, 55:75].min() > 0.9
    assert np.abs(found[:30] / light - 1).max() < 0.1


def test_sixteen_bits_grey_and_alpha() -> None:
    light = np.linspace(0.02, 3, 60 * 60).reshape(60, 60, 1)
    alpha = np.full((60, 60, 1), 65535, np.uint16)
    alpha[:10] = 0
    grey = [encoded_from_linear((light * 2.0**ev).astype(np.float32), np.uint16) for ev in STEPS_EV]
    np.testing.assert_allclose(merged(grey), light, rtol=2e-3)
    colour = [
        np.dstack([code, code, code, alpha if k == 2 else np.full_like(alpha, 65535)]) for k, code in enumerate(grey)
    ]
    found = merged(colour)
    np.testing.assert_allclose(found[10:, :, 1], light[10:, :, 0], rtol=2e-3)
    np.testing.assert_array_equal(found[..., 3], alpha[..., 0] / 65535)


def test_the_kernel_is_what_it_says() -> None:
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 256, (17, 23, 3)).astype(np.uint8)
    table, moved = decoding_table(np.uint8), rng.random((4, 5)).astype(np.float32)
    light, weight = rng.random((17, 23, 3)).astype(np.float32), rng.random((17, 23)).astype(np.float32)
    expected_light, expected_weight = slow_twin(codes, table, 2.5, 1e-6, moved, 5, light.copy(), weight.copy())
    bracket_kernels.add_bracket(codes, table, 2.5, False, 1e-6, 0.8, 0.95, moved, 5, light, weight)
    np.testing.assert_allclose(weight, expected_weight, rtol=2e-5)
    np.testing.assert_allclose(light, expected_light, rtol=2e-5)


def slow_twin(
    codes: NDArray[Any],
    table: NDArray[Any],
    exposure: float,
    least: float,
    moved: NDArray[Any],
    factor: int,
    light: NDArray[Any],
    weight: NDArray[Any],
) -> tuple[NDArray[Any], NDArray[Any]]:
    value = table[codes].astype(float)
    v, u = ((np.arange(n) + 0.5) / factor - 0.5 for n in codes.shape[:2])
    rows = np.array([np.interp(u, np.arange(moved.shape[1]), row) for row in moved])
    other = np.array([np.interp(v, np.arange(moved.shape[0]), column) for column in rows.T]).T
    s = np.clip((value.max(-1) - 0.8) / 0.15, 0, 1)
    trust = np.maximum((1 - s * s * (3 - 2 * s)) * (1 - other), least)
    expected = exposure * light.max(-1) / weight
    much = exposure**2 / (expected + bracket_kernels.FLOOR) * trust
    return light + much[..., None] * value / exposure, weight + much


@pytest.mark.parametrize("noted", [True, False])
def test_exposures_are_those_of_the_pictures(tmp_path: Path, noted: bool) -> None:
    """Shutters are not what they are called; the pictures tell to a fiftieth of an EV."""
    true = (0.0, -1.93, 2.12)
    paths = brackets_in(tmp_path, CAMERA, ring(2), (0.0, -2.0, 2.0), noted=noted)
    for k, path in enumerate(paths):
        notes = (0.0, -2.0, 2.0)[k % 3] if noted else None
        written(path, bracket(CAMERA, ring(2)[k // 3], true[k % 3], k), notes)
    frames = open_frames(paths, brackets=3)
    assert [frame.id for frame in frames] == ["A_0.png", "B_0.png"]
    for k, frame in enumerate(frames):
        assert [one.image for one in frame.brackets] == [str(path) for path in paths[3 * k : 3 * k + 3]]
        found = [one.exposure_ev for one in frame.brackets]
        assert found[0] == 0 and np.abs(np.array(found) - true).max() < 0.02
        assert frame.load().dtype == np.float32
    assert described(frames) == "2 positions of 3 brackets: 0 -1.9 +2.1 EV"


def test_steps_of_four_stops_are_measured(tmp_path: Path) -> None:
    frames = open_frames(brackets_in(tmp_path, CAMERA, ring(2), (-4.0, 0.0), noted=False), brackets=2)
    for frame in frames:
        assert [one.exposure_ev for one in frame.brackets] == pytest.approx([0.0, 4.0], abs=0.03)


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return brackets_in(tmp_path_factory.mktemp("brackets"), CAMERA, ring(3))


def test_brackets_are_told_by_what_the_camera_noted(taken: list[Path], tmp_path: Path) -> None:
    assert counted_by_notes(taken) == 3
    assert counted_by_notes(taken[:3], positions=1) == 3
    with pytest.raises(InputError, match=r"do not repeat .*\(in EV: 0 \+2 \+4 0 \+2 \+4 0 \+2\); give"):
        counted_by_notes(taken[:8])
    with pytest.raises(InputError, match="3 pictures have one exposure"):
        counted_by_notes(taken[::3])
    plain = written(tmp_path / "plain.png", read_picture(taken[0]).pixels)
    with pytest.raises(InputError, match=r"plain\.png: notes no exposure"):
        counted_by_notes([*taken, plain])


def test_a_picture_too_few_is_said(taken: list[Path]) -> None:
    with pytest.raises(UsageError, match="8 pictures are no brackets of 3"):
        open_frames(taken[:8], brackets=3)


def lefts(frames: Sequence[Frame]) -> dict[str, str]:
    return {frame.id: frame.reason for frame in frames if frame.reason}


def test_positions_that_are_no_brackets_are_left_out(taken: list[Path], tmp_path: Path) -> None:
    pixels = read_picture(taken[1]).pixels
    cut = written(tmp_path / "cut.png", pixels[:-2])
    (tmp_path / "broken.png").write_bytes(taken[2].read_bytes()[:2000])
    other = written(tmp_path / "other.png", np.ascontiguousarray(pixels[::-1, ::-1]) // 2)
    alike = [written(tmp_path / f"alike_{k}.png", bracket(CAMERA, TURN, 0.0, 20 + k)) for k in range(3)]
    sets = [[taken[0], cut, taken[2]], [taken[3], taken[4], tmp_path / "broken.png"], [taken[6], other, taken[8]]]
    twice = [taken[0], taken[1], taken[1]]
    good = taken[3:9]
    frames = open_frames([path for one in [*sets, twice, alike] for path in one] + good, brackets=3)
    said = list(lefts(frames).values())
    assert len(said) == 5
    assert said[0] == "is 200 x 200 pixels, its bracket cut.png 200 x 198"
    assert said[1].startswith("cannot be merged with broken.png, which ")
    assert "do not show the same thing" in said[2] or "show nothing in common" in said[2]
    assert "are the same file" in said[3]
    assert said[4] == "and the 2 after it have one exposure: they are no brackets"


def test_a_shifted_bracket_and_one_out_of_order_are_warned_of(
    taken: list[Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shifted = np.roll(read_picture(taken[2]).pixels, 3, axis=1)
    moved = written(tmp_path / "moved.png", shifted, 2.0)
    with caplog.at_level(logging.WARNING):
        open_frames([*taken[:2], moved, *taken[3:]], brackets=3)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("A_1.png and moved.png are shifted by ")
    assert float(caplog.messages[0].split("shifted by ")[1].split()[0]) == pytest.approx(3, abs=0.3)
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        open_frames([*taken[:6], taken[8], taken[7], taken[6]], brackets=3)
    assert [message.split(";")[0] for message in caplog.messages] == [
        "C_1.png: its brackets are +2 0 -2 EV, those of most positions -2 0 +2"
    ]
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        open_frames(taken, brackets=3)
    assert not caplog.messages


def test_a_mask_of_any_bracket_is_that_of_the_frame(taken: list[Path], tmp_path: Path) -> None:
    mask = np.full((200, 200, 3), 255, np.uint8)
    mask[:, :50] = 0
    written(tmp_path / "A_0_mask.png", mask)
    written(tmp_path / "B_1_mask.png", mask)
    frames = open_frames(taken, brackets=3, masks=open_masks(tmp_path))
    assert [Path(frame.mask_image).name for frame in frames] == ["A_0_mask.png", "B_1_mask.png", ""]
    for frame in frames[:2]:
        assert frame.mask is not None and not frame.mask()[:, :50].any()


def contrast(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What a camera makes of sRGB codes to please: dark parts darker, bright parts brighter."""
    share = codes / 255
    return np.asarray(np.round(255 * (share - 0.05 * np.sin(2 * np.pi * share))), np.uint8)


def shoulder(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What a camera makes of light that it holds back: white is far above what its profile says."""
    light = linear_from_encoded(codes)
    return np.asarray(encoded_from_linear(1.6 * light / (0.6 + light), np.uint8))


@pytest.fixture(scope="module", params=[contrast, shoulder])
def pleasing(request: pytest.FixtureRequest, taken: list[Path], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The same brackets by a camera that writes another tone curve than its profile's."""
    folder = tmp_path_factory.mktemp("pleasing")
    return [
        written(folder / path.name, request.param(read_picture(path).pixels), STEPS_EV[k % 3])
        for k, path in enumerate(taken[:6])
    ]


def test_light_is_told_from_the_tone_curve_of_a_camera(
    pleasing: list[Path], truth: NDArray[np.float32], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        frames = open_frames(pleasing, brackets=3)
    assert not caplog.messages
    assert described(frames) == "2 positions of 3 brackets: -2 0 +2 EV, and the camera's tone curve"
    assert frames[0].response_ev == frames[1].response_ev and len(frames[0].response_ev) == 11
    light, seen = frames[0].load(), inside(0.95) & (truth.min(-1) > 0.004) & (truth.max(-1) < 2)
    flat = merged([read_picture(path).pixels for path in pleasing[:3]])
    off, uncorrected = (np.log2(found[seen] / truth[seen]) for found in (light, flat))
    assert np.std(off) < 0.12
    assert np.std(off) < 0.35 * np.std(uncorrected)
    assert [one.exposure_ev for one in frames[0].brackets] == pytest.approx(STEPS_EV, abs=0.06)


def test_pictures_that_obey_their_profile_have_no_response(taken: list[Path]) -> None:
    assert [frame.response_ev for frame in open_frames(taken, brackets=3)] == [()] * 3


def test_without_notes_a_tone_curve_is_not_known(pleasing: list[Path], tmp_path: Path) -> None:
    plain = [written(tmp_path / path.name, read_picture(path).pixels) for path in pleasing]
    assert [frame.response_ev for frame in open_frames(plain, brackets=3)] == [()] * 2


def test_a_tone_curve_is_kept_with_the_mosaic(pleasing: list[Path], tmp_path: Path) -> None:
    frames = open_frames(pleasing, brackets=3)
    turned = [dataclasses.replace(frame, camera_from_world=turn) for frame, turn in zip(frames, ring(2), strict=True)]
    save_mosaic(tmp_path / "mosaic.json", Mosaic((CAMERA,), tuple(turned), ()))
    read = load_mosaic(tmp_path / "mosaic.json").frames[1]
    assert read.response_ev == frames[1].response_ev
    assert np.array_equal(read.load(), frames[1].load())


@pytest.fixture
def stored(taken: list[Path], tmp_path: Path) -> Path:
    copies = [tmp_path / path.name for path in taken[:6]]
    for path, copy in zip(taken, copies, strict=False):
        copy.write_bytes(path.read_bytes())
    frames = open_frames(copies, brackets=3)
    turned = [dataclasses.replace(frame, camera_from_world=turn) for frame, turn in zip(frames, ring(2), strict=True)]
    save_mosaic(tmp_path / "mosaic.json", Mosaic((CAMERA,), tuple(turned), ()))
    return tmp_path / "mosaic.json"


def test_a_mosaic_of_brackets_comes_back_with_the_same_light(stored: Path) -> None:
    frames = load_mosaic(stored).frames
    again = open_frames([Path(image) for frame in frames for image in frame.images], brackets=3)
    for frame, opened in zip(frames, again, strict=True):
        assert frame.brackets == opened.brackets and len(frame.brackets) == 3
        assert np.array_equal(frame.load(), opened.load())
    save_mosaic(stored.parent / "again.json", load_mosaic(stored))
    assert (stored.parent / "again.json").read_bytes() == stored.read_bytes()


def test_a_bracket_that_changed_or_went_is_refused(stored: Path) -> None:
    frame = load_mosaic(stored).frames[0]
    (stored.parent / "A_2.png").write_bytes((stored.parent / "B_2.png").read_bytes())
    with pytest.raises(InputError, match=r"A_2\.png: is not the bracket that it was"):
        frame.load()
    (stored.parent / "A_0.png").unlink()
    with pytest.raises(InputError, match=r"A_0\.png: there is no such file"):
        frame.load()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda frame: frame.update(brackets=[]), "brackets are 0; a frame is merged of two or more"),
        (lambda frame: frame.update(brackets=frame["brackets"][:1]), "brackets are 1;"),
        (lambda frame: frame.update(brackets={}), "brackets is not a list"),
        (lambda frame: frame["brackets"][0].update(sha=1), r"brackets\[0\]: the key 'sha' is unknown"),
        (lambda frame: frame["brackets"][1].pop("exposure_ev"), r"brackets\[1\]: the key 'exposure_ev' is missing"),
        (
            lambda frame: frame["brackets"][1].update(exposure_ev=1e9),
            r"brackets\[1\]: exposure_ev is 1e\+09, not between",
        ),
        (lambda frame: frame["brackets"][1].update(image=""), r"brackets\[1\]: image is '', not the path"),
        (
            lambda frame: frame["brackets"][2].update(image="A_0.png"),
            r"brackets\[2\]: image is that of another bracket",
        ),
        (lambda frame: frame.update(image="A_9.png"), "image and sha256 are those of none of its brackets"),
        (lambda frame: frame.update(response_ev=[0.0] * 10), "response_ev is not a list of 11 numbers"),
        (lambda frame: frame.update(response_ev=[0.0] * 10 + [-9.0]), "response_ev: the light does not rise"),
        (lambda frame: frame.update(response_ev=[0.0] * 10 + [99.0]), "response_ev: the light does not rise"),
        (lambda frame: [frame.update(response_ev=[0.0] * 11), frame.pop("brackets")], "response_ev is about brackets"),
        (lambda frame: frame.update(sha256=""), "image and sha256 are those of none of its brackets"),
    ],
)
def test_what_are_no_brackets_is_refused_by_the_key(
    stored: Path, change: Callable[[dict[str, Any]], Any], message: str
) -> None:
    value = json.loads(stored.read_text())
    change(value["frames"][0])
    stored.write_text(json.dumps(value))
    with pytest.raises(InputError, match=rf"frames\[0\]: {message}"):
        load_mosaic(stored)
