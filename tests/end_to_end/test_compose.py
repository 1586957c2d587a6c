"""mosaic.json in, panorama out: any surface, depth and brightness; and what is refused before any work."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from projects import NOTED, coloured, frame_files, project_in
from rooms import Outcome

from fullsphere.model.files import sha256_of
from fullsphere.model.images import linear_from_encoded, open_panorama, open_picture, read_picture
from fullsphere.model.lens import FloatArray
from fullsphere.model.projection_text import parse_projection
from fullsphere.mosaic.store import load_mosaic, save_mosaic

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


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda path: path.unlink(), "there is no such file, and"),
        (lambda path: path.write_bytes(path.read_bytes() + b"x"), "its content has changed"),
    ],
)
def test_a_picture_that_went_or_changed_is_named(
    harm: Callable[[Path], None], said: str, fullsphere: Run, tmp_path: Path
) -> None:
    own = project_in(tmp_path / "own")
    harm(tmp_path / "own" / "frame_2.tif")
    run = fullsphere("compose", own, "-o", tmp_path / "p.tif", "--size", 128)
    assert run.code == 3
    assert said in run.error_line
    assert "frame_2.tif" in run.error_line
    assert not (tmp_path / "p.tif").exists()


def test_a_mosaic_without_registered_frames_is_refused(fullsphere: Run, tmp_path: Path) -> None:
    own = project_in(tmp_path / "own")
    mosaic = load_mosaic(own)
    frames = tuple(frame.left_out("is too dark") for frame in mosaic.frames)
    save_mosaic(own, dataclasses.replace(mosaic, frames=frames), overwrite=True)
    run = fullsphere("compose", own, "-o", tmp_path / "p.tif")
    assert (run.code, "nothing to compose" in run.error_line) == (3, True)


def test_a_window_that_nobody_sees_is_refused(fullsphere: Run, tmp_path: Path) -> None:
    ahead = project_in(tmp_path / "ahead", 1)
    surface = "perspective:100:hfov=60:yaw=180"
    run = fullsphere("compose", ahead, "-o", tmp_path / "p.tif", "--to", surface)
    assert (run.code, "no frame sees anything" in run.error_line) == (2, True)
    assert not (tmp_path / "p.tif").exists()


def test_frames_of_several_depths_make_the_deepest(fullsphere: Run, tmp_path: Path) -> None:
    own = project_in(tmp_path / "own")
    deep = project_in(tmp_path / "deep", dtype=np.uint16)
    frames = (*load_mosaic(own).frames[:2], *load_mosaic(deep).frames[2:])
    save_mosaic(own, dataclasses.replace(load_mosaic(own), frames=frames), overwrite=True)
    run = fullsphere("compose", own, "-o", tmp_path / "p.tif", "--size", 200)
    assert run.code == 0, run.err
    assert "several depths (uint8, uint16)" in run.warnings[0]
    assert read_picture(tmp_path / "p.tif").pixels.dtype == np.uint16
    assert worst_error(tmp_path / "p.tif", "equirectangular:200") < 0.02


# --- new pictures of a solved project -------------------------------------------------------------------------------


def turned_colours(rays: FloatArray) -> FloatArray:
    return coloured(rays)[..., ::-1]


def test_new_pictures_take_the_place_of_the_registered_ones(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    project_in(tmp_path / "new", 4, "png", scene=turned_colours, exposures_ev=(-0.2, 0.1, 0.3, 0.0))
    new = frame_files(tmp_path / "new", "png")
    run = fullsphere("compose", project, "--frames", *new, "-o", tmp_path / "p.tif", "--size", 200)
    assert run.code == 0, run.err
    picture = read_picture(tmp_path / "p.tif")
    light = linear_from_encoded(picture.pixels)[..., :3]
    surface = parse_projection("equirectangular:200").projection
    v, u = np.mgrid[:100, :200].astype(float)
    truth = turned_colours(surface.unproject(np.stack([u, v], -1)))
    ratio = light / truth
    assert ratio.std() / ratio.mean() < 0.02  # brightness as a whole is a choice


@pytest.mark.parametrize(
    ("count", "side", "code", "said"),
    [(3, None, 2, "3 pictures given for the 4"), (4, 120, 3, "is 120 x 120 pixels"), (5, None, 2, "5 pictures")],
)
def test_new_pictures_that_do_not_fit_are_refused(
    count: int, side: int | None, code: int, said: str, project: Path, fullsphere: Run, tmp_path: Path
) -> None:
    project_in(tmp_path / "new", 5)
    new = frame_files(tmp_path / "new")[:count]
    if side:
        small = read_picture(new[1]).pixels[:side, :side]
        with open_panorama(new[1], (side, side), 3, np.uint8, {}, overwrite=True) as writer:
            writer.write_rows(0, small)
    run = fullsphere("compose", project, "--frames", *new, "-o", tmp_path / "p.tif", "--size", 200)
    assert (run.code, said in run.error_line) == (code, True), run.err
    assert not (tmp_path / "p.tif").exists()


def test_new_circles_of_one_picture_share_it(fullsphere: Run, tmp_path: Path) -> None:
    own = load_mosaic(project_in(tmp_path, 2))
    side = own.camera.size[0]

    def both(name: str, light: float) -> Path:
        pixels = np.hstack([read_picture(path).pixels for path in frame_files(tmp_path)])
        with open_panorama(tmp_path / name, (2 * side, side), 3, np.uint8, {}, overwrite=True) as writer:
            writer.write_rows(0, (pixels * light).astype(np.uint8))
        return tmp_path / name

    first, second = both("a.png", 1.0), both("b.png", 0.8)
    halves = tuple(
        dataclasses.replace(
            frame, id=f"a.png:{name}", image=str(first), sha256=sha256_of(first), crop_px=(k * side, 0, side, side)
        )
        for k, (frame, name) in enumerate(zip(own.frames, ("left", "right"), strict=True))
    )
    save_mosaic(tmp_path / "dual.json", dataclasses.replace(own, frames=halves))
    run = fullsphere("compose", tmp_path / "dual.json", "--frames", second, "-o", tmp_path / "p.png", "--size", 128)
    assert run.code == 0, run.err
    before = fullsphere("compose", tmp_path / "dual.json", "-o", tmp_path / "q.png", "--size", 128)
    assert before.code == 0, before.err
    dark, bright = (read_picture(tmp_path / name).pixels for name in ("p.png", "q.png"))
    seen = bright[..., 3] > 0
    np.testing.assert_allclose(dark[seen][:, :3], 0.8 * bright[seen][:, :3], atol=6)


def test_too_little_memory_says_the_least_that_is_needed(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--size", 256, "--memory", "100MB")
    assert (run.code, "give it at least" in run.error_line) == (6, True)
    assert not list(tmp_path.iterdir())


def test_memory_changes_no_byte(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    for memory in ("600MB", "4GB"):
        run = fullsphere("compose", project, "-o", tmp_path / f"{memory}.tif", "--size", 700, "--memory", memory)
        assert run.code == 0, run.err
    assert (tmp_path / "600MB.tif").read_bytes() == (tmp_path / "4GB.tif").read_bytes()
