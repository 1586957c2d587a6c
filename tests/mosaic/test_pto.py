"""Hugin projects: read, written, and understood by Hugin's own programs, where they are installed, as by ours."""

import contextlib
import dataclasses
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation
from turning import matched, orientation, ring, srgb8, turn_between

from fullsphere.model.camera import Camera
from fullsphere.model.errors import CameraError, FullsphereError, InputError, OutputError
from fullsphere.model.lens import (
    BaksteinPajdla,
    Brown,
    DoubleSphere,
    Equidistant,
    Equisolid,
    FloatArray,
    KannalaBrandt,
    Orthographic,
    Perspective,
    Stereographic,
    Thoby,
)
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.pto import HORIZONTAL, VERTICAL, read_pto
from fullsphere.mosaic.pto_fit import camera_of, difference_px, lens_of
from fullsphere.mosaic.pto_lens import PanoToolsLens
from fullsphere.mosaic.pto_write import MOST_POINTS, write_pto
from laws import SEEDS, law

HEAD = 'p f2 w3600 h1800 v360 E0 R0 n"TIFF_m c:LZW r:CROP"\nm g1 i0 f0 m2 p0.00784314\n'
SIZE = (1001, 802)

has_hugin = pytest.mark.skipif(shutil.which("pano_trafo") is None, reason="Hugin's tools are not installed")

LENSES_OF_HUGIN = [
    PanoToolsLens(SIZE, 0, 90, b=0.02),
    PanoToolsLens(SIZE, 0, 150, a=0.01, b=-0.03, c=0.02, d=3.5, e=-2.25),
    PanoToolsLens(SIZE, 2, 170, a=0.01, b=-0.03, c=0.02),
    PanoToolsLens(SIZE, 3, 179.999),
    PanoToolsLens(SIZE, 3, 180, c=-0.02),
    PanoToolsLens(SIZE, 3, 235, a=0.01, b=-0.03, c=0.02, d=12.5, e=-31.25, g=8, t=-5),
    PanoToolsLens((2000, 802), 2, 386, a=-0.317, b=0.574, c=-0.155, d=-400, e=20),
    PanoToolsLens((802, 1001), 3, 190, b=-0.05),
    PanoToolsLens(SIZE, 8, 150, a=0.01, b=-0.03, c=0.02),
    PanoToolsLens(SIZE, 10, 200, a=0.01, b=-0.03, c=0.02),
    PanoToolsLens(SIZE, 20, 190, d=5, e=7),
    PanoToolsLens(SIZE, 20, 240, b=-0.03),
    PanoToolsLens(SIZE, 21, 300, a=0.01, b=-0.03, c=0.02),
]


def image_line(lens: PanoToolsLens, more: str = "", name: str = "a.jpg", angles: str = "r0 p0 y0") -> str:
    values = " ".join(f"{key}{getattr(lens, key)}" for key in "abcdegt")
    return f'i w{lens.size[0]} h{lens.size[1]} f{lens.kind} v{lens.hfov_deg} {angles} {values} {more} n"{name}"\n'


def project(folder: Path, *lines: str) -> Path:
    path = folder / "a.pto"
    path.write_text(HEAD + "".join(line if line.endswith("\n") else line + "\n" for line in lines))
    return path


def by_hugin(path: Path, image: int, pixels: FloatArray) -> FloatArray:
    """World rays of pixels of a picture, by pano_trafo, of a project whose panorama is a sphere."""
    text = "".join(f"{u:.9f} {v:.9f}\n" for u, v in pixels)
    said = subprocess.run(["pano_trafo", str(path), str(image)], input=text, capture_output=True, text=True, check=True)
    x, y = np.array(said.stdout.split(), float).reshape(-1, 2).T
    width = int(re.search(r"^p .*?w(\d+)", path.read_text(), re.M)[1])  # type: ignore[index]
    lon, lat = ((x + 0.5) / width - 0.5) * 2 * np.pi, (0.5 - (y + 0.5) / (width / 2)) * np.pi
    return np.stack([np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)], -1)


