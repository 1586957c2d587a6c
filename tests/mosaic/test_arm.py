import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.errors import UsageError
from fullsphere.model.lens import Equidistant
from fullsphere.mosaic.arm import ArmTurn, mount_angles, mount_of, positions, turned
from fullsphere.mosaic.project import Frame

CAMERA = Camera(Equidistant(50.0), (200, 200), (99.5, 99.5), half_fov=1.6)


def frames(count: int) -> tuple[Frame, ...]:
    return tuple(Frame(str(k), "", CAMERA.size, lambda: np.zeros((200, 200, 3), np.uint8)) for k in range(count))


def test_a_straight_camera_looks_outward_along_the_arm() -> None:
    angles = np.linspace(0, 6, 13)
    turn = ArmTurn(CAMERA, frames(13), angles)
    ahead = np.einsum("nji,j->ni", turn.camera_from_world(angles), [0.0, 0, 1])
    np.testing.assert_allclose(ahead, positions(angles), atol=1e-12)


def test_rays_at_right_angles_to_the_axis_touch_the_circle_of_positions() -> None:
    psi = np.linspace(-3, 3, 7)
    across = np.stack([np.cos(psi), -np.sin(psi), np.zeros_like(psi)], -1)
    rays = across @ turned(0.7).T
    np.testing.assert_allclose(rays[:, [0, 2]] @ positions(0.7)[[0, 2]], 0, atol=1e-12)


def test_mount_angles_invert_mount_of() -> None:
    yaw, pitch, roll = 0.02, -0.013, 0.4
    np.testing.assert_allclose(mount_angles(mount_of(yaw, pitch, roll)), [yaw, pitch, roll], atol=1e-14)


def test_a_camera_pitched_up_looks_above_the_horizon() -> None:
    turn = ArmTurn(CAMERA, frames(1), np.zeros(1), mount_of(0, 0.1, 0))
    assert turn.camera_from_world(1.2)[2][1] == pytest.approx(-np.sin(0.1))


def test_gaps_close_the_turn() -> None:
    turn = ArmTurn(CAMERA, frames(3), np.array([0.5, 1.0, 3.0]))
    np.testing.assert_allclose(turn.gaps, [0.5, 2.0, 2 * np.pi - 2.5])


@pytest.mark.parametrize("angles", [[0.0], [0.0, 1.0, 0.5], [0.0, 1.0, np.nan], [0.0, 1.0, 6.5]])
def test_angles_that_are_no_turn_are_refused(angles: list[float]) -> None:
    with pytest.raises(UsageError, match="turn"):
        ArmTurn(CAMERA, frames(3), np.array(angles))
