"""`fullsphere omnistereo`: a furnished room from a turning arm, against what ought to be seen; and bad input."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.cli.main import main
from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.images import read_picture
from fullsphere.model.lens import BaksteinPajdla
from fullsphere.model.store import save_camera
from fullsphere.mosaic.arm import mount_of
from fullsphere.mosaic.eyes import eyes_of
from fullsphere.mosaic.worlds import furnished_room, photograph_on_arm, true_mosaic

SIDE, COUNT, WIDTH, ARM = 256, 48, 384, 0.15
PITCH, ROLL = 0.5, -0.4
HALF_FOV = math.radians(92)


@dataclasses.dataclass(frozen=True)
class Turn:
    """Frames of one turn, all with known truth."""

    frames: list[str]
    camera: Path
    angles_deg: NDArray[np.float64]
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    rho: NDArray[np.float64]


def camera_of(half_fov: float = HALF_FOV) -> Camera:
    shape = BaksteinPajdla(1.35, 2.11, 0.42, 1.13)
    lens = shape.scaled(0.96 * SIDE / 2 / float(shape.radius(HALF_FOV)))
    return Camera(lens, (SIDE, SIDE), (SIDE / 2 + 0.7, SIDE / 2 - 1.2), half_fov=half_fov)


@pytest.fixture(scope="module")
def turn(tmp_path_factory: pytest.TempPathFactory) -> Turn:
    folder = tmp_path_factory.mktemp("turn")
    room, camera = furnished_room(texel_mm=12.0), camera_of()
    save_camera(folder / "camera.json", camera, overwrite=True)
    mount = mount_of(0, math.radians(PITCH), math.radians(ROLL))
    angles = np.arange(COUNT) * 360 / COUNT + np.random.default_rng(3).normal(0, 0.4, COUNT)
    paths = []
    for k, angle in enumerate(np.radians(angles)):
        frame = photograph_on_arm(
            room, camera, angle, ARM, mount=mount, exposure_ev=0.2 * math.sin(k), noise=0.003, seed=k, supersampling=1
        )
        paths.append(folder / f"turn_{k:02d}.png")
        cv2.imwrite(str(paths[-1]), frame[..., ::-1])
    truth = true_mosaic(room, ARM, WIDTH)
    left, right = eyes_of(encoded_from_linear(truth.light, np.uint8))
    return Turn([str(path) for path in paths], folder / "camera.json", angles, left, right, eyes_of(truth.rho)[0])


def run(turn: Turn, *options: object, frames: list[str] | None = None) -> int:
    given = turn.frames if frames is None else frames
    return main(["omnistereo", *given, "--camera", str(turn.camera), *map(str, options)])


def psnr(picture: NDArray[np.uint8], truth: NDArray[np.uint8]) -> float:
    """dB within 75 degrees of the horizon; exposure is free."""
    rows = slice(len(truth) // 12, -(len(truth) // 12))
    ours, true = picture[rows].astype(float), truth[rows].astype(float)
    scale = np.linalg.lstsq(np.stack([ours.ravel(), np.ones(ours.size)], 1), true.ravel(), rcond=None)[0]
    return float(10 * np.log10(255**2 / np.mean((ours * scale[0] + scale[1] - true) ** 2)))


def rolled_onto(picture: NDArray[np.uint8], truth: NDArray[np.uint8], angle_deg: float) -> NDArray[np.uint8]:
    """The picture turned to where the truth looks: the first frame's angle is 0 in it."""
    shift = angle_deg / 360 * picture.shape[1]
    matrix = np.array([[1.0, 0, shift], [0, 1, 0]])
    wide = np.hstack([picture] * 3)
    moved = cv2.warpAffine(wide, matrix, wide.shape[1::-1], flags=cv2.INTER_CUBIC)
    return np.asarray(moved[:, picture.shape[1] : 2 * picture.shape[1]], np.uint8)