def some_pixels(size: tuple[int, int], count: int = 200, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform([0, 0], np.array(size) - 1.0, (count, 2))


def gap_px(lens: PanoToolsLens, pixels: FloatArray, rays: FloatArray) -> float:
    return float(np.nanmax(np.linalg.norm(lens.project(rays) - pixels, axis=1)))


@pytest.mark.parametrize("lens", LENSES_OF_HUGIN)
def test_unproject_inverts_project(lens: PanoToolsLens) -> None:
    pixels = some_pixels(lens.size)
    rays = lens.unproject(pixels)
    seen = np.isfinite(rays[:, 0])
    assert seen.sum() > 50
    assert np.allclose(np.linalg.norm(rays[seen], axis=1), 1)
    assert gap_px(lens, pixels[seen], rays[seen]) < 1e-6
    assert np.allclose(lens.project(lens.unproject([lens.axis_px])), [lens.axis_px])


@has_hugin
@pytest.mark.parametrize("lens", LENSES_OF_HUGIN)
def test_the_lens_is_hugins(tmp_path: Path, lens: PanoToolsLens) -> None:
    pixels = some_pixels(lens.size)
    rays = lens.unproject(pixels)
    pixels = pixels[np.arccos(rays[:, 2]) < 0.95 * lens.theta_max]
    path = project(tmp_path, image_line(lens, angles="r-37 p21 y133"))
    world_from_camera = orientation(133, 21, -37).T
    assert gap_px(lens, pixels, by_hugin(path, 0, pixels) @ world_from_camera) < 0.001


@pytest.mark.parametrize(
    ("lens", "kind"),
    [
        (PanoToolsLens(SIZE, 0, 90), Perspective),
        (PanoToolsLens(SIZE, 0, 90, b=0.02), Brown),
        (PanoToolsLens(SIZE, 2, 190), Equidistant),
        (PanoToolsLens(SIZE, 3, 190, b=-0.02), KannalaBrandt),
        (PanoToolsLens(SIZE, 8, 120), Orthographic),
        (PanoToolsLens(SIZE, 10, 200), Stereographic),
        (PanoToolsLens(SIZE, 20, 200), Thoby),
        (PanoToolsLens(SIZE, 21, 200), Equisolid),
    ],
)
def test_what_our_lenses_can_say_is_taken_exactly(lens: PanoToolsLens, kind: type) -> None:
    camera, error = camera_of(lens)
    assert isinstance(camera.lens, kind)
    assert error < 1e-9
    back = lens_of(dataclasses.replace(camera, half_fov=min(camera.half_fov, 0.999 * camera.lens.theta_max)), SIZE)
    assert back.error_px < 0.2


@pytest.mark.parametrize("lens", LENSES_OF_HUGIN)
def test_the_stated_error_bounds_the_difference(lens: PanoToolsLens) -> None:
    camera, error = camera_of(lens)
    assert error < (6 if lens.g else 1.2)  # a shear is no camera of ours
    pixels = some_pixels(lens.size, 2000)
    rays = camera.unproject(pixels)
    seen = np.isfinite(rays[:, 0])
    assert seen.sum() > 300
    assert gap_px(lens, pixels[seen], rays[seen]) <= error + 0.02


def test_a_circular_crop_ends_the_field_of_view() -> None:
    lens = PanoToolsLens((1000, 800), 2, 200)
    camera, _ = camera_of(lens, (100, 0, 800, 800))
    assert camera.size == (800, 800)
    assert camera.image_radius == pytest.approx(400, abs=1)
    whole, _ = camera_of(dataclasses.replace(lens, kind=3), (100, 0, 800, 800))
    assert whole.image_radius == pytest.approx(math.hypot(399.5, 399.5), abs=1)


FOLLOWED = [
    Camera(BaksteinPajdla(774.9, 2.11, 241.1, 1.13), (2000, 2000), (992.3, 1002.9), half_fov=1.597),
    Camera(BaksteinPajdla(774.9, 2.11, 241.1, 1.13), (2000, 1900), (992.3, 952.9), half_fov=1.597, aspect=1.001),
    Camera(KannalaBrandt(500, -0.031, 0.0043, 0, 0), (1920, 1920), (955.3, 965.9), half_fov=1.7),
    Camera(Equisolid(500), (1800, 1200), (905.3, 595.9), half_fov=1.92),
    Camera(Equidistant(300), (1800, 1200), (905.3, 595.9), half_fov=2.1),
    Camera(Stereographic(500), (1800, 1200), (905.3, 595.9), half_fov=2.0),
    Camera(Perspective(900), (1800, 1200), (905.3, 595.9), half_fov=1.0),
    Camera(Brown(900, -0.1, 0.03, -0.002), (1800, 1200), (905.3, 595.9), half_fov=0.89),
    Camera(DoubleSphere(480, -0.2, 0.58), (1800, 1200), (905.3, 595.9), half_fov=1.65),
]


def mosaic_of(camera: Camera, folder: Path, count: int = 3, crop: Any = None, turned: int = 0) -> Mosaic:
    rotations = ring(count)
    frames = tuple(
        Frame(
            f"frame {k}.png",
            str(folder / f"frame {k}.png"),
            camera.size,
            lambda: np.empty(0),
            camera_from_world=rotation,
            exposure_ev=0.25 * k - 0.3,
            white_balance=(1 + 0.125 * k, 1.0, 1 - 0.25 * k),
            crop_px=crop,
            turned=turned,
        )
        for k, rotation in enumerate(rotations)
    )
    links = matched(camera, rotations, count=40, noise_px=0.3)
    return Mosaic((camera,), frames, tuple(links), vignetting_ev=((-0.3, -0.1),))


@has_hugin
@pytest.mark.parametrize("camera", FOLLOWED)
def test_hugin_maps_pixels_to_the_panorama_where_we_do(tmp_path: Path, camera: Camera) -> None:
    mosaic = mosaic_of(camera, tmp_path)
    error = write_pto(tmp_path / "a.pto", mosaic)
    pixels = some_pixels(camera.size)
    seen = np.isfinite(camera.unproject(pixels)[:, 0])
    for k, frame in enumerate(mosaic.frames):
        assert error[frame.id] < 1.5
        rays = by_hugin(tmp_path / "a.pto", k, pixels[seen])
        opened = dataclasses.replace(camera, half_fov=min(camera.half_fov + 0.05, 0.999 * camera.lens.theta_max))
        gaps = np.linalg.norm(opened.project(rays @ frame.camera_from_world.T) - pixels[seen], axis=1)  # type: ignore[union-attr]
        assert np.max(gaps) < error[frame.id] + 0.1


@has_hugin
@pytest.mark.parametrize("turned", [1, 2, 3])
def test_turned_parts_of_a_file_are_written_as_the_file_holds_them(tmp_path: Path, turned: int) -> None:
    camera = Camera(Equisolid(300), (600, 700), (311.3, 340.9), half_fov=1.6, aspect=1.0)
    crop = (700, 10, 600, 700) if turned == 2 else (700, 10, 700, 600)
    mosaic = mosaic_of(camera, tmp_path, crop=crop, turned=turned)
    error = write_pto(tmp_path / "a.pto", mosaic)
    picture = np.zeros((800, 1500), np.int64)
    left, top, width, height = crop
    picture[top : top + height, left : left + width] = np.arange(width * height).reshape(height, width) + 1
    cv2.imwrite(str(tmp_path / "frame 0.png"), np.zeros((800, 1500), np.uint8))
    write_pto(tmp_path / "a.pto", mosaic, overwrite=True)
    frame = np.rot90(picture[top : top + height, left : left + width], -turned)
    assert frame.shape == (700, 600)
    rows, columns = np.array([300, 351, 420]), np.array([200, 351, 400])
    in_file = np.array([np.argwhere(picture == n)[0][::-1] for n in frame[rows, columns]], float)
    rays = by_hugin(tmp_path / "a.pto", 0, in_file)
    ours = camera.project(rays @ mosaic.frames[0].camera_from_world.T)  # type: ignore[union-attr]
    assert np.allclose(ours, np.stack([columns, rows], -1), rtol=0, atol=max(error.values()) + 0.1)


@pytest.mark.parametrize("camera", FOLLOWED)
@pytest.mark.parametrize("crop", [False, True])
def test_what_was_written_is_read_back(tmp_path: Path, camera: Camera, crop: bool) -> None:
    mosaic = mosaic_of(camera, tmp_path, crop=(camera.size[0] - 20, 0, *camera.size) if crop else None)
    write_pto(tmp_path / "a.pto", mosaic)
    read = read_pto(tmp_path / "a.pto")
    assert read.error_px == (0.0,)
    back = read.as_mosaic()
    assert back.cameras[0].lens == camera.lens
    assert (back.cameras[0].centre, back.cameras[0].size) == (camera.centre, camera.size)
    assert back.vignetting_ev[0] == pytest.approx(mosaic.vignetting_ev[0], abs=0.005)
    for frame, written in zip(back.frames, mosaic.frames, strict=True):
        assert (frame.id, frame.image, frame.size) == (written.id, written.image, written.size)
        assert (frame.crop_px, frame.shot) == (written.crop_px, written.shot)
        assert frame.exposure_ev == pytest.approx(written.exposure_ev)
        assert frame.white_balance == written.white_balance
        assert turn_between(frame.camera_from_world, written.camera_from_world) < 1e-11  # type: ignore[arg-type]
    for link, found in zip(back.links, mosaic.links, strict=True):
        assert (link.i, link.j) == (found.i, found.j)
        assert np.allclose(link.pixels_i, found.pixels_i, rtol=0, atol=1e-6)
        assert np.allclose(link.pixels_j, found.pixels_j, rtol=0, atol=1e-6)
        assert turn_between(link.j_from_i, found.j_from_i) < 0.01
    write_pto(tmp_path / "again.pto", dataclasses.replace(back, vignetting_ev=mosaic.vignetting_ev))
    assert (tmp_path / "again.pto").read_bytes() == (tmp_path / "a.pto").read_bytes()


@pytest.mark.parametrize("camera", FOLLOWED)
def test_saved_by_a_program_that_drops_comments_the_camera_is_fitted(tmp_path: Path, camera: Camera) -> None:
    errors = write_pto(tmp_path / "a.pto", mosaic_of(camera, tmp_path))
    text = re.sub("^#-fullsphere.*\n", "", (tmp_path / "a.pto").read_text(), flags=re.M)
    (tmp_path / "a.pto").write_text(text)
    read = read_pto(tmp_path / "a.pto")
    assert len(read.cameras) == 1
    left, top = (read.frames[0].crop_px or (0, 0))[:2]
    pixels = some_pixels(read.cameras[0].size)
    rays = read.cameras[0].unproject(pixels)
    gaps = np.linalg.norm(camera.project(rays) - pixels - (left, top), axis=1)
    assert np.isfinite(gaps).sum() > 100
    assert np.nanmax(gaps) < max(errors.values()) + read.error_px[0] + 0.02


def test_a_lens_changed_in_hugin_is_not_taken_from_the_comment(tmp_path: Path) -> None:
    write_pto(tmp_path / "a.pto", mosaic_of(FOLLOWED[3], tmp_path))
    text = (tmp_path / "a.pto").read_text()
    text = re.sub(r"^(i .*? v)([0-9.]+)", lambda found: f"{found[1]}{float(found[2]) + 1}", text, flags=re.M)
    (tmp_path / "a.pto").write_text(text)
    read = read_pto(tmp_path / "a.pto")
    assert read.cameras[0].lens != FOLLOWED[3].lens
    assert difference_px(read.cameras[0], read.lenses[0], (read.frames[0].crop_px or (0, 0))[:2]) < 0.1


@pytest.mark.parametrize("comment", ["{", "[]", '{"camera": 1}', '{"camera": {}, "crop_px": 3, "error_px": "x"}'])
def test_a_damaged_comment_is_a_comment(tmp_path: Path, comment: str) -> None:
    lens = PanoToolsLens(SIZE, 3, 190)
    read = read_pto(project(tmp_path, f"#-fullsphere {comment}\n", image_line(lens)))
    assert read.cameras[0].lens == camera_of(lens).camera.lens
    assert read.frames[0].id == "a.jpg"


@has_hugin
def test_hugin_goes_on_from_what_was_written(tmp_path: Path) -> None:
    camera = Camera(Equidistant(120), (400, 300), (201.3, 148.9), half_fov=1.7)
    mosaic = mosaic_of(camera, tmp_path)
    for frame in mosaic.frames:
        cv2.imwrite(frame.image, np.full((300, 400, 3), 128, np.uint8))
    true = ring(3)
    wrong = list(true)
    wrong[1] = Rotation.from_rotvec([0.02, 0.01, -0.02]).as_matrix() @ wrong[1]
    frames = [dataclasses.replace(f, camera_from_world=turn) for f, turn in zip(mosaic.frames, wrong, strict=True)]
    write_pto(tmp_path / "a.pto", dataclasses.replace(mosaic, frames=tuple(frames)))
    for command in (
        ["checkpto"],
        ["autooptimiser", "-n", "-o", str(tmp_path / "b.pto")],
        ["nona", "-o", str(tmp_path / "n")],
    ):
        subprocess.run([*command, str(tmp_path / "a.pto")], check=True, capture_output=True)
    assert len(list(tmp_path.glob("n*.tif"))) == 3
    optimised = read_pto(tmp_path / "b.pto")
    found = optimised.rotations
    assert turn_between(found[1] @ found[0].T, true[1] @ true[0].T) < 0.002


@has_hugin
def test_hugin_evens_out_exposure_white_balance_and_vignetting_as_we_do(tmp_path: Path) -> None:
    camera, (w1, w2) = Camera(Equidistant(120), (400, 400), (199.5, 199.5), half_fov=1.6), (-0.4, -0.3)
    v, u = np.mgrid[:400, :400]
    s = (np.hypot(u - 199.5, v - 199.5) / 120 / 1.6) ** 2
    frames = []
    for k, exposure_ev in enumerate((-0.5, 0.5)):
        light = np.where(s < 1, 0.3 * 2.0 ** (exposure_ev + w1 * s + w2 * s * s), 0)
        tint = (1.3 - k / 2, 1.0, 0.7 + k)
        name = tmp_path / f"{k}.png"
        cv2.imwrite(str(name), np.dstack([srgb8(light * factor) for factor in tint[::-1]]))
        frame = Frame(f"{k}", str(name), (400, 400), lambda: np.empty(0), exposure_ev=exposure_ev, white_balance=tint)
        frames.append(dataclasses.replace(frame, camera_from_world=np.eye(3)))
    write_pto(tmp_path / "a.pto", Mosaic((camera,), tuple(frames), (), vignetting_ev=((w1, w2),)))
    subprocess.run(["nona", "-r", "ldr", "-o", tmp_path / "n", tmp_path / "a.pto"], check=True, capture_output=True)
    for path in sorted(tmp_path.glob("n*.tif")):
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        codes = picture[..., :3][picture[..., 3] == 255] / 255
        light = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
        assert np.abs(np.log2(np.percentile(light, [2, 50, 98], axis=0) / 0.3)).max() < 0.15


def test_many_matches_are_thinned(tmp_path: Path) -> None:
    mosaic = mosaic_of(FOLLOWED[3], tmp_path)
    many = dataclasses.replace(
        mosaic.links[0], pixels_i=some_pixels((1800, 1200), 1001), pixels_j=some_pixels((1800, 1200), 1001)
    )
    write_pto(tmp_path / "a.pto", dataclasses.replace(mosaic, links=(many,)))
    assert MOST_POINTS / 2 < (tmp_path / "a.pto").read_text().count("\nc ") <= MOST_POINTS


def test_frames_left_out_are_told_and_their_links_are_not(tmp_path: Path) -> None:
    mosaic = mosaic_of(FOLLOWED[3], tmp_path)
    frames = (mosaic.frames[0].left_out("is\nblank"), *mosaic.frames[1:])
    write_pto(tmp_path / "a.pto", dataclasses.replace(mosaic, frames=frames))
    assert "\n# left out: frame 0.png: is blank\n" in (tmp_path / "a.pto").read_text()
    read = read_pto(tmp_path / "a.pto")
    assert [frame.id for frame in read.frames] == ["frame 1.png", "frame 2.png"]
    assert set(read.points.i) == {0} and set(read.points.j) == {1}


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    mosaic = mosaic_of(FOLLOWED[3], tmp_path)
    none = dataclasses.replace(mosaic, frames=tuple(frame.left_out("no") for frame in mosaic.frames))
    with pytest.raises(OutputError, match=r"a\.pto: not written: no frame is registered"):
        write_pto(tmp_path / "a.pto", none)
    write_pto(tmp_path / "a.pto", mosaic)
    with pytest.raises(OutputError, match="exists already"):
        write_pto(tmp_path / "a.pto", mosaic)


def test_a_project_is_read(tmp_path: Path) -> None:
    lens = PanoToolsLens((800, 400), 2, 400, b=-0.01, d=-200, e=3)
    other = 'i w800 h400 f2 v=0 r1 p2 y3 a=0 b=0 c=0 d200 e=0 g0 t0 Eev0.5 S400,800,0,400 n"dual.png"'
    cv2.imwrite(str(tmp_path / "dual.png"), np.zeros((400, 800, 3), np.uint8))
    read = read_pto(
        project(
            tmp_path,
            image_line(lens, "Eev1.25 S0,400,0,400", "dual.png", "r-10 p20 y30"),
            other,
            "c n0 N1 x100 y110 X500 Y210 t0",
            "c n1 N0 x600.5 y150 X150.25 Y140 t0",
            "c n1 N1 x600 y150 X600 Y250 t1",
            "c n0 N0 x100 y150 X300 Y150 t2",
            'k i0 t0 p"0 0 50 0 50 50 0 50"',
            'k i0 t2 p"0 0 50 0 50 50 0 50"',
            "v r1",
            "q something new",
        )
    )
    assert [frame.id for frame in read.frames] == ["dual.png:1", "dual.png:2"]
    assert [frame.crop_px for frame in read.frames] == [(0, 0, 400, 400), (400, 0, 400, 400)]
    assert [frame.camera for frame in read.frames] == [0, 1]
    assert [frame.exposure_ev for frame in read.frames] == [-1.25, -0.5]
    assert read.cameras[1].centre == pytest.approx((199.5, 202.5))
    assert read.missing == ()
    assert turn_between(read.rotations[0], orientation(30, 20, -10)) < 1e-12
    assert read.points.kind.tolist() == [0, 0, VERTICAL, HORIZONTAL]
    assert read.points.pixels_j[0].tolist() == [100, 210]
    (link,) = read.as_mosaic().links
    assert (link.i, link.j) == (0, 1)
    assert link.pixels_i.tolist() == [[100, 110], [150.25, 140]]
    assert link.pixels_j.tolist() == [[100, 210], [200.5, 150]]
    assert read.frames[0].load().shape == (400, 400, 3)
    mask = read.frames[0].mask
    assert mask is not None
    assert mask()[:49, :49].max() == 0 and mask()[52:].min() == 255
    assert read.frames[1].mask is None
    assert any("mask of kind t2" in note for note in read.notes)
    assert any("line 12: not understood" in note for note in read.notes)


def test_missing_pictures_are_named_and_left_out(tmp_path: Path) -> None:
    read = read_pto(project(tmp_path, image_line(PanoToolsLens(SIZE, 3, 190), name="sub/gone.jpg")))
    gone = str(tmp_path / "sub/gone.jpg")
    assert read.missing == (gone,)
    assert read.opened().frames[0].reason == f"there is no file {gone}"
    with pytest.raises(InputError, match=r"gone\.jpg: there is no such file"):
        read.frames[0].load()


def test_a_lens_is_calibrated_once_it_was_adjusted_or_written_here(tmp_path: Path) -> None:
    plain, bent = PanoToolsLens(SIZE, 3, 190, d=3), PanoToolsLens(SIZE, 3, 190, c=0.01)
    assert not read_pto(project(tmp_path, image_line(plain), image_line(bent))).calibrated
    assert read_pto(project(tmp_path, image_line(bent), image_line(bent))).calibrated
    write_pto(tmp_path / "b.pto", mosaic_of(FOLLOWED[4], tmp_path))
    written = read_pto(tmp_path / "b.pto")
    assert written.lenses[0].a == written.lenses[0].b == written.lenses[0].c == 0
    assert written.calibrated


def test_pictures_show_where_a_circular_fisheye_ends(tmp_path: Path) -> None:
    lens = PanoToolsLens((600, 500), 2, 220)
    v, u = np.mgrid[:500, :600]
    disc = np.where(np.hypot(u - 299.5, v - 249.5) < 230, 180, 2).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([disc] * 3))
    gone = image_line(lens, name="gone.png", angles="r1 p2 y3")
    read = read_pto(project(tmp_path, image_line(lens, name="a.png"), gone))
    assert read.opened().frames[0].prior is not None
    assert read.cameras[0].image_radius > 380
    assert read.opened().cameras[0].image_radius == pytest.approx(230, abs=2)


