from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fullsphere.model.calibration.calibrate import Calibration, calibrate, locate
from fullsphere.model.calibration.held_out import held_out_residuals, judged_points
from fullsphere.model.calibration.points import View, read_points
from fullsphere.model.calibration.select import Row, Selection, select
from fullsphere.model.errors import GeometryError, UsageError
from fullsphere.model.lens import BaksteinPajdla, Equisolid, KannalaBrandt

SIZE = (1280, 1280)
SHARED = Path(__file__).resolve().parents[3].parent / "shared"
POINTS = SHARED / "data" / "calibration"


@pytest.fixture(scope="module")
def views(photographer: Any) -> tuple[View, ...]:
    world = photographer.box_world(30, 0.3, views=6, camera=photographer.camera(Equisolid(390.0)))
    return tuple(world.views)


@pytest.fixture(scope="module")
def selection(views: tuple[View, ...]) -> Selection:
    return select(views, SIZE, ["perspective", "equidistant", "kannala-brandt", "bakstein-pajdla", "equisolid"])


def row(selection: Selection, lens: str) -> Row:
    return next(row for row in selection.rows if row.lens == lens)


def test_the_simplest_of_the_right_lenses_is_chosen(selection: Selection) -> None:
    """Bakstein-Pajdla and Kannala-Brandt hold the equisolid curve too, but with more to fit to noise."""
    assert selection.chosen == "equisolid"
    assert selection.calibration is selection.calibrations["equisolid"]
    assert row(selection, "equisolid").parameters == 1
    judged = [r for r in selection.rows if r.fitted]
    assert [r.held_out_rms_px for r in judged] == sorted(r.held_out_rms_px for r in judged)
    for lens in ("bakstein-pajdla", "kannala-brandt", "equisolid"):
        mine = row(selection, lens)
        assert mine.held_out_rms_px == pytest.approx(0.3 * math.sqrt(2), rel=0.1)
        assert mine.fit_rms_px < mine.held_out_rms_px
        assert "wrong" not in mine.verdict
        assert abs(mine.misfit_px) < 0.15
    assert "6 views in 5 folds" in selection.held_out
    assert "not the right model" not in selection.verdict


def test_a_wrong_lens_and_one_that_cannot_are_named(selection: Selection) -> None:
    wrong = row(selection, "equidistant")
    assert wrong.fitted
    assert "wrong for this lens" in wrong.verdict
    assert wrong.behind_px > 3 * wrong.behind_error_px
    assert abs(wrong.misfit_px) > 1
    assert selection.rows[-1].lens == "perspective"
    assert not selection.rows[-1].fitted
    assert "perspective" in selection.rows[-1].verdict
    assert "perspective" not in selection.calibrations


def test_pairing_by_view_sharpens_the_comparison(photographer: Any) -> None:
    """Views of unlike noise: each lens's own error is uncertain, their difference is not."""
    world = photographer.box_world(31, 0.0, views=10)
    rng = np.random.default_rng(0)
    views = [
        dataclasses.replace(v, pixels=np.clip(v.pixels + rng.normal(0, 0.1 + 0.1 * k, v.pixels.shape), 0, 1279))
        for k, v in enumerate(world.views)
    ]
    found = select(views, SIZE, ["bakstein-pajdla", "kannala-brandt"], reject=False)
    assert found.rows[1].behind_error_px < 0.1 * found.rows[0].held_out_error_px


def test_bakstein_pajdla_is_said_to_be_wrong_where_it_is(photographer: Any) -> None:
    """A curve with an inflection that tan and sin cannot bend to."""
    lens = KannalaBrandt(380.0, -0.12, 0.09, -0.03, 0.0035)
    world = photographer.box_world(32, 0.1, views=5, camera=photographer.camera(lens))
    found = select(world.views, SIZE, ["bakstein-pajdla", "kannala-brandt"])
    assert found.chosen == "kannala-brandt"
    assert "bakstein-pajdla lens is not the right model" in found.verdict
    assert "systematic" in found.verdict
    trend = row(found, "bakstein-pajdla")
    assert f"{trend.misfit_px:+.2g} px" in found.verdict
    assert abs(trend.misfit_px) > 3 * abs(row(found, "kannala-brandt").misfit_px)


def test_folds_agree_with_calibrations_made_from_nothing(photographer: Any) -> None:
    """The folds start from the fit to all views; the same fit without any start ends in the same place."""
    views = photographer.box_world(30, 0.3, views=6).views
    whole = calibrate(views, SIZE, reject=False)
    judged = judged_points(views, [whole], 3)
    residuals = held_out_residuals(judged, whole)
    for fold in range(3):
        camera = calibrate([v for k, v in enumerate(views) if k % 3 != fold], SIZE, reject=False).camera
        reached = dataclasses.replace(camera, half_fov=1.7)
        expected = locate([v for k, v in enumerate(views) if k % 3 == fold], reached)[1]
        np.testing.assert_allclose(residuals[judged.fold == fold], np.concatenate(expected), atol=1e-3)


