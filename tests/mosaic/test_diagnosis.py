"""What is wrong with a set is said in plain words, and nothing is said of a good one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from turning import frame_of, orientation
from walking import evidence_of, room_points

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.mosaic.diagnosis import diagnose, named
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.links import Evidence
from fullsphere.mosaic.moving_things import moving_things
from fullsphere.mosaic.parallax import parallaxes
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.solution import solve_links
from fullsphere.mosaic.viewpoints import pairs_to_compare
from fullsphere.mosaic.wrong_lens import wrong_lens
from laws import fisheye

CAMERA = fisheye(900)
POINTS = room_points(900)
TURN = np.array([orientation(yaw, pitch) for yaw, pitch in ((0, 4), (75, -6), (140, 5), (215, -3), (288, 6))])
STILL = np.zeros((5, 3))


def seen(positions: FloatArray = STILL, rotations: FloatArray = TURN, noise_px: float = 0.25) -> Evidence:
    return evidence_of(CAMERA, rotations, positions, POINTS, noise_px)


def solved(evidence: Evidence, camera: Camera = CAMERA) -> Mosaic:
    """The mosaic that a registration with this camera would make of the evidence."""
    rig = Rig.of_one_camera(len(evidence.features))
    links, group, adjusted = solve_links(evidence.links([camera], 4.0), rig, [camera])
    blank = np.zeros((2, 2, 3), np.uint8)
    frames = [
        dataclasses.replace(
            frame_of(f"f{k}", blank),
            camera_from_world=adjusted.rotations[k] if k in group else None,
            sigma_deg=float(np.rad2deg(adjusted.sigma[k])),
        )
        for k in evidence.features
    ]
    return Mosaic((camera,), tuple(frames), tuple(links))


def said(evidence: Evidence) -> tuple[str, ...]:
    return diagnose(solved(evidence), evidence)


def test_a_good_set_is_not_talked_about() -> None:
    assert said(seen()) == ()


def test_two_viewpoints_come_first_and_name_the_frames() -> None:
    rotations, positions = np.concatenate([TURN[:4], TURN[:4]]), np.zeros((8, 3))
    positions[4:] = [0.2, 0.02, 0.15]
    first, *_ = said(seen(positions, rotations))
    assert first.startswith("two viewpoints: f0, f1, f2 and f3 were taken from one place, f4, f5, f6 and f7 ")
    assert "near things" not in " ".join(said(seen(positions, rotations)))


def test_a_tripod_that_turns_beside_the_pupil_shows_parallax() -> None:
    (sentence,) = said(seen(np.array([0.04 * rotation[2] for rotation in TURN])))
    assert sentence.startswith("near things have parallax")
    assert "px" in sentence
    assert "degrees" in sentence
    assert "entrance pupil" in sentence


def test_who_walks_with_every_frame_is_told_so() -> None:
    positions = np.array([[0.25 * k, 0, 0.1 * k] for k in range(5)])
    evidence = seen(positions)
    mosaic = solved(seen())  # the orientations, as if they had been found
    assert any("carried from place to place" in sentence for sentence in diagnose(mosaic, evidence))


def test_a_frame_that_hangs_on_few_matches_is_named() -> None:
    evidence = seen()
    few = {}
    for pair, matches in evidence.matches.items():
        if 4 in pair:
            if pair == (3, 4):
                few[pair] = matches._replace(first=matches.first[:25], second=matches.second[:25])
        else:
            few[pair] = matches
    (sentence,) = said(dataclasses.replace(evidence, matches=few))
    assert sentence.startswith("f4 is held by ")
    assert "with f3," in sentence
    assert "overlap" in sentence


def test_a_lens_that_is_weakly_determined_is_said_so() -> None:
    evidence = seen()
    mosaic = solved(evidence)
    values = len(CAMERA.values)
    for share, expected in ((1e-4, 0), (0.02, 1)):
        covariance = np.zeros((values, values))
        covariance[0, 0] = (share * CAMERA.values[0]) ** 2
        found = dataclasses.replace(mosaic, self_calibrated=True, camera_covariances=(covariance,))
        weak = [sentence for sentence in diagnose(found, evidence) if "weakly determined" in sentence]
        assert len(weak) == expected


def test_a_lens_seen_at_the_rim_only_is_weakly_determined_whatever_its_sigma() -> None:
    back_to_back = np.array([orientation(0), orientation(178)])
    evidence = evidence_of(CAMERA, back_to_back, np.zeros((2, 3)), room_points(4000), 0.2)
    mosaic = dataclasses.replace(solved(evidence), self_calibrated=True)
    (sentence,) = diagnose(mosaic, evidence)
    assert "weakly determined" in sentence
    assert diagnose(dataclasses.replace(mosaic, self_calibrated=False), evidence) == ()


def scaled(factor: float) -> Camera:
    return dataclasses.replace(CAMERA, lens=CAMERA.lens.scaled(factor))


def equidistant() -> Camera:
    return dataclasses.replace(CAMERA, lens=Equidistant(CAMERA.image_radius / CAMERA.half_fov))


def off_centre() -> Camera:
    return dataclasses.replace(CAMERA, centre=(CAMERA.centre[0] + 6, CAMERA.centre[1] - 4))


@pytest.mark.parametrize("camera", [scaled(1.01), scaled(1.1), equidistant(), off_centre()])
def test_a_wrong_lens_is_noticed(camera: Camera) -> None:
    evidence = seen()
    found = wrong_lens(evidence, [camera], Rig.of_one_camera(5))
    assert found is not None
    assert found.fitted_px < 0.5 < found.given_px <= found.worst_px
    (sentence,) = diagnose(solved(evidence, camera), evidence, wrong=found)
    assert "does not fit these frames" in sentence
    assert "without --camera" in sentence


@pytest.mark.parametrize("metres", [0.0, 0.04])
def test_the_right_lens_is_not_blamed_for_parallax(metres: float) -> None:
    evidence = seen(np.array([metres * rotation[2] for rotation in TURN]))
    rig = Rig.of_one_camera(5)
    assert wrong_lens(evidence, [CAMERA], rig) is None
    solution = solve_links(evidence.links([CAMERA], 4.0), rig, [CAMERA])
    assert wrong_lens(evidence, [CAMERA], rig, solution=solution) is None


def with_something_moved(evidence: Evidence, near: FloatArray, by: FloatArray) -> tuple[Evidence, NDArray[np.bool_]]:
    """The evidence with the points near a direction moved in frame 1, as somebody who walked on."""
    rays = CAMERA.unproject(evidence.features[1].pixels) @ TURN[1]
    moves = (rays @ near) > math.cos(math.radians(12))
    pixels = evidence.features[1].pixels.copy()
    gone = rays[moves] + by
    pixels[moves] = CAMERA.project(gone / np.linalg.norm(gone, axis=1, keepdims=True) @ TURN[1].T)
    moved = Features(pixels, evidence.features[1].descriptors)
    return dataclasses.replace(evidence, features={**evidence.features, 1: moved}), moves


def test_somebody_who_walked_on_is_found() -> None:
    yaw, pitch = math.radians(40), math.radians(-8)
    near = np.array([math.cos(pitch) * math.sin(yaw), -math.sin(pitch), math.cos(pitch) * math.cos(yaw)])
    cloth = near + 0.08 * np.random.default_rng(3).normal(size=(60, 3))
    crowd = evidence_of(CAMERA, TURN, STILL, np.concatenate([POINTS, 2.5 * cloth]), 0.25)
    evidence, moves = with_something_moved(crowd, near, 0.07 * np.array([math.cos(yaw), 0, -math.sin(yaw)]))
    mosaic = solved(evidence)
    rotations = dict(enumerate(TURN))
    found = moving_things(evidence, [CAMERA], rotations, parallaxes(evidence, [CAMERA], pairs_to_compare(evidence)))
    assert moves.sum() > 40
    assert found
    assert 1 in found[0].frames
    assert found[0].direction @ near > math.cos(math.radians(8))
    assert found[0].moved == pytest.approx(0.07, rel=0.2)
    sentences = [sentence for sentence in diagnose(mosaic, evidence) if "moved by" in sentence]
    assert sentences
    assert "mask" in sentences[-1]


def test_names_of_frames() -> None:
    frames = [frame_of(f"f{k}", np.zeros((2, 2, 3), np.uint8)) for k in range(12)]
    assert named(frames, [0]) == "f0"
    assert named(frames, [0, 3]) == "f0 and f3"
    assert named(frames, [0, 3, 5]) == "f0, f3 and f5"
    assert named(frames, range(12)) == "f0, f1, f2 ... f11 (12 frames)"