def test_pictures_that_cannot_be_used_are_left_out(tmp_path: Path) -> None:
    lens = PanoToolsLens((60, 50), 3, 120)
    for name, size in (("good.png", (50, 60)), ("small.png", (40, 60))):
        cv2.imwrite(str(tmp_path / name), np.random.default_rng(0).integers(0, 255, (*size, 3), np.uint8))
    (tmp_path / "damaged.png").write_bytes((tmp_path / "good.png").read_bytes()[:500])
    read = read_pto(project(tmp_path, *(image_line(lens, name=f"{name}.png") for name in ("good", "small", "damaged"))))
    assert read.opened().frames[0].prior is None  # the orientations of a new project are all alike
    reasons = [frame.reason for frame in read.opened().frames]
    assert reasons[0] == ""
    assert reasons[1] == "is 60 x 40 pixels, the project is for 60 x 50"
    assert reasons[2]


def test_a_mask_of_a_lens_is_that_of_all_its_pictures(tmp_path: Path) -> None:
    lens, other = PanoToolsLens(SIZE, 3, 190), PanoToolsLens(SIZE, 3, 180)
    lines = [image_line(lens, name="a.jpg"), image_line(lens, name="b.jpg"), image_line(other, name="c.jpg")]
    read = read_pto(project(tmp_path, *lines, 'k i0 t4 p"0 0 500 0 500 500"'))
    assert [frame.mask is not None for frame in read.frames] == [True, True, False]


