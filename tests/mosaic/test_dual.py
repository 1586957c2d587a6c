"""Dual-fisheye pictures: two frames of each, and which pictures are none."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from picture_files import disc, picture_file, scene

from fullsphere.model.errors import InputError
from fullsphere.model.images import read_picture
from fullsphere.mosaic.dual import open_dual_frames
from fullsphere.mosaic.masks import open_masks

HALF = (200, 200)
SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[2].parent / "shared"))
PHOTOS = SHARED / "data" / "frames" / "gear360"


def dual(seed: int, axis: int = 1) -> NDArray[np.uint8]:
    """Two circles side by side, or one above the other with axis 0."""
    one, other = disc((98.0, 101.0), 97, HALF, 2 * seed), disc((103.0, 99.0), 95, HALF, 2 * seed + 1)
    return np.concatenate([one, other], axis)


def test_a_picture_is_two_frames_of_one_shot_by_two_cameras(tmp_path: Path) -> None:
    path = picture_file(tmp_path / "d.png", dual(0))
    left, right = open_dual_frames([path])
    assert (left.id, right.id) == ("d.png:left", "d.png:right")
    assert (left.camera, right.camera) == (0, 1) and left.shot == right.shot == "d.png"
    assert left.crop_px == (0, 0, 200, 200) and right.crop_px == (200, 0, 200, 200)
    assert left.size == right.size == HALF and left.sha256 == right.sha256
    assert np.array_equal(np.hstack([left.load(), right.load()]), read_picture(path).pixels)


def test_circles_may_stand_one_above_the_other(tmp_path: Path) -> None:
    top, bottom = open_dual_frames([picture_file(tmp_path / "d.png", dual(0, axis=0))])
    assert (top.id, bottom.id) == ("d.png:top", "d.png:bottom")
    assert np.array_equal(np.vstack([top.load(), bottom.load()]), dual(0, axis=0))


def test_pictures_that_do_not_fit_are_left_out_with_both_halves(tmp_path: Path) -> None:
    paths = [picture_file(tmp_path / f"d{k}.png", dual(k)) for k in range(2)]
    (tmp_path / "copy.png").write_bytes(paths[0].read_bytes())
    (tmp_path / "empty.png").write_bytes(b"")
    panorama = picture_file(tmp_path / "panorama.png", scene(3, (400, 200)))
    small = picture_file(tmp_path / "small.png", scene(4, (100, 50)))
    frames = open_dual_frames([*paths, tmp_path / "copy.png", tmp_path / "empty.png", panorama, small])
    reasons = {frame.id: frame.reason for frame in frames if frame.reason}
    assert [frame.id for frame in frames if not frame.reason] == [
        f"d{k}.png:{s}" for k in (0, 1) for s in ("left", "right")
    ]
    assert reasons.pop("copy.png:left") == reasons.pop("copy.png:right") == "is the same file as d0.png"
    assert "is empty" in reasons.pop("empty.png")
    assert reasons.pop("panorama.png:left") == reasons.pop("panorama.png:right")
    assert reasons.pop("small.png:left") == "is 100 x 50 pixels, most pictures have 400 x 200"
    assert list(reasons) == ["small.png:right"]


def test_the_size_of_a_half_may_be_asked_for(tmp_path: Path) -> None:
    paths = [picture_file(tmp_path / f"d{k}.png", dual(k)) for k in range(2)]
    assert not any(frame.reason for frame in open_dual_frames(paths, HALF))
    with pytest.raises(InputError, match="is 400 x 200 pixels, the cameras are for two halves in 800 x 400"):
        open_dual_frames(paths, (400, 400))


@pytest.mark.parametrize("size", [(201, 100), (200, 200)])
def test_what_has_no_equal_halves_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    path = picture_file(tmp_path / "d.png", scene(0, size))
    with pytest.raises(InputError, match=f"{size[0]} x {size[1]} pixels, which cannot be cut into two equal halves"):
        open_dual_frames([path])


def test_a_panorama_alone_is_refused(tmp_path: Path) -> None:
    path = picture_file(tmp_path / "p.png", scene(0, (400, 200)))
    with pytest.raises(InputError, match="does not show two image circles side by side"):
        open_dual_frames([path])


def test_a_mask_is_of_the_whole_picture(tmp_path: Path) -> None:
    path = picture_file(tmp_path / "d.png", dual(0))
    mask = np.full((200, 400, 1), 255, np.uint8)
    mask[:, 300:] = 0
    left, right = open_dual_frames([path], masks=open_masks(picture_file(tmp_path / "mask.png", mask)))
    assert left.mask is not None and right.mask is not None
    assert left.mask().all() and np.array_equal(right.mask(), mask[:, 200:, 0])
    with pytest.raises(InputError, match=r"is a mask of 200 x 100 pixels, d\.png:left has 400 x 200"):
        open_dual_frames([path], masks=open_masks(picture_file(tmp_path / "low.png", mask[:100, :200])))


def test_a_mask_of_one_half_is_for_both(tmp_path: Path) -> None:
    path = picture_file(tmp_path / "d.png", dual(0))
    mask = np.full((200, 200, 1), 255, np.uint8)
    mask[150:] = 0
    for half in open_dual_frames([path], masks=open_masks(picture_file(tmp_path / "mask.png", mask))):
        assert half.mask is not None and np.array_equal(half.mask(), mask[..., 0])


@pytest.mark.skipif(not PHOTOS.is_dir(), reason="no photos of a dual-fisheye camera here")
def test_photos_of_a_dual_fisheye_camera_are_taken_apart() -> None:
    for name, half in (("gear360-carpark-3840x1920.jpg", (1920, 1920)), ("gear360-street-2560x1280.png", (1280, 1280))):
        frames = open_dual_frames([PHOTOS / name])
        assert [frame.size for frame in frames] == [half, half] and not any(frame.reason for frame in frames)