@pytest.fixture(scope="module")
def made(turn: Turn, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    code = run(
        turn, "--size", WIDTH, "--arm", ARM, "-o", folder / "mosaic.tif", "--left", folder / "left.png",
        "--right", folder / "right.jpg", "--over-under", folder / "both.jpg", "--depth", folder / "depth.exr",
        "--anaglyph", folder / "red_cyan.png", "--report", folder / "report.html",
    )  # fmt: skip
    assert code == 0
    return folder


def test_both_eyes_show_what_they_ought_to(turn: Turn, made: Path) -> None:
    for name, truth in (("left.png", turn.left), ("right.jpg", turn.right)):
        eye = read_picture(made / name).pixels[..., :3]
        assert psnr(rolled_onto(eye, truth, turn.angles_deg[0]), truth) > 27
    wrong = read_picture(made / "left.png").pixels[..., :3]
    assert psnr(rolled_onto(wrong, turn.right, turn.angles_deg[0]), turn.right) < 20


def test_the_mosaic_and_the_pair_hold_the_same_pixels_as_the_eyes(made: Path) -> None:
    left = read_picture(made / "left.png").pixels
    mosaic = read_picture(made / "mosaic.tif").pixels
    np.testing.assert_array_equal(eyes_of(mosaic)[0], left)
    both = read_picture(made / "both.jpg").pixels
    assert both.shape == (WIDTH, WIDTH, 3)
    assert np.abs(both[: WIDTH // 2].astype(int) - left[..., :3]).mean() < 3
    right = read_picture(made / "right.jpg").pixels
    assert np.abs(both[WIDTH // 2 :].astype(int) - right).mean() < 3
    assert b"top-bottom" in (made / "both.jpg").read_bytes()
    assert b"equirectangular" in (made / "right.jpg").read_bytes()


def test_range_is_told_in_the_unit_of_the_arm(turn: Turn, made: Path) -> None:
    depth = read_picture(made / "depth.exr").pixels
    known = depth[..., -1] > 0
    shift = round(turn.angles_deg[0] / 360 * WIDTH)
    truth = np.roll(turn.rho, -shift, axis=1) * ARM
    rows = slice(WIDTH // 8, -WIDTH // 8)
    wrong = np.abs(depth[..., 0] / truth - 1)[rows][known[rows]]
    assert known[rows].mean() > 0.5
    assert np.median(wrong) < 0.05


def test_angles_and_mount_are_told(turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(turn, "--size", 64, "-o", tmp_path / "m.png", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    found = np.array([told["angles_deg"][Path(name).name] for name in turn.frames])
    off = (found - turn.angles_deg + 180) % 360 - 180
    assert np.abs(off - np.median(off)).max() < 0.1
    assert told["mount_deg"]["pitch"] == pytest.approx(PITCH, abs=0.05)
    assert told["mount_deg"]["roll"] == pytest.approx(ROLL, abs=0.05)
    assert told["seen"] == 1


def test_told_angles_give_the_same_picture_whatever_the_threads(turn: Turn, tmp_path: Path) -> None:
    angles = tmp_path / "angles.txt"
    angles.write_text("".join(f"{Path(f).name} {a}\n" for f, a in zip(turn.frames, turn.angles_deg, strict=True)))
    for threads in (1, 2):
        path = tmp_path / f"m{threads}.png"
        options = ("--angles", angles, "--mount", "straight", "--size", 128, "--threads", threads)
        assert run(turn, *options, "-o", path) == 0
    assert (tmp_path / "m1.png").read_bytes() == (tmp_path / "m2.png").read_bytes()


def test_what_does_not_fit_into_memory_is_made_on_the_disk(
    turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--angles", "even", "--mount", "straight", "--size", 256, "--threads", 2)
    assert run(turn, *options, "-o", tmp_path / "a.png", "--memory", "20MB") == 6
    said = capsys.readouterr().err
    assert "--memory 20MB is too little for 48 frames of 256 x 256 pixels" in said
    least = re.search(r"at least (\d+MB)", said)
    assert least is not None
    for name, memory in (("a", "2GB"), ("b", least[1])):
        assert run(turn, *options, "-o", tmp_path / f"{name}.png", "--memory", memory) == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_a_damaged_frame_is_left_out_and_said(turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damaged = tmp_path / "turn_05.png"
    damaged.write_bytes(Path(turn.frames[5]).read_bytes()[:20_000])
    frames = [str(damaged) if k == 5 else name for k, name in enumerate(turn.frames)]
    assert run(turn, "--size", 64, "-o", tmp_path / "m.png", "--strict", frames=frames) == 3
    assert "turn_05.png is left out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ((), 2, "nothing is to be written"),
        (("-o", "m.webp"), 2, "names no known format"),
        (("-o", "m.png", "--left", "m.png"), 2, "is to be written twice"),
        (("-o", "m.png", "--report", "m.png"), 2, "is to be written twice"),
        (("-o", "m.png", "--size", "130"), 2, "no multiple of 4"),
        (("--depth", "d.png"), 2, "range is floats"),
        (("--over-under", "m.jpg", "--size", "70000"), 2, "at most 65500"),
        (("-o", "m.png", "--angles", "gone.txt"), 3, "gone.txt: there is no such file of angles"),
        (("-o", "m.png", "--direction", "left"), 2, "--direction is for --angles even"),
        (("-o", "m.png", "--arm", "0"), 2, "no length"),
        (("-o", "nowhere/m.png"), 5, "nowhere"),
    ],
)
def test_slips_are_told_before_the_work(
    turn: Turn,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    code: int,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(turn, *options) == code
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_lens_that_does_not_reach_90_degrees_is_told_what_could_be_done(
    turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_camera(tmp_path / "narrow.json", camera_of(math.radians(85)), overwrite=True)
    code = main(["omnistereo", *turn.frames, "--camera", str(tmp_path / "narrow.json"), "-o", str(tmp_path / "m.png")])
    assert code == 4
    said = capsys.readouterr().err
    assert "85.0 degrees" in said
    assert "slit at 83 degrees" in said


def test_less_than_a_turn_is_refused(turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(turn, "-o", tmp_path / "m.png", frames=turn.frames[:24]) == 4
    assert "turn" in capsys.readouterr().err
    assert not (tmp_path / "m.png").exists()


def test_a_camera_of_another_shape_is_refused(turn: Turn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = []
    for name in turn.frames:
        frames.append(str(tmp_path / Path(name).name))
        shutil.copy(name, frames[-1])
        cv2.imwrite(frames[-1], np.zeros((100, 140, 3), np.uint8))
    assert run(turn, "-o", tmp_path / "m.png", frames=frames) in (2, 3)
    assert "140 x 100" in capsys.readouterr().err