@pytest.mark.parametrize(("told", "expected"), [("E13", [0.5, -1.0]), ("E0", [0.75, -0.75]), ("", [0.75, -0.75])])
def test_exposures_count_from_that_of_the_panorama_if_it_was_set(
    tmp_path: Path, told: str, expected: list[float]
) -> None:
    lines = [image_line(PanoToolsLens(SIZE, 3, 190), f"Eev{value}", f"{value}.jpg") for value in (12.5, 14)]
    path = project(tmp_path, *lines)
    path.write_text(path.read_text().replace("E0", told, 1))
    assert [frame.exposure_ev for frame in read_pto(path).frames] == expected


def test_what_was_not_taken_over_is_said(tmp_path: Path) -> None:
    read = read_pto(project(tmp_path, image_line(PanoToolsLens(SIZE, 3, 190), "TrX0.1")))
    assert any("line 3: the camera moved" in note for note in read.notes)


@pytest.mark.parametrize("told", ["Er0", "Eb-1", "Er1e9"])
def test_white_balances_that_are_none_are_refused(tmp_path: Path, told: str) -> None:
    with pytest.raises(InputError, match=rf"line 3: {told[:2]}"):
        read_pto(project(tmp_path, image_line(PanoToolsLens(SIZE, 3, 190), told)))