def test_a_lens_gains_nothing_by_rejecting_points(photographer: Any) -> None:
    """A point counts that one sound lens explains; one that all of them reject does not."""
    world = photographer.box_world(33, 0.2, views=5)
    pixels = world.views[2].pixels.copy()
    pixels[11] += 60
    views = [*world.views[:2], dataclasses.replace(world.views[2], pixels=pixels), *world.views[3:]]
    right = calibrate(views, SIZE)
    picky = dataclasses.replace(
        right, used=tuple(used & (np.hypot(*e.T) < 0.2) for used, e in zip(right.used, right.residuals_px, strict=True))
    )
    assert right.rejected == 1
    total = sum(len(view.pixels) for view in views)
    assert len(judged_points(views, [right, picky], 5).fold) == total - 1
    assert len(judged_points(views, [picky, dataclasses.replace(right, sigma_px=99.0)], 5).fold) < total / 2


def test_a_lens_that_is_too_free_is_not_called_wrong(photographer: Any) -> None:
    """Few points of an equisolid lens: four values follow them, noise and all, and predict badly."""
    rng = np.random.default_rng(40)
    camera = photographer.camera(Equisolid(390.0))
    marks = np.stack([*rng.uniform(-100, 100, (2, 9)), np.zeros(9)], -1)
    world = photographer.shoot(camera, photographer.poses(4, rng, distance=80.0, tilt_deg=40.0), marks, 1.0, rng)
    found = select(world.views, SIZE, ["equisolid", "kannala-brandt", "bakstein-pajdla"], reject=False)
    assert found.chosen == "equisolid"
    assert "too free" in row(found, "kannala-brandt").verdict
    assert row(found, "bakstein-pajdla").verdict.startswith("fitted to a part of the points it does not predict")
    assert "could not be compared" in found.verdict
    assert "not the right model" not in found.verdict


def test_one_view_is_judged_half_by_half(photographer: Any) -> None:
    world = photographer.box_world(34, 0.3, views=1)
    found = select(world.views, SIZE, ["equidistant", "bakstein-pajdla", "kannala-brandt"])
    assert "either half" in found.held_out
    assert found.chosen in ("bakstein-pajdla", "kannala-brandt")
    best = found.rows[0]
    assert 0.3 * math.sqrt(2) < best.held_out_rms_px < 0.6
    assert 0 < best.held_out_error_px < 0.1


def test_few_views_are_left_out_one_by_one(photographer: Any) -> None:
    world = photographer.box_world(35, 0.3, views=3)
    found = select(world.views, SIZE, ["bakstein-pajdla"])
    assert "each of 3 views predicted by the others" in found.held_out
    assert found.chosen == "bakstein-pajdla"


def test_the_choice_is_the_same_every_time_and_options_are_passed_on(views: tuple[View, ...]) -> None:
    seen: list[Any] = []

    def watched(items: Iterable[Any]) -> Iterable[Any]:
        for item in items:
            seen.append(item)
            yield item

    kinds: list[Any] = [Equisolid, BaksteinPajdla]
    first, again = (select(views, SIZE, kinds, half_fov=1.5, progress=watched) for _ in range(2))
    assert first.rows == again.rows
    assert first.verdict == again.verdict
    assert first.calibration.camera == again.calibration.camera
    assert first.calibration.camera.half_fov == 1.5
    assert len(seen) == 4


def test_what_cannot_be_compared_is_refused(views: tuple[View, ...]) -> None:
    with pytest.raises(UsageError, match="fisheye"):
        select(views, SIZE, ["fisheye"])
    with pytest.raises(UsageError, match="no lens"):
        select(views, SIZE, [])
    with pytest.raises(UsageError, match="1 folds"):
        select(views, SIZE, folds=1)
    with pytest.raises(GeometryError, match="perspective"):
        select(views, SIZE, ["perspective", "brown"])


def calibration_points(name: str) -> tuple[View, ...]:
    rows = [line.split(",") for line in (POINTS / name).read_text().splitlines()]
    columns = [rows[0].index(key) for key in ("X", "Y", "Z", "u", "v")]
    by_image: dict[str, list[list[float]]] = {}
    for fields in rows[1:]:
        by_image.setdefault(fields[rows[0].index("image")], []).append([float(fields[c]) for c in columns])
    return tuple(View(image, np.array(v)[:, :3], np.array(v)[:, 3:]) for image, v in by_image.items())


needs_points = pytest.mark.skipif(not POINTS.exists(), reason=f"real data: {POINTS} is not here")


@needs_points
def test_camodocal_is_no_bakstein_pajdla_lens() -> None:
    found = select(
        calibration_points("camodocal/corners.csv"), (1280, 960), ["bakstein-pajdla", "kannala-brandt", "ucm"]
    )
    assert found.chosen == "kannala-brandt"
    assert "not the right model" in found.verdict
    assert abs(row(found, "bakstein-pajdla").misfit_px) > 0.2
    assert row(found, "bakstein-pajdla").behind_px > 0.05


@needs_points
@pytest.mark.slow
def test_all_lenses_on_real_points() -> None:
    cube = select(read_points(POINTS / "ov-cube" / "corners_3d.csv"), (1280, 800))
    plane = select(calibration_points("ov-plane/corners.csv"), (1280, 800))
    for found in (cube, plane):
        assert {r.lens for r in found.rows[:2]} == {"bakstein-pajdla", "kannala-brandt"}
        assert "not the right model" not in found.verdict
    car = select(calibration_points("camodocal/corners.csv"), (1280, 960))
    assert car.chosen in ("kannala-brandt", "scaramuzza")
    assert "not the right model" in car.verdict


def test_the_values_are_calibrations(selection: Selection) -> None:
    assert all(isinstance(value, Calibration) for value in selection.calibrations.values())
    assert {row.lens for row in selection.rows if row.fitted} == set(selection.calibrations)
