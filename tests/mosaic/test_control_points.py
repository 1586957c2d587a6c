"""Hugin projects adjusted by their control points alone: what is known is found again, what was stored is improved."""

import dataclasses
import math
import os
from pathlib import Path

import numpy as np
import pytest
from turning import matched, ring, turn_between, turned

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import Equidistant, FloatArray, KannalaBrandt
from fullsphere.mosaic.control_points import distances, register_points
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.pto import Project, read_pto
from fullsphere.mosaic.pto_write import write_pto

SHARED = Path(os.environ.get("FULLSPHERE_SHARED", Path(__file__).resolve().parents[2].parent / "shared"))
GEAR360 = SHARED / "data" / "frames" / "gear360"

TRUE = Camera(KannalaBrandt(300, -0.03, 0.004, 0, 0), (1000, 1000), (503.1, 496.2), half_fov=math.radians(97))
ROTATIONS = ring(8)
NOISE_PX = 0.2


def project_with(
    folder: Path, start: FloatArray, camera: Camera = TRUE, count: int = 60, outliers: float = 0.0
) -> Project:
    """A project of eight pictures whose control points the true camera took, with other orientations and camera."""
    frames = [
        Frame(f"{k}", str(folder / f"{k}.jpg"), TRUE.size, lambda: np.empty(0), camera_from_world=rotation)
        for k, rotation in enumerate(start)
    ]
    links = matched(TRUE, ROTATIONS, count=count, noise_px=NOISE_PX, outliers=outliers)
    write_pto(folder / "a.pto", Mosaic((camera,), tuple(frames), tuple(links)), overwrite=True)
    return read_pto(folder / "a.pto")


def found(mosaic: Mosaic) -> FloatArray:
    return np.array([frame.camera_from_world for frame in mosaic.frames])


def relative(rotations: FloatArray) -> FloatArray:
    """Each as seen from the first: where the world's own orientation does not count."""
    return np.asarray(rotations @ rotations[0].T)


@pytest.mark.parametrize("off_deg", [1.0, 60.0])
def test_orientations_are_found_from_those_of_the_project_and_without(tmp_path: Path, off_deg: float) -> None:
    mosaic = register_points(project_with(tmp_path, turned(ROTATIONS, off_deg)), refine=False)
    assert mosaic.cameras[0].lens == TRUE.lens
    assert not mosaic.self_calibrated
    assert turn_between(relative(found(mosaic)), relative(ROTATIONS)).max() < 0.2 * NOISE_PX / 300


def test_a_rough_lens_is_refined(tmp_path: Path) -> None:
    rough = Camera(Equidistant(310), TRUE.size, (500, 500), half_fov=math.radians(97))
    mosaic = register_points(project_with(tmp_path, turned(ROTATIONS, 2), rough))
    camera = mosaic.cameras[0]
    theta = np.radians(np.linspace(0, 93, 50))
    assert mosaic.self_calibrated
    assert np.abs(camera.lens.radius(theta) - TRUE.lens.radius(theta)).max() < 0.3
    assert np.allclose(camera.centre, TRUE.centre, rtol=0, atol=0.1)
    assert camera.aspect == 1
    assert turn_between(relative(found(mosaic)), relative(ROTATIONS)).max() < NOISE_PX / 300
    assert 0.5 * NOISE_PX < mosaic.quality["residual_median_px"] < 1.5 * NOISE_PX


def test_a_few_points_leave_the_lens_as_it_is(tmp_path: Path) -> None:
    rough = Camera(Equidistant(310), TRUE.size, (500, 500), half_fov=math.radians(97))
    project = project_with(tmp_path, ROTATIONS, rough, count=8)
    few = dataclasses.replace(project, points=project.points.where(np.arange(len(project.points.i)) < 40))
    assert register_points(few).cameras == project.cameras


def test_wrong_points_do_not_matter(tmp_path: Path) -> None:
    mosaic = register_points(project_with(tmp_path, turned(ROTATIONS, 1), outliers=0.1))
    assert turn_between(relative(found(mosaic)), relative(ROTATIONS)).max() < NOISE_PX / 300


def test_the_world_stays_that_of_the_project(tmp_path: Path) -> None:
    start = turned(ROTATIONS, 0.5, seed=3)
    mosaic = register_points(project_with(tmp_path, start), refine=False)
    drift = np.swapaxes(found(mosaic), 1, 2) @ start
    assert np.linalg.norm(np.mean(drift - np.swapaxes(drift, 1, 2), axis=0)) < 1e-3  # the mean turn is none
    assert mosaic.level == "hugin"


def test_pictures_without_points_are_left_out(tmp_path: Path) -> None:
    project = project_with(tmp_path, ROTATIONS)
    joined = (project.points.i != 5) & (project.points.j != 5)
    mosaic = register_points(dataclasses.replace(project, points=project.points.where(joined)), refine=False)
    assert [frame.id for frame in mosaic.frames if not frame.registered] == ["5"]
    assert mosaic.frames[5].reason == "no control points join it to the other pictures"
    none = dataclasses.replace(project, points=project.points.where(np.zeros(len(joined), bool)))
    with pytest.raises(GeometryError, match="has no control points between two of its pictures"):
        register_points(none)


def test_distances_are_angles_between_rays(tmp_path: Path) -> None:
    project = project_with(tmp_path, ROTATIONS)
    true = distances(project, ROTATIONS, project.cameras)
    assert np.median(true) == pytest.approx(NOISE_PX * math.sqrt(2 * math.log(2)) * math.sqrt(2) / 300, rel=0.3)
    moved = ROTATIONS.copy()
    moved[0] = moved[0] @ project_turn(0.1)
    apart = distances(project, moved, project.cameras)[project.points.i == 0]
    assert 0.02 < apart.mean() < 0.1
    hugins = distances(project, ROTATIONS)
    assert np.abs(hugins - true).max() < 0.01


def project_turn(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.mark.skipif(not GEAR360.exists(), reason="../shared/data is not here")
@pytest.mark.parametrize("name", ["Camera_Low_Rez_Calibrate.pto", "New_Dual_Remap_Calibrate.pto"])
def test_a_real_project_comes_out_better_than_its_own_solution(name: str) -> None:
    project = read_pto(GEAR360 / name)
    mosaic = register_points(project)
    stored, ours = distances(project, project.rotations), distances(project, found(mosaic), mosaic.cameras)
    assert np.isfinite(stored).all() and np.isfinite(ours).all()
    assert ours.mean() <= stored.mean()
    assert np.median(ours) <= np.median(stored)
