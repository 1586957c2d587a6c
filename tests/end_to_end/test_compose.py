"""mosaic.json in, panorama out: any surface, depth and brightness; and what is refused before any work."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from projects import NOTED, coloured, project_in
from rooms import Outcome

from fullsphere.model.images import linear_from_encoded, open_picture, read_picture
from fullsphere.model.projection_text import parse_projection
from fullsphere.mosaic.store import load_mosaic

Run = Callable[..., Outcome]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return project_in(tmp_path_factory.mktemp("project"), exposures_ev=(0.0, 0.4, -0.3, 0.1))


def worst_error(path: Path, surface: str) -> float:
    """Of the light, at pixels that are seen."""
    picture = read_picture(path)
    placed = parse_projection(surface)
    width, height = placed.projection.size
    v, u = np.mgrid[:height, :width].astype(float)
    rays = placed.projection.unproject(np.stack([u, v], -1)) @ placed.world_from_projection.T
    light = linear_from_encoded(picture.pixels, picture.profile)
    seen = np.isfinite(rays[..., 0]) if light.shape[2] == 3 else light[..., 3] > 0
    return float(np.abs(light[seen][:, :3] - coloured(rays[seen])).max())


def test_the_panorama_is_as_large_as_its_frames_resolve(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif")
    assert run.code == 0, run.err
    width = read_picture(tmp_path / "p.tif").pixels.shape[1]
    assert width % 16 == 0
    assert width == pytest.approx(2 * np.pi * float(load_mosaic(project).camera.lens.slope(0.0)), abs=8)
    assert f"{width} x {width // 2} pixels" in run.err  # said before the work
    assert f"{width} x {width // 2} pixels" in run.out
    assert worst_error(tmp_path / "p.tif", f"equirectangular:{width}") < 0.02


@pytest.mark.parametrize(
    "surface",
    [
        "equirectangular:200:yaw=70",
        "perspective:150x100:hfov=80:yaw=200:pitch=20",
        "cube:64",
        "littleplanet:128",
        "cylindrical:200:lat=-30..50",
    ],
)
def test_any_surface_shows_the_scene(surface: str, project: Path, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--to", surface, "--json")
    assert run.code == 0, run.err
    assert worst_error(tmp_path / "p.tif", surface) < 0.03
    assert json.loads(run.out)["seen"] > 0.7


@pytest.mark.parametrize(
    ("depth", "ending", "expected"),
    [
        (None, "tif", "uint8"),
        (None, "exr", "float16"),
        ("16", "png", "uint16"),
        ("16", "tif", "uint16"),
        ("half", "exr", "float16"),
        ("float", "exr", "float32"),
        ("float", "tif", "float32"),
    ],
)
def test_depth_is_as_asked_or_that_of_the_frames(
    depth: str | None, ending: str, expected: str, project: Path, fullsphere: Run, tmp_path: Path
) -> None:
    path = tmp_path / f"p.{ending}"
    run = fullsphere("compose", project, "-o", path, "--size", 200, *(["--depth", depth] if depth else []))
    assert run.code == 0, run.err
    with open_picture(path) as file:
        assert (file.dtype.name, file.channels) == (expected, 4)
    assert worst_error(path, "equirectangular:200") < 0.02


def test_deep_frames_make_deep_panoramas(fullsphere: Run, tmp_path: Path) -> None:
    deep = project_in(tmp_path / "deep", 3, "tif", np.uint16)
    assert fullsphere("compose", deep, "-o", tmp_path / "p.png", "--size", 128).code == 0
    assert read_picture(tmp_path / "p.png").pixels.dtype == np.uint16


def test_capture_metadata_and_the_sphere_are_noted(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    for name in ("p.jpg", "p.tif", "p.png"):
        run = fullsphere("compose", project, "-o", tmp_path / name, "--size", 256)
        assert run.code == 0, run.err
        with open_picture(tmp_path / name) as file:
            assert {key: file.metadata.get(key) for key in NOTED} == NOTED
            assert file.orientation == 1
    assert b"FullPanoWidthPixels" in (tmp_path / "p.jpg").read_bytes()
    assert fullsphere("compose", project, "-o", tmp_path / "v.jpg", "--to", "cube:32").code == 0
    assert b"FullPanoWidthPixels" not in (tmp_path / "v.jpg").read_bytes()


def test_a_frame_keeps_its_own_brightness(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    for text in ("2", "frame_1.tif"):
        path = tmp_path / f"{text}.tif"
        run = fullsphere("compose", project, "-o", path, "--size", 128, "--exposure", text, "--depth", "float")
        assert run.code == 0, run.err
        row = read_picture(path).pixels[32, :, :3]
        rays = parse_projection("equirectangular:128").projection.unproject(
            np.stack([np.arange(128.0), np.full(128, 32.0)], -1)
        )
        np.testing.assert_allclose(row, 2**0.4 * coloured(rays), atol=0.03)


def test_bytes_are_the_same_for_any_number_of_threads(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    for threads in (1, 3):
        run = fullsphere("compose", project, "-o", tmp_path / f"{threads}.tif", "--size", 700, "--threads", threads)
        assert run.code == 0, run.err
    assert (tmp_path / "1.tif").read_bytes() == (tmp_path / "3.tif").read_bytes()


# --- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["-o", "p.gif"], 2, "ending names no known format"),
        (["-o", "p.jpg", "--size", "70000"], 2, "at most 65500 pixels"),
        (["-o", "p.jpg", "--depth", "16"], 2, "holds uint8 samples, not uint16"),
        (["-o", "p.tif", "--depth", "half"], 2, "write a .exr"),
        (["-o", "p.tif", "--size", "255"], 2, "even number"),
        (["-o", "p.tif", "--size", "big"], 2, "no width in pixels"),
        (["-o", "p.tif", "--size", "256", "--to", "cube:64"], 2, "not allowed with"),
        (["-o", "p.tif", "--to", "perspectve:100:hfov=90"], 2, "did you mean 'perspective'"),
        (["-o", "p.tif", "--exposure", "9"], 2, "there is no such frame"),
        (["-o", "p.tif", "--compression", "best"], 2, "is no compression of"),
        (["-o", "missing/p.tif"], 5, "does not exist"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    options: list[str], code: int, said: str, project: Path, fullsphere: Run, tmp_path: Path
) -> None:
    options[1] = str(tmp_path / options[1])
    run = fullsphere("compose", project, *options)
    assert (run.code, said in run.error_line) == (code, True), run.err
    assert not list(tmp_path.iterdir())


def test_an_output_that_exists_or_is_an_input_is_left_alone(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "p.tif").write_bytes(b"mine")
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif")
    assert (run.code, (tmp_path / "p.tif").read_bytes()) == (5, b"mine")
    frame = project.parent / "frame_0.tif"
    before = frame.read_bytes()
    run = fullsphere("compose", project, "-o", frame, "--overwrite")
    assert run.code == 5
    assert "is an input of this run" in run.error_line
    assert frame.read_bytes() == before
