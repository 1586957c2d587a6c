"""Frames that were lost while the lens was a guess are looked at again through the lens that was found."""

import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.errors import GeometryError
from fullsphere.model.lens import Perspective
from fullsphere.mosaic.features import Features
from fullsphere.mosaic.links import Evidence
from fullsphere.mosaic.options import DEFAULT
from laws import fisheye

register: Any = importlib.import_module("fullsphere.mosaic.register")  # not the function of that name
NONE = Features(np.empty((0, 2)), np.empty((0, 128), np.float16))
FIRST, CLOSER = (Evidence(dict.fromkeys(range(4), NONE), {}) for _ in range(2))
NARROW = Camera(Perspective(400.0), (400, 300), (199.5, 149.5), half_fov=0.5)


def solution_of(frames: int, camera: Camera) -> Any:
    return SimpleNamespace(group=np.arange(frames), adjustment=SimpleNamespace(cameras=(camera,)))


def looked_again(monkeypatch: pytest.MonkeyPatch, first: Any, again: Any) -> tuple[Evidence, Any, list[Any]]:
    asked: list[Any] = []

    def observed(*given: Any) -> tuple[list[Any], Evidence]:
        asked.append(given)
        return [], CLOSER

    def settle(evidence: Evidence, cameras: Any) -> Any:
        assert evidence is CLOSER
        if again is None:
            raise GeometryError("nothing fits")
        return again

    monkeypatch.setattr(register, "_observed", observed)
    found = register._looked_again([], FIRST, first, settle, DEFAULT.order, None, register.no_progress)
    return *found, asked


def test_a_lost_frame_is_brought_back_through_the_lens_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    first, again = solution_of(3, fisheye(400)), solution_of(4, fisheye(400))
    evidence, solution, asked = looked_again(monkeypatch, first, again)
    assert (evidence, solution) == (CLOSER, again)
    assert asked[0][2] is first.adjustment.cameras


@pytest.mark.parametrize("again", [solution_of(3, fisheye(400)), solution_of(2, fisheye(400)), None])
def test_what_was_found_stays_where_no_more_frames_come_back(monkeypatch: pytest.MonkeyPatch, again: Any) -> None:
    first = solution_of(3, fisheye(400))
    evidence, solution, _ = looked_again(monkeypatch, first, again)
    assert (evidence, solution) == (FIRST, first)


@pytest.mark.parametrize("first", [solution_of(4, fisheye(400)), solution_of(3, NARROW)])
def test_nothing_is_looked_at_again_without_need(monkeypatch: pytest.MonkeyPatch, first: Any) -> None:
    _, solution, asked = looked_again(monkeypatch, first, solution_of(4, fisheye(400)))
    assert solution is first
    assert not asked