def test_links_hold_only_what_the_cameras_see(tmp_path: Path) -> None:
    lens = PanoToolsLens((800, 400), 2, 400)
    lines = [image_line(lens, "S200,600,0,400", name) for name in ("a.jpg", "b.jpg")]
    read = read_pto(project(tmp_path, *lines, "c n0 N1 x1 y1 X400 Y200 t0", "c n0 N1 x400 y100 X400 Y200 t0"))
    (link,) = read.as_mosaic().links
    assert len(link.pixels_i) == 1
    assert np.array_equal(link.j_from_i, np.eye(3))  # by the orientations: one match determines no rotation


GOOD = 'i w1000 h800 f3 v200 r0 p0 y0 n"a.jpg"'

MALFORMED = [
    ((), "holds no picture"),
    (("c n0 N0 x1 y1 X1 Y1 t0",), "holds no picture"),
    (("i w1000 h800 f3 v200 r0 p0 y0",), 'line 3 has no n"..." in quotes'),
    (('i w1000 h800 f3 vx n"a"',), r"line 3: v is '', not a number"),
    (('i w1000 h800 f3 v1.2.3 n"a"',), "line 3: v is '1.2.3', not a number"),
    (('i w1000 h800 f3 v1e999 n"a"',), "line 3: v is 1e999, out of all range"),
    (('i w1000 h800 f3 v-5 n"a"',), "line 3: v-5 is no horizontal field of view"),
    (('i w1000 h800 f0 v180 n"a"',), "line 3: v180 is no horizontal field of view of f0"),
    (('i w1000 h800 f10 v400 n"a"',), "line 3: v400 is wider than f10 can image"),
    (('i w1000 h800 f4 v360 n"a"',), "line 3: f4 is no lens; known are f0, f2, f3"),
    (('i w1000 h800 f2.5 v360 n"a"',), "line 3: f2.5 is not a whole number"),
    (('i h800 f3 v200 n"a"',), "line 3: w is '', not a number"),
    (('i w0 h800 f3 v200 n"a"',), "line 3: w0 is not a whole number from 1"),
    (('i w99999999 h800 f3 v200 n"a"',), "line 3: w1e.08 is not a whole number from 1 to"),
    (('i w1000 h800 f3 v200 a2 n"a"',), "line 3: a, b and c sum up to 2: the picture would be turned over"),
    (('i w1000 h800 f3 v200 b1e7 n"a"',), "line 3: b is 1e7, out of all range"),
    (('i w1000 h800 f3 v200 g1000 t800 n"a"',), "line 3: g and t shear the picture to a line"),
    (('i w1000 h800 f3 v200 y1e9 n"a"',), "line 3: y is 1e9, out of all range"),
    (('i w1000 h800 f3 v200 Eev1e9 n"a"',), "line 3: Eev is 1e9, out of all range"),
    (('i w1000 h800 f3 v200 S1,2,3 n"a"',), "line 3: S1,2,3 is not left, right, top and bottom"),
    (('i w1000 h800 f3 v200 S1,2,3,x n"a"',), "line 3: S is 'x', not a number"),
    (('i w1000 h800 f3 v200 S2000,3000,0,800 n"a"',), "line 3: S2000,3000,0,800 is no part of the 1000 x 800"),
    (('i w1000 h800 f3 v=0 n"a"',), "line 3: v=0 leads to no picture that has a value"),
    (('i w1000 h800 f3 v=7 n"a"',), "line 3: v=7 leads to no picture that has a value"),
    (('i w1000 h800 f3 v=1 n"a"', 'i w1000 h800 f3 v=0 n"b"'), "line 3: v=0 leads to no picture that has a value"),
    (('i w1000 h800 f3 v200 5 n"a"',), "line 3: '5' is no value with its name"),
    ((GOOD, "c n0 N1 x1 y1 X1 Y1 t0"), "line 4: N1 is the number of no picture; there are 1"),
    ((GOOD, "c n0 N-1 x1 y1 X1 Y1 t0"), "line 4: N-1 is not a whole number"),
    ((GOOD, "c n0 N0 x1 X1 Y1 t0"), "line 4: y is '', not a number"),
    ((GOOD, "c n0 N0 xnan y1 X1 Y1 t0"), "line 4: x is '', not a number"),
    ((GOOD, "c n0 N0 x1e30 y1 X1 Y1 t0"), "line 4: x is 1e30, out of all range"),
    ((GOOD, "c n0 N0 x1 y1 X1 Y1 t0.5"), "line 4: t0.5 is not a whole number"),
    ((GOOD, 'k i3 t0 p"0 0 1 1 2 2"'), "line 4: i3 is not a whole number from 0 to 0"),
    ((GOOD, 'k i0 t0 p"0 0 1 1 2"'), "line 4: p holds 5 numbers, no polygon"),
    ((GOOD, 'k i0 t0 p"0 0 1 1 2 x"'), "line 4: p is 'x', not a number"),
    ((GOOD, "k i0 t0"), 'line 4 has no p"..." in quotes'),
]


