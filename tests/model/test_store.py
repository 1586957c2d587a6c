"""camera.json: what is written comes back, and what is not exactly a camera is refused by the key's name."""

import copy
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError, OutputError
from fullsphere.model.lens import (
    LENSES,
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    EnhancedUnifiedCamera,
    Equidistant,
    Equisolid,
    KannalaBrandt,
    Lens,
    Orthographic,
    Perspective,
    ScaledStereographic,
    Scaramuzza,
    Stereographic,
    Thoby,
    UnifiedCamera,
)
from fullsphere.model.store import FORMAT, camera_from_dict, camera_to_dict, load_camera, save_camera

LENS_AND_EDGE: list[tuple[Lens, float]] = [
    (Perspective(500.3), math.radians(40)),
    (Perspective(9000.0), math.radians(0.4)),
    (Stereographic(300.1), math.radians(170)),
    (Equidistant(299.7), math.pi),
    (Equisolid(310.9), math.pi),
    (Orthographic(400.5), math.pi / 2),
    (ScaledStereographic(350.2, 1.2), math.radians(104)),
    (BaksteinPajdla(432.0, 2.11, 134.4, 1.13), math.radians(91.5)),
    (BaksteinPajdla(-20.0, 1.5, 600.0, 1.3), BaksteinPajdla(-20.0, 1.5, 600.0, 1.3).theta_max),
    (Thoby(310.3), Thoby(1.0).theta_max),
    (KannalaBrandt(400.1, -0.031, 0.0043, 0.0, 0.0), math.radians(97.5)),
    (KannalaBrandt(400.1, -0.2, 0.0, 0.0, 0.0), KannalaBrandt(400.1, -0.2, 0.0, 0.0, 0.0).theta_max),
    (Brown(900.7, -0.29, 0.11, -0.02), math.radians(30)),
    (Scaramuzza(400.3, -7e-4, 4e-7, -1e-9), math.radians(100)),
    (UnifiedCamera(400.3, 0.62), UnifiedCamera(400.3, 0.62).theta_max),
    (EnhancedUnifiedCamera(300.3, 0.6, 1.1), EnhancedUnifiedCamera(300.3, 0.6, 1.1).theta_max),
    (DoubleSphere(280.3, -0.2, 0.58), DoubleSphere(280.3, -0.2, 0.58).theta_max),
]


def camera_of(lens: Lens, half_fov: float) -> Camera:
    return Camera(lens, (1280, 801), (640.3, 399.7), half_fov=half_fov, aspect=1.0021)


CAMERA = camera_of(BaksteinPajdla(432.0, 2.11, 134.4, 1.13), math.radians(91.5))


def test_every_lens_is_tried() -> None:
    assert {lens.projection for lens, _ in LENS_AND_EDGE} == set(LENSES)


@pytest.mark.parametrize(("lens", "half_fov"), LENS_AND_EDGE)
def test_a_camera_comes_back(tmp_path: Path, lens: Lens, half_fov: float) -> None:
    camera = camera_of(lens, half_fov)
    save_camera(tmp_path / "camera.json", camera)
    read = load_camera(tmp_path / "camera.json")
    assert (read.lens, read.size, read.centre, read.aspect) == (lens, camera.size, camera.centre, camera.aspect)
    assert read.half_fov == pytest.approx(half_fov, rel=1e-15)
    save_camera(tmp_path / "again.json", read)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "camera.json").read_bytes()


def test_rounding_to_degrees_does_not_pass_the_edge_of_the_lens() -> None:
    for theta_max in np.random.default_rng(0).uniform(0.5, 3, 500):
        camera = camera_of(ScaledStereographic(100.0, float(theta_max) / (math.pi / 2) * 1.01), float(theta_max))
        assert camera_from_dict(camera_to_dict(camera), "x").half_fov == pytest.approx(theta_max, rel=1e-15)
    edge = Orthographic(400.0)
    assert camera_from_dict(camera_to_dict(camera_of(edge, edge.theta_max)), "x").half_fov <= edge.theta_max


def test_the_file_holds_the_lens_in_whole_degrees(tmp_path: Path) -> None:
    save_camera(tmp_path / "camera.json", CAMERA, calibration={"rms_px": 0.25})
    value = json.loads((tmp_path / "camera.json").read_text())
    assert value["format"] == FORMAT
    assert value["lens"] == {"projection": "bakstein-pajdla", "a_px": 432.0, "b": 2.11, "c_px": 134.4, "d": 1.13}
    assert value["calibration"] == {"rms_px": 0.25}
    assert value["curve"]["theta_deg"] == list(range(92))
    rays = [[math.sin(t), 0, math.cos(t)] for t in np.radians(value["curve"]["theta_deg"])]
    assert np.allclose(CAMERA.project(rays)[:, 0] - CAMERA.centre[0], value["curve"]["r_px"], atol=1e-9)


def test_a_lens_typed_by_hand_needs_neither_calibration_nor_curve() -> None:
    value = camera_to_dict(CAMERA)
    del value["curve"]
    assert camera_from_dict(value, "x") == CAMERA


def test_a_curve_with_uncertainty_is_written_and_read() -> None:
    curve = {"theta_deg": [0, 45.5, 91], "r_px": CAMERA.lens.radius(np.radians([0, 45.5, 91])), "sigma_px": [0, 0.1, 1]}
    value = json.loads(json.dumps(camera_to_dict(CAMERA, curve=curve)))
    assert value["curve"]["sigma_px"] == [0, 0.1, 1]
    assert camera_from_dict(value, "x") == CAMERA


