"""What becomes of picture files: frames, or the reason why not."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from picture_files import SIZE, disc, picture_file, scene

from fullsphere.model.errors import InputError
from fullsphere.model.images import read_picture
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.frames import open_frames
from fullsphere.mosaic.masks import open_masks


def written(folder: Path, count: int, ending: str = ".png") -> list[Path]:
    return [picture_file(folder / f"f{k}{ending}", scene(k)) for k in range(count)]


def test_frames_come_in_the_order_given_with_the_pixels_of_their_files(tmp_path: Path) -> None:
    paths = written(tmp_path, 12)[::-1]
    with thread_pool(2) as executor:
        frames = open_frames(paths, executor=executor)
    assert [frame.id for frame in frames] == [path.name for path in paths]
    for path, frame in zip(paths, frames, strict=True):
        assert frame.size == SIZE and not frame.reason and len(frame.sha256) == 64
        assert np.array_equal(frame.load(), read_picture(path).pixels)


def test_a_frame_can_be_sent_to_another_process(tmp_path: Path) -> None:
    frame = open_frames(written(tmp_path, 2))[1]
    assert np.array_equal(pickle.loads(pickle.dumps(frame)).load(), scene(1))


def test_two_files_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    paths = [picture_file(tmp_path / folder / "f.png", scene(k)) for k, folder in enumerate("ab")]
    assert [frame.id for frame in open_frames(paths)] == [path.as_posix() for path in paths]


@pytest.mark.parametrize(
    ("orientation", "turns"), [(1, 0), (2, 0), (3, 2), (4, 2), (5, 1), (6, 1), (7, 3), (8, 3), (9, 0)]
)
def test_exif_orientation_leaves_the_pixels_and_tells_what_is_up(tmp_path: Path, orientation: int, turns: int) -> None:
    plain = picture_file(tmp_path / "plain.jpg", scene(0))
    tagged = picture_file(tmp_path / "tagged.jpg", scene(1), orientation)
    frames = open_frames([plain, tagged])
    assert [frame.quarter_turns for frame in frames] == [0, turns]
    assert [frame.size for frame in frames] == [SIZE, SIZE] and not any(frame.reason for frame in frames)
    assert np.array_equal(frames[1].load(), read_picture(tagged).pixels)


def test_orientation_is_how_a_viewer_turns_the_picture(tmp_path: Path) -> None:
    """The definition of EXIF: with 6 the first row is the right side as seen, with 8 the left, with 3 the bottom."""
    for orientation, side in ((6, "right"), (8, "left"), (3, "bottom")):
        pixels = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        pixels[:4] = 255
        path = picture_file(tmp_path / f"{orientation}.jpg", pixels, orientation)
        other = picture_file(tmp_path / f"other{orientation}.jpg", scene(0))
        frame = open_frames([path, other])[0]
        upright = np.rot90(frame.load(), -frame.quarter_turns)
        lit = {"right": upright[:, -2], "left": upright[:, 1], "bottom": upright[-2]}[side]
        assert lit.min() > 200


def test_mixed_sizes_leave_the_fewer_out_and_say_both_sizes(tmp_path: Path) -> None:
    paths = [*written(tmp_path, 3), picture_file(tmp_path / "small.png", scene(7, (24, 16)))]
    frames = open_frames(paths)
    assert [bool(frame.reason) for frame in frames] == [False, False, False, True]
    assert frames[3].reason == "is 24 x 16 pixels, most frames have 48 x 32"


def test_sizes_that_differ_by_a_few_pixels_are_cut_to_what_all_have(tmp_path: Path) -> None:
    sizes = [(300, 200), (300, 200), (298, 202), (303, 200), (300, 200), (300, 210)]
    frames = open_frames([picture_file(tmp_path / f"f{k}.png", scene(k, size)) for k, size in enumerate(sizes)])
    assert [frame.size for frame in frames[:5]] == [(298, 200)] * 5 and not any(frame.reason for frame in frames[:5])
    assert frames[5].reason == "is 300 x 210 pixels, most frames have 298 x 200"
    assert [frame.crop_px for frame in frames[:4]] == [
        (1, 0, 298, 200),
        (1, 0, 298, 200),
        (0, 1, 298, 200),
        (2, 0, 298, 200),
    ]
    assert np.array_equal(frames[3].load(), scene(3, (303, 200))[:, 2:300])


def test_a_turned_file_is_cut_like_the_others(tmp_path: Path) -> None:
    paths = [picture_file(tmp_path / f"f{k}.png", scene(k, (300, 200))) for k in range(2)]
    paths += [picture_file(tmp_path / "small.png", scene(3, (298, 198)))]
    turned = picture_file(tmp_path / "turned.png", np.ascontiguousarray(np.rot90(scene(9, (300, 200)))))
    frame = open_frames([*paths, turned])[3]
    assert frame.size == (298, 198) and frame.turned == 1
    assert np.array_equal(frame.load(), scene(9, (300, 200))[1:199, 1:299])


def test_a_camera_asks_for_its_size_to_the_pixel(tmp_path: Path) -> None:
    sizes = [(300, 200), (300, 200), (301, 200)]
    paths = [picture_file(tmp_path / f"f{k}.png", scene(k, size)) for k, size in enumerate(sizes)]
    assert [bool(frame.reason) for frame in open_frames(paths, (300, 200))] == [False, False, True]


def test_frames_of_another_size_than_the_camera_are_left_out(tmp_path: Path) -> None:
    paths = [*written(tmp_path, 3), *(picture_file(tmp_path / f"s{k}.png", scene(k, (24, 16))) for k in range(2))]
    frames = open_frames(paths, (24, 16))
    assert [bool(frame.reason) for frame in frames] == [True] * 3 + [False] * 2
    assert "the camera is for 24 x 16" in frames[0].reason


def test_the_same_bytes_under_another_name_are_left_out(tmp_path: Path) -> None:
    paths = written(tmp_path, 2)
    (tmp_path / "copy.png").write_bytes(paths[0].read_bytes())
    frames = open_frames([*paths, tmp_path / "copy.png"])
    assert [frame.reason for frame in frames] == ["", "", "is the same file as f0.png"]
    again = open_frames([*paths, paths[0]])
    assert [frame.reason for frame in again] == ["", "", "is f0.png given again"]
    assert [frame.id for frame in again] == ["f0.png", "f1.png", "f0.png:2"]


def test_damaged_files_are_left_out_by_name(tmp_path: Path) -> None:
    paths = written(tmp_path, 2, ".jpg")
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "cut.jpg").write_bytes(paths[0].read_bytes()[:-700])
    (tmp_path / "notes.jpg").write_bytes(b"no picture at all")
    frames = open_frames([*paths, *(tmp_path / f"{name}.jpg" for name in ("empty", "cut", "notes"))])
    empty, cut, notes = (frame.reason for frame in frames[2:])
    assert "is empty" in empty and "damaged or cut short" in cut and "is not a picture" in notes
    assert not any(frame.registered for frame in frames)


def test_one_frame_is_no_mosaic(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least two frames, and 1 of the 1 given"):
        open_frames(written(tmp_path, 1))
    with pytest.raises(InputError, match=r"1 of the 2 given can be used \(copy.png: is the same file as f0.png\)"):
        (tmp_path / "copy.png").write_bytes((tmp_path / "f0.png").read_bytes())
        open_frames([tmp_path / "f0.png", tmp_path / "copy.png"])


def test_a_name_that_is_no_file_ends_the_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing\.jpg: there is no such file"):
        open_frames([*written(tmp_path, 2), tmp_path / "missing.jpg"])


@pytest.mark.parametrize("turn", [1, 3])
@pytest.mark.parametrize("told", [True, False])
def test_a_file_turned_by_a_program_is_turned_back_so_that_its_circle_fits(
    tmp_path: Path, turn: int, told: bool
) -> None:
    size, centre = (300, 200), (138.0, 103.0)
    paths = [picture_file(tmp_path / f"f{k}.png", disc(centre, 90, size, k)) for k in range(3)]
    stored = disc(centre, 90, size, 9)
    turned = picture_file(tmp_path / "turned.png", np.ascontiguousarray(np.rot90(stored, turn)))
    frames = open_frames([*paths, turned], size if told else None, centre_px=centre if told else None)
    frame = frames[3]
    assert not frame.reason and frame.size == size and frame.turned == turn
    assert np.array_equal(frame.load(), stored)
    assert np.array_equal(np.rot90(frame.load(), -frame.quarter_turns), np.rot90(stored, turn)), "as shown by its file"


def test_without_a_circle_a_turned_file_is_turned_clockwise(tmp_path: Path) -> None:
    turned = picture_file(tmp_path / "turned.png", scene(9, SIZE[::-1]))
    frame = open_frames([*written(tmp_path, 2), turned])[2]
    assert not frame.reason and frame.size == SIZE and frame.turned == 1
    assert np.array_equal(frame.load(), np.rot90(scene(9, SIZE[::-1]), -1))


def test_of_portrait_and_landscape_the_more_are_the_cameras(tmp_path: Path) -> None:
    tall = [picture_file(tmp_path / f"t{k}.png", scene(10 + k, SIZE[::-1])) for k in range(3)]
    frames = open_frames([*written(tmp_path, 2), *tall])
    assert {frame.size for frame in frames} == {SIZE[::-1]}
    assert [frame.turned for frame in frames] == [1, 1, 0, 0, 0]


def test_pitch_and_roll_of_a_file_are_its_gravity_and_with_a_heading_its_prior(tmp_path: Path) -> None:
    level = 'GPano:PosePitchDegrees="0" GPano:PoseRollDegrees="0"'
    east = 'GPano:PoseHeadingDegrees="90" GPano:PosePitchDegrees="0" GPano:PoseRollDegrees="0"'
    paths = [
        picture_file(tmp_path / "none.jpg", scene(0)),
        picture_file(tmp_path / "level.jpg", scene(1), xmp=level),
        picture_file(tmp_path / "east.jpg", scene(2), xmp=east),
        picture_file(tmp_path / "east-portrait.jpg", scene(3), 6, east),
    ]
    none, level_frame, frame, portrait = open_frames(paths)
    assert none.prior is None and none.gravity is None
    assert level_frame.prior is None and level_frame.gravity is not None
    assert np.allclose(level_frame.gravity, [0, 1, 0])
    assert frame.prior is not None and np.allclose(frame.prior @ [1, 0, 0], [0, 0, 1], atol=1e-12)
    # shown turned clockwise: what is down in the world is at the right of the picture as stored
    assert portrait.gravity is not None and np.allclose(portrait.gravity, [1, 0, 0], atol=1e-12)
    assert portrait.prior is not None and np.allclose(portrait.prior @ [1, 0, 0], [0, 0, 1], atol=1e-12)


def test_gravity_turns_with_a_file_that_is_turned_back(tmp_path: Path) -> None:
    level = 'GPano:PosePitchDegrees="0" GPano:PoseRollDegrees="0"'
    upright = picture_file(tmp_path / "turned.jpg", scene(3, SIZE[::-1]), xmp=level)
    frame = open_frames([*written(tmp_path, 2), upright])[2]
    assert frame.turned == 1 and frame.gravity is not None
    assert np.allclose(frame.gravity, [-1, 0, 0], atol=1e-12)  # turned clockwise: what was below is at the left


def test_one_mask_is_for_all_frames_as_the_camera_holds_them(tmp_path: Path) -> None:
    mask = np.zeros((SIZE[1], SIZE[0], 1), np.uint8)
    mask[4:9, 5:40] = 255
    turned = picture_file(tmp_path / "turned.png", scene(9, SIZE[::-1]))
    masks = open_masks(picture_file(tmp_path / "mask.png", mask))
    for frame in open_frames([*written(tmp_path, 2), turned], masks=masks):
        assert frame.mask is not None and np.array_equal(frame.mask(), mask[..., 0])
        assert frame.mask_image == str(tmp_path / "mask.png")


def test_a_folder_holds_masks_of_single_frames_as_their_files_are(tmp_path: Path) -> None:
    own = np.zeros((SIZE[0], SIZE[1], 1), np.uint8)
    own[:, :6] = 255
    picture_file(tmp_path / "turned_mask.png", own)
    turned = picture_file(tmp_path / "turned.png", scene(9, SIZE[::-1]))
    frames = open_frames([*written(tmp_path, 2), turned], masks=open_masks(tmp_path))
    assert frames[0].mask is None and frames[0].mask_image == ""
    assert frames[2].mask is not None
    assert np.array_equal(frames[2].mask(), np.rot90(own[..., 0], -frames[2].turned))


def test_masks_of_the_wrong_size_name_both_sizes(tmp_path: Path) -> None:
    mask = picture_file(tmp_path / "mask.png", np.full((10, 20, 1), 255, np.uint8))
    with pytest.raises(InputError, match=r"mask\.png: is a mask of 20 x 10 pixels, f0\.png has 48 x 32"):
        open_frames(written(tmp_path, 2), masks=open_masks(mask))


def test_masks_that_leave_nothing_or_belong_to_no_frame_are_refused(tmp_path: Path) -> None:
    paths = written(tmp_path, 2)
    black = picture_file(tmp_path / "mask.png", np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
    with pytest.raises(InputError, match=r"mask\.png: is black all over f0\.png"):
        open_frames(paths, masks=open_masks(black))
    with pytest.raises(InputError, match="holds a mask of none of the frames"):
        open_frames(paths, masks=open_masks(tmp_path))
    with pytest.raises(InputError, match="there is no such mask"):
        open_masks(tmp_path / "missing.png")


def test_grey_is_halved_and_what_is_transparent_does_not_count(tmp_path: Path) -> None:
    mask = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    mask[:, :10] = [0, 128, 0, 255]
    mask[:, 10:20] = [127, 127, 127, 255]
    mask[:, 20:30] = [255, 255, 255, 0]
    frames = open_frames(written(tmp_path, 2), masks=open_masks(picture_file(tmp_path / "mask.png", mask)))
    assert frames[0].mask is not None
    assert np.array_equal(np.unique(np.nonzero(frames[0].mask())[1]), np.arange(10))
    assert set(np.unique(frames[0].mask())) == {0, 255}
