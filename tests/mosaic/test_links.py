"""Links keep back what no fit may see, whatever agrees with it."""

import itertools
import math

import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.lens import Equidistant, FloatArray
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.links import Evidence, gather_evidence
from fullsphere.mosaic.matching import held_back
from laws import rotation

CAMERA = Camera(Equidistant(200.0), (640, 640), (319.5, 319.5), half_fov=math.radians(88))


@pytest.fixture(scope="module")
def turned() -> tuple[list[FloatArray], dict[int, Features]]:
    """Four frames of one cloud of points, all of it seen by all: turned about the axis, a little to the side."""
    rng = np.random.default_rng(0)
    rays = rng.normal(size=(600, 3)) * [1, 1, 0.3] + [0, 0, 1]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    words = rng.random((600, 128)) ** 4
    words /= np.linalg.norm(words, axis=1, keepdims=True)
    turns = [rotation(k) for k in range(4)]
    turns = [turn if k else np.eye(3) for k, turn in enumerate(turns)]
    features = {}
    for k, turn in enumerate(turns):
        pixels = CAMERA.project(rays @ turn.T)
        seen = np.isfinite(pixels[:, 0])
        features[k] = Features(pixels[seen], words[seen].astype(np.float32))
    return turns, features


def gathered(features: dict[int, Features]) -> Evidence:
    return gather_evidence(features, None, lambda items, **_: items)


def test_matches_are_used_or_held_back_never_both(turned: tuple[list[FloatArray], dict[int, Features]]) -> None:
    evidence = gathered(turned[1])
    assert set(evidence.matches) == set(evidence.held) == set(itertools.combinations(range(4), 2))
    for pair, used in evidence.matches.items():
        held = evidence.held[pair]
        assert not set(used.first) & set(held.first)
        assert held_back(evidence.features[pair[0]].pixels[held.first]).all()
        assert not held_back(evidence.features[pair[0]].pixels[used.first]).any()


def test_held_back_matches_do_not_change_a_link(turned: tuple[list[FloatArray], dict[int, Features]]) -> None:
    turns, features = turned
    evidence = gathered(features)
    links = evidence.links([CAMERA], 2.0)
    assert links
    for link, other in zip(links, Evidence(features, evidence.matches).links([CAMERA], 2.0), strict=True):
        np.testing.assert_array_equal(link.j_from_i, other.j_from_i)
        assert len(other.held_i) == 0
        expected = turns[link.j] @ turns[link.i].T
        np.testing.assert_allclose(link.j_from_i, expected, atol=1e-9)


def test_a_link_holds_back_wrong_matches_too(turned: tuple[list[FloatArray], dict[int, Features]]) -> None:
    evidence = gathered(turned[1])
    pair, held = next((p, h) for p, h in evidence.held.items() if len(h.first) > 20)
    wrong = Evidence(evidence.features, evidence.matches, held={pair: held._replace(second=held.second[::-1].copy())})
    (link,) = wrong.links([CAMERA], 2.0, pairs=[pair])
    assert len(link.held_i) == len(link.held_j) == len(held.first)