def test_a_file_that_holds_cameras_may_give_them_more_keys() -> None:
    value = {**camera_to_dict(CAMERA), "vignetting": [0.0]}
    assert camera_from_dict(value, "x", besides=["vignetting"]) == CAMERA
    with pytest.raises(InputError, match="'vignetting' is unknown"):
        camera_from_dict(value, "x")


def changed(*keys: str, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(value: dict[str, Any]) -> None:
        for key in keys[:-1]:
            value = value[key]
        value[keys[-1]] = to

    return change


def without(*keys: str) -> Callable[[dict[str, Any]], None]:
    def change(value: dict[str, Any]) -> None:
        for key in keys[:-1]:
            value = value[key]
        del value[keys[-1]]

    return change


def curve_moved(value: dict[str, Any]) -> None:
    value["curve"]["r_px"][50] += 0.051


FAULTS = {
    "format": changed("format", to="fullsphere-camera/2"),
    "aspect": without("aspect"),
    "aspekt": changed("aspekt", to=1.0),
    "image_size_px": changed("image_size_px", to=[1280]),
    "image_size_px ": changed("image_size_px", to=[1280, 800.5]),
    "image_size_px  ": changed("image_size_px", to=[0, 800]),
    "image_size_px   ": changed("image_size_px", to=["1280", 800]),
    "centre_px": changed("centre_px", to=[1e9, 0]),
    "centre_px ": changed("centre_px", to={"u": 1}),
    "aspect ": changed("aspect", to=True),
    "aspect  ": changed("aspect", to=50),
    "half_field_of_view_deg": changed("half_field_of_view_deg", to=1.6e6),
    "half_field_of_view_deg ": changed("half_field_of_view_deg", to=-91.5),
    "half_field_of_view_deg  ": changed("half_field_of_view_deg", to="91.5"),
    "projection": changed("lens", "projection", to="fisheye"),
    "projection ": changed("lens", "projection", to=["equidistant"]),
    "projection  ": without("lens", "projection"),
    "lens": changed("lens", to="equidistant"),
    "a_px": without("lens", "a_px"),
    "a_px ": changed("lens", "a_px", to=None),
    "b": changed("lens", "b", to=-2.11),
    "c_px": changed("lens", "c_px", to=1e9),
    "f_px": changed("lens", "f_px", to=300),
    "calibration": changed("calibration", to=[]),
    "curve": changed("curve", to=None),
    "curve ": curve_moved,
    "theta_deg": changed("curve", "theta_deg", to=list(range(92))[::-1]),
    "theta_deg ": changed("curve", "theta_deg", to=list(range(91))),
    "theta_deg  ": changed("curve", "theta_deg", to=list(range(1000, 1092))),
    "r_px": without("curve", "r_px"),
    "r_px ": changed("curve", "r_px", to=[0.0] * 92),
    "sigma_px": changed("curve", "sigma_px", to=[0.1]),
    "sigma_px ": changed("curve", "sigma_px", to=[-0.1] * 92),
    "sigma": changed("curve", "sigma", to=[0.1] * 92),
}


@pytest.mark.parametrize("key", FAULTS)
def test_what_is_no_camera_is_refused_by_the_name_of_the_key(tmp_path: Path, key: str) -> None:
    value = json.loads(json.dumps(camera_to_dict(CAMERA)))
    assert camera_from_dict(copy.deepcopy(value), "sound") == CAMERA
    FAULTS[key](value)
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(value))
    with pytest.raises(InputError, match=rf"\b{key.strip()}\b") as refusal:
        load_camera(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_a_lens_that_falls_within_its_field_of_view_is_refused() -> None:
    value = camera_to_dict(camera_of(BaksteinPajdla(-20.0, 1.5, 600.0, 1.3), 1.0))
    value["half_field_of_view_deg"] = 120
    with pytest.raises(InputError, match=r"half_field_of_view_deg: .* stops growing"):
        camera_from_dict(value, "x")


def test_an_unknown_projection_is_answered_with_the_known_ones() -> None:
    value = {**camera_to_dict(CAMERA), "lens": {"projection": "fisheye"}}
    with pytest.raises(InputError, match=r"'fisheye'; known are perspective, .*bakstein-pajdla"):
        camera_from_dict(value, "x")


@pytest.mark.parametrize("text", ["[]", "7", "null", '{"format": 1}', "{}", '{"aspect": NaN}', '{"aspect": 1e999}'])
def test_other_json_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(InputError, match=r"camera\.json: "):
        load_camera(tmp_path / "camera.json")


def test_a_camera_is_not_written_over_a_file_unasked(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text("old")
    with pytest.raises(OutputError, match="--overwrite"):
        save_camera(tmp_path / "camera.json", CAMERA)
    assert (tmp_path / "camera.json").read_text() == "old"


BENCH = Path(__file__).resolve().parents[3] / "shared" / "bench" / "camera.py"


@pytest.mark.skipif(not BENCH.exists(), reason="../shared/bench is not here")
def test_the_cameras_of_the_rendered_sets_load(tmp_path: Path) -> None:
    theta, f = np.linspace(0, math.radians(91.5), 181), 320.0
    radius = 1.35 * f * np.tan(theta / 2.11) + 0.42 * f * np.sin(theta / 1.13)
    truth = {"lens": "fce8", "size": [640, 480], "f": f, "cx": 319.5, "cy": 239.5, "beta": 1.003, "half_fov_deg": 91.5}
    (tmp_path / "truth.json").write_text(json.dumps({**truth, "theta": theta.tolist(), "r": radius.tolist()}))
    subprocess.run([sys.executable, BENCH, tmp_path / "truth.json", tmp_path / "camera.json"], check=True)
    camera = load_camera(tmp_path / "camera.json")
    assert camera.aspect == 1.003
    assert np.allclose(camera.lens.radius(theta), radius, atol=1e-9)
