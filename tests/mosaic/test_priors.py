"""Angles told beforehand: tables of them, and what they mean."""

from pathlib import Path

import numpy as np
import pytest
from turning import frame_of, orientation

from fullsphere.model.errors import InputError
from fullsphere.model.pose_metadata import ToldPose
from fullsphere.mosaic.orientation_tag import turned_from_stored
from fullsphere.mosaic.priors import camera_from_world, read_priors, with_prior, with_priors
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.store import yaw_pitch_roll_deg


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "poses.csv"
    path.write_text(text, encoding="utf-8")
    return path


def frames(*names: str) -> list[Frame]:
    return [frame_of(name, np.zeros((4, 6, 3), np.uint8)) for name in names]


def test_angles_are_those_of_a_mosaic_file() -> None:
    told = camera_from_world(ToldPose(123.0, -35.0, 12.0))
    assert np.allclose(told, orientation(123.0, -35.0, 12.0))
    assert np.allclose(yaw_pitch_roll_deg(told), (123.0, -35.0, 12.0))


def test_a_table_is_read_by_the_names_of_its_columns(tmp_path: Path) -> None:
    path = table(tmp_path, "\ufeffpitch_deg, name ,note,yaw_deg\n10,a.jpg,tall,-90\n\n-5, b ,,\n")
    assert read_priors(path) == {"a.jpg": ToldPose(-90, 10, 0), "b": ToldPose(None, -5, 0)}
    rolled = table(tmp_path, "name,yaw_deg,pitch_deg,roll_deg\na,1,2,3\n")
    assert read_priors(rolled) == {"a": ToldPose(1, 2, 3)}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1 has no column name, yaw_deg, pitch_deg"),
        ("name;yaw_deg;pitch_deg\na;1;2\n", "line 1 has no column"),
        ("name,yaw_deg,pitch_deg,yaw_deg\n", "line 1 has column yaw_deg twice"),
        ("name,yaw_deg,pitch_deg\n", "tells of no frame"),
        ("name,yaw_deg,pitch_deg\na,1,2\nb,1\n", "line 3 has 2 fields, line 1 has 3"),
        ("name,yaw_deg,pitch_deg\na,1,2\na,1,2\n", "line 3 tells of a once more"),
        ("name,yaw_deg,pitch_deg\n,1,2\n", "line 2, column name: empty"),
        ("name,yaw_deg,pitch_deg\na,east,2\n", "line 2, column yaw_deg: 'east' is not a number"),
        ("name,yaw_deg,pitch_deg\na,nan,2\n", "line 2, column yaw_deg: nan is not between -360 and 360"),
        ("name,yaw_deg,pitch_deg\na,0,91\n", "line 2, column pitch_deg: 91 is not between -90 and 90"),
        ("name,yaw_deg,pitch_deg\na,0,\n", "line 2, column pitch_deg: '' is not a number"),
        ("name,yaw_deg,pitch_deg,roll_deg\na,0,0,1e9\n", "line 2, column roll_deg: 1e9 is not between"),
        ('name,yaw_deg,pitch_deg\n"a,0,0\n', "not a text table"),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError) as refusal:
        read_priors(table(tmp_path, text))
    assert says in str(refusal.value) and "poses.csv" in str(refusal.value)


def test_a_table_that_is_no_text_or_is_missing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "poses.csv").write_bytes(b"name,yaw_deg,pitch_deg\n\xff\xfe,1,2\n")
    with pytest.raises(InputError, match="not a text table"):
        read_priors(tmp_path / "poses.csv")
    with pytest.raises(InputError, match="there is no such file"):
        read_priors(tmp_path / "missing.csv")


def test_frames_are_found_with_and_without_their_ending_and_others_stay(tmp_path: Path) -> None:
    priors = {"a.jpg": ToldPose(10, 20, 0), "b": ToldPose(None, 0, 90), "elsewhere": ToldPose(0, 0, 0)}
    a, b, c = with_priors(frames("a.jpg", "b.jpg", "c.jpg"), priors, tmp_path)
    assert a.prior is not None and np.allclose(a.prior, orientation(10, 20))
    assert b.prior is None and b.gravity is not None
    assert np.allclose(b.gravity, [1, 0, 0])  # rolled clockwise: the right side is below
    assert c.prior is None and c.gravity is None


def test_a_table_takes_the_place_of_what_the_files_tell(tmp_path: Path) -> None:
    told = [with_prior(frame, ToldPose(1, 2, 3)) for frame in frames("a.jpg", "b.jpg")]
    a, b = with_priors(told, {"a": ToldPose(None, 0, 0)}, tmp_path)
    assert a.prior is None and b.prior is not None and np.allclose(b.prior, orientation(1, 2, 3))


def test_names_that_are_of_no_frame_or_of_one_twice_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none of which is a frame; .* a\.jpg for example"):
        with_priors(frames("a.jpg"), {"x": ToldPose(0, 0, 0)}, tmp_path)
    with pytest.raises(InputError, match=r"tells of a\.jpg as a\.jpg and as a;"):
        with_priors(frames("a.jpg"), {"a": ToldPose(0, 0, 0), "a.jpg": ToldPose(0, 0, 0)}, tmp_path)
    with pytest.raises(InputError, match="none of which is a frame"):  # whose is it?
        with_priors(frames("a.jpg", "a.png"), {"a": ToldPose(0, 0, 0)}, tmp_path)


@pytest.mark.parametrize("turns", range(4))
def test_turning_a_picture_turns_its_pixels_and_its_rays_alike(turns: int) -> None:
    """The corner of a square picture around the axis goes where the turned picture has it."""
    marked = np.zeros((5, 5))
    marked[0, 1] = 1
    (v, u), (turned_v, turned_u) = (np.argwhere(np.rot90(marked, -k))[0] - 2 for k in (0, turns))
    assert np.array_equal(turned_from_stored(turns) @ [u, v, 1], [turned_u, turned_v, 1])
