"""Poses in the XMP packets of pictures."""

from pathlib import Path

import pytest
from picture_files import picture_file, scene

from fullsphere.model.errors import InputError
from fullsphere.model.pose_metadata import ToldPose, told_pose

PITCHED = 'GPano:PosePitchDegrees="-3.5" GPano:PoseRollDegrees="2"'
DRONE = (
    'drone-dji:GimbalYawDegree="-12.50" drone-dji:GimbalPitchDegree="+30.00" drone-dji:GimbalRollDegree="+0.00" '
    'drone-dji:FlightYawDegree="80"'
)


@pytest.mark.parametrize(
    ("xmp", "pose"),
    [
        ("", None),
        (PITCHED, ToldPose(None, -3.5, 2.0)),
        (f'{PITCHED} GPano:PoseHeadingDegrees="123.5"', ToldPose(123.5, -3.5, 2.0)),
        (DRONE, ToldPose(-12.5, 30.0, 0.0)),
        (DRONE.replace("+0.00", "+180.00"), None),
        (DRONE.replace("+0.00", "-35.00"), ToldPose(-12.5, 30.0, -35.0)),
        (PITCHED.replace('"2"', '"180"'), ToldPose(None, -3.5, 180.0)),
        (f"{DRONE} {PITCHED}", ToldPose(None, -3.5, 2.0)),
        ('GPano:PoseHeadingDegrees="123.5"', None),
        ('drone-dji:GimbalPitchDegree="steep" drone-dji:GimbalRollDegree="2"', None),
        ('GPano:PosePitchDegrees="nan" GPano:PoseRollDegrees="2"', None),
        ('GPano:PosePitchDegrees="120" GPano:PoseRollDegrees="2"', None),
        ('GPano:PosePitchDegrees="1" GPano:PoseRollDegrees="1e30"', None),
    ],
)
def test_a_pose_is_what_the_packet_tells_with_pitch_and_roll(tmp_path: Path, xmp: str, pose: ToldPose | None) -> None:
    assert told_pose(picture_file(tmp_path / "a.jpg", scene(0), xmp=xmp)) == pose


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"")
    with pytest.raises(InputError, match="is empty"):
        told_pose(tmp_path / "a.jpg")