@pytest.mark.parametrize(("lines", "message"), MALFORMED)
def test_what_is_no_project_is_refused_by_the_line(tmp_path: Path, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=rf"^.*a\.pto: {message}"):
        read_pto(project(tmp_path, *lines))


@given(seed=SEEDS)
@law(60)
def test_a_damaged_project_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    lens = PanoToolsLens((800, 400), 2, 400, b=-0.01, d=-200, e=3)
    lines = image_line(lens, "Eev1.25 S0,400,0,400", "dual.png"), image_line(lens, "", "b.png").replace("v400", "v=0")
    folder = tmp_path_factory.mktemp("damaged")
    path = project(folder, *lines, "c n0 N1 x100 y110 X500 Y210 t0", 'k i0 t0 p"0 0 50 0 50 50 0 50"')
    content, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for place in rng.integers(len(HEAD), len(content), rng.integers(1, 4)):
        content[place] = rng.choice(list(b'0123456789.-=e"in c,S\n\xff'))
    path.write_bytes(content)
    with contextlib.suppress(FullsphereError):
        read = read_pto(path)
        assert len(read.frames) == len(read.lenses) > 0
        read.as_mosaic()


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.pto").write_bytes(b"\x89PNG\0\0")
    with pytest.raises(InputError, match=r"a\.pto: is no text"):
        read_pto(tmp_path / "a.pto")
    with pytest.raises(InputError, match=r"b\.pto: there is no such file"):
        read_pto(tmp_path / "b.pto")


def test_no_lens_of_hugins_images_half_of_the_sphere_as_a_point() -> None:
    with pytest.raises(CameraError, match="has no angle for"):
        PanoToolsLens.of_focal(SIZE, 21, 10.0)
