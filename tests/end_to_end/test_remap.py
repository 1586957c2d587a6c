"""`fullsphere remap` as it is used: one picture, many of them, raw frames; and what goes wrong with each."""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rooms import Outcome, Set

from fullsphere.model.images import Picture, gpano, open_panorama, open_picture, read_picture
from fullsphere.model.projection_text import parse_projection
from fullsphere.model.remap import remap

Run = Callable[..., Outcome]
Pixels = NDArray[Any]

# Ctrl-C is switched back on: a runner in the background may have left it ignored.
PROGRAM = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "from fullsphere.cli.main import main; sys.exit(main(sys.argv[1:]))"
)


def child(*arguments: object, **options: Any) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", PROGRAM, "remap", *map(str, arguments)], **options)


def save(path: Path, pixels: Pixels, **options: Any) -> Path:
    height, width, channels = pixels.shape
    with open_panorama(path, (width, height), channels, pixels.dtype, {}, overwrite=True, **options) as writer:
        writer.write_rows(0, pixels)
    return path


def scene(width: int, channels: int = 3, dtype: type = np.uint8) -> Pixels:
    """A smooth sphere of colours."""
    u, v = np.meshgrid(np.linspace(0, 2 * math.pi, width, endpoint=False), np.linspace(0, math.pi, width // 2))
    waves = [0.5 + 0.4 * np.sin(k * u + k) * np.sin(v) ** 2 * np.cos(v * k) for k in range(1, channels + 1)]
    return (np.stack(waves, -1) * (np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1)).astype(dtype)


def by_hand(image: Pixels, source: str, target: str) -> tuple[Pixels, Pixels]:
    one, other = parse_projection(source), parse_projection(target)
    turn = other.world_from_projection.T @ one.world_from_projection
    return remap(image, one.projection, other.projection, turn)


# --- one picture ----------------------------------------------------------------------------------------------------


def test_a_frame_becomes_the_sphere_with_what_was_seen_as_alpha(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    frame = room_set.frames[0]
    run = fullsphere(
        *("remap", frame, "--from", room_set.camera_file, "--to", "equirectangular:512", "-o", tmp_path / "s.tif"),
        "--json",
    )
    assert (run.code, run.err) == (0, "")
    written = read_picture(tmp_path / "s.tif").pixels
    pixels, weight = by_hand(read_picture(frame).pixels, str(room_set.camera_file), "equirectangular:512")
    assert np.array_equal(written[..., :3], pixels)
    assert np.array_equal(written[..., 3], np.rint(weight * 255))
    said = json.loads(run.out)
    assert said["size_px"] == [512, 256]
    assert said["pictures"][0]["seen"] == pytest.approx(weight.mean(), abs=1e-6)
    assert said["left_out"] == {}


def test_there_and_back_again_is_the_frame(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    frame, lens = room_set.frames[0], room_set.camera_file
    sphere = tmp_path / "sphere.tif"
    assert fullsphere("remap", frame, "--from", lens, "--to", "equirectangular:2048", "-o", sphere).code == 0
    back = ("--from", "equirectangular:2048", "--to", lens, "-o", tmp_path / "back.png")
    assert fullsphere("remap", sphere, *back).code == 0
    before, after = read_picture(frame).pixels, read_picture(tmp_path / "back.png").pixels
    seen = after[..., 3] == 255
    assert seen.mean() > 0.6
    assert np.abs(after[..., :3].astype(float) - before)[seen].mean() < 3


def test_a_turned_view_looks_where_it_says(fullsphere: Run, tmp_path: Path) -> None:
    picture = save(tmp_path / "sphere.png", scene(256))
    view = "perspective:64x48:hfov=60:yaw=70:pitch=-20:roll=15"
    run = fullsphere("remap", picture, "--from", "equirectangular:256", "--to", view, "-o", tmp_path / "v.png")
    assert run.code == 0
    written = read_picture(tmp_path / "v.png").pixels
    target = parse_projection(view)
    middle = parse_projection("equirectangular:256").projection.project(target.world_from_projection[:, 2])
    expected = scene(256)[round(middle[1]), round(middle[0])]
    assert np.abs(written[24, 32, :3].astype(int) - expected).max() <= 8
    assert (written[..., 3] == 255).all()


def test_the_same_turn_on_both_sides_changes_nothing(fullsphere: Run, tmp_path: Path) -> None:
    picture = save(tmp_path / "sphere.png", scene(128))
    turned = "equirectangular:128:yaw=77:pitch=13:roll=-5"
    run = fullsphere("remap", picture, "--from", turned, "--to", turned, "-o", tmp_path / "same.png")
    assert run.code == 0
    difference = read_picture(tmp_path / "same.png").pixels[..., :3].astype(int) - scene(128)
    assert np.abs(difference).max() <= 1


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--interpolation", "nearest"), {"interpolation": "nearest"}),
        (("--interpolation", "linear"), {"interpolation": "linear"}),
        (("--interpolation", "lanczos3"), {"interpolation": "lanczos3"}),
        (("--no-antialias",), {"antialias": False}),
        (("--linear-light",), {"linear_light": True}),
    ],
)
def test_the_options_of_sampling_are_those_of_the_library(
    fullsphere: Run, tmp_path: Path, options: tuple[str, ...], named: dict[str, Any]
) -> None:
    noise = np.random.default_rng(5).integers(0, 256, (64, 128, 3), np.uint8)
    picture = save(tmp_path / "in.png", noise)
    common = ("--from", "equirectangular:128", "--to", "equirectangular:48:yaw=11", "-o", tmp_path / "o.png")
    assert fullsphere("remap", picture, *common, *options).code == 0
    written = read_picture(tmp_path / "o.png").pixels[..., :3]
    target = parse_projection("equirectangular:48:yaw=11")
    way = (parse_projection("equirectangular:128").projection, target.projection, target.world_from_projection.T)
    assert np.array_equal(written, remap(noise, *way, **named)[0])
    assert not np.array_equal(written, remap(noise, *way)[0])


@pytest.mark.parametrize(
    ("ending", "dtype", "channels", "written"),
    [
        ("tif", np.uint8, 1, 2),
        ("tif", np.uint16, 3, 4),
        ("tif", np.float32, 3, 4),
        ("tif", np.uint8, 4, 4),
        ("png", np.uint16, 3, 4),
        ("jpg", np.uint8, 1, 1),
        ("jpg", np.uint8, 3, 3),
        ("exr", np.float16, 3, 4),
        ("exr", np.float32, 1, 2),
    ],
)
def test_samples_stay_what_they_are(
    fullsphere: Run, tmp_path: Path, ending: str, dtype: type, channels: int, written: int
) -> None:
    picture = save(tmp_path / f"in.{ending}", scene(64, channels, dtype))
    out = tmp_path / f"out.{ending}"
    run = fullsphere("remap", picture, "--from", "equirectangular:64", "--to", "equirectangular:64:yaw=90", "-o", out)
    assert run.code == 0
    with open_picture(out) as file:
        assert (file.dtype.name, file.channels) == (np.dtype(dtype).name, written)
        rolled = np.roll(scene(64, channels, dtype), -16, axis=1).astype(float)
        whole = np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1
        colours = min(channels, 3) if channels != 2 else 1
        difference = file.window(0, 0, 64, 32)[..., :colours].astype(float) - rolled[..., :colours]
        assert np.abs(difference).max() < (0.06 if ending == "jpg" else 0.01) * whole


def test_light_brighter_than_white_is_kept(fullsphere: Run, tmp_path: Path) -> None:
    picture = save(tmp_path / "in.exr", scene(64, 3, np.float32) * 1000)
    run = fullsphere(
        "remap", picture, "--from", "equirectangular:64", "--to", "equirectangular:32", "-o", tmp_path / "out.exr"
    )
    assert run.code == 0
    assert read_picture(tmp_path / "out.exr").pixels[..., :3].max() > 700


def test_alpha_can_be_left_out_and_the_file_packed_otherwise(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    common = (room_set.frames[0], "--from", room_set.camera_file, "--to", "equirectangular:128")
    sizes = {}
    for kind in ("none", "lzw", "zip"):
        out = tmp_path / f"{kind}.tif"
        assert fullsphere("remap", *common, "-o", out, "--no-alpha", "--compression", kind).code == 0
        assert read_picture(out).pixels.shape == (64, 128, 3)
        sizes[kind] = out.stat().st_size
    assert sizes["none"] > sizes["lzw"] > sizes["zip"]
    assert fullsphere("remap", *common, "-o", tmp_path / "x.tif", "--compression", "piz").code == 2


def test_profile_and_notes_of_the_camera_are_carried_on(fullsphere: Run, tmp_path: Path) -> None:
    profile = bytes(16) + b"RGB " + bytes(108)
    attributes: dict[str, str | float] = {"Make": "Nikon", "Model": "Coolpix 950", "ExposureTime": 0.01}
    with open_panorama(
        tmp_path / "in.jpg", (64, 32), 3, np.uint8, attributes, overwrite=False, icc_profile=profile
    ) as writer:
        writer.write_rows(0, scene(64))
    common = ("--from", "equirectangular:64", "--to", "equirectangular:128")
    for name in ("out.tif", "out.jpg", "out.png"):
        assert fullsphere("remap", tmp_path / "in.jpg", *common, "-o", tmp_path / name).code == 0
        found = read_picture(tmp_path / name)
        assert found.icc_profile == profile or name == "out.png"  # libpng leaves out what is no whole profile
        assert found.metadata["Model"] == "Coolpix 950"
        assert found.metadata["ExposureTime"] == pytest.approx(0.01)


def gpano_of(path: Path) -> dict[str, str]:
    """The GPano fields of the XMP packet in a file."""
    return dict(re.findall(r'GPano:(\w+)="([^"]*)"', path.read_bytes().decode("latin-1")))


@pytest.mark.parametrize(
    ("target", "fields"),
    [
        ("equirectangular:128", gpano((128, 64))),
        ("equirectangular:64:lon=-90..90", gpano((128, 64), (32, 0, 64, 64))),
        ("equirectangular:64:lon=-90..90:lat=0..45", gpano((128, 64), (32, 16, 64, 16))),
        ("equirectangular:64x64:lon=-90..90:lat=0..45", {}),  # its pixels are not square
        ("equirectangular:64:lon=90..270:lat=0..45", {}),  # goes past the border of the whole
        ("perspective:64x64:hfov=90", {}),
    ],
)
def test_viewers_are_told_what_part_of_the_sphere_it_is(
    fullsphere: Run, tmp_path: Path, target: str, fields: dict[str, object]
) -> None:
    picture = save(tmp_path / "in.png", scene(64))
    assert (
        fullsphere("remap", picture, "--from", "equirectangular:64", "--to", target, "-o", tmp_path / "o.jpg").code == 0
    )
    assert gpano_of(tmp_path / "o.jpg") == {key.removeprefix("GPano:"): str(value) for key, value in fields.items()}


def test_a_scaled_and_a_cropped_picture_keep_their_calibration(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    frame, _ = by_hand(scene(2048), "equirectangular:2048", str(room_set.camera_file))
    full = save(tmp_path / "full.png", frame)
    half = save(tmp_path / "half.png", cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    part = save(tmp_path / "part.png", np.ascontiguousarray(frame[100:500, 50:600]))
    common = ("--from", room_set.camera_file, "--to", "perspective:120x120:hfov=70")

    def remapped(picture: Path, *stated: str) -> Pixels:
        out = tmp_path / f"{picture.stem}_out.png"
        assert fullsphere("remap", picture, *common, "-o", out, *stated).code == 0
        return read_picture(out).pixels[..., :3].astype(float)

    whole = remapped(full)
    assert np.abs(remapped(half, "--scale", "0.5") - whole).mean() < 0.5
    assert np.abs(remapped(part, "--crop", "50,100,550x400") - whole).max() <= 1
    other = fullsphere("remap", half, *common, "-o", tmp_path / "x.png")
    assert other.code == 3
    assert "320 x 320" in other.error_line
    assert "640 x 640" in other.error_line
    assert "--scale 0.5" in other.error_line


def test_a_large_picture_is_read_by_region_with_the_same_result_but_for_rounding(
    room_set: Set, fullsphere: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = save(tmp_path / "frame.tif", read_picture(room_set.frames[0]).pixels)
    common = ("remap", frame, "--from", room_set.camera_file, "--to", "equirectangular:600")
    assert fullsphere(*common, "-o", tmp_path / "whole.tif").code == 0
    monkeypatch.setattr(importlib.import_module("fullsphere.model.remap"), "_WHOLE_BYTES", 0)
    assert fullsphere(*common, "-o", tmp_path / "regions.tif").code == 0
    whole, regions = (read_picture(tmp_path / f"{name}.tif").pixels.astype(int) for name in ("whole", "regions"))
    assert np.abs(whole - regions).max() <= 1
    assert (whole != regions).mean() < 1e-3


# --- many pictures --------------------------------------------------------------------------------------------------


def test_many_pictures_are_those_made_one_by_one_on_any_number_of_threads(
    room_set: Set, fullsphere: Run, tmp_path: Path
) -> None:
    common = ("--from", room_set.camera_file, "--to", "cube:64", "--format", "png")
    for threads in ("1", "2", "5"):
        run = fullsphere("remap", *room_set.frames, *common, "-o", f"{tmp_path}/{threads}/", "--threads", threads)
        assert run.code == 0
        assert "5 pictures of 192 x 128 pixels" in run.out
    for frame in room_set.frames:
        run = fullsphere("remap", frame, *common, "-o", f"{tmp_path}/", "--overwrite")
        assert run.code == 0
        alone = (tmp_path / f"{frame.stem}.png").read_bytes()
        assert all((tmp_path / n / f"{frame.stem}.png").read_bytes() == alone for n in ("1", "2", "5"))


def test_one_broken_picture_is_named_and_the_others_are_done(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    shots, out = tmp_path / "shots", tmp_path / "out"
    shots.mkdir()
    for frame in room_set.frames[:3]:
        shutil.copy(frame, shots)
    (shots / "frame_1.jpg").write_bytes(room_set.frames[1].read_bytes()[:9000])
    common = ("--from", room_set.camera_file, "--to", "equirectangular:64", "-o", f"{out}/")
    run = fullsphere("remap", shots, shots / "nowhere.jpg", *common, "--json")
    assert run.code == 3
    assert len(run.warnings) == 2
    assert "frame_1.jpg" in run.warnings[0]
    assert "nowhere.jpg" in run.warnings[1]
    assert "2 of 4 pictures" in run.error_line
    assert sorted(path.name for path in out.iterdir()) == ["frame_0.jpg", "frame_2.jpg"]
    said = json.loads(run.out)
    assert [Path(done["picture"]).name for done in said["pictures"]] == ["frame_0.jpg", "frame_2.jpg"]
    assert sorted(Path(name).name for name in said["left_out"]) == ["frame_1.jpg", "nowhere.jpg"]


def test_a_picture_of_another_size_does_not_stop_the_others(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    small = save(tmp_path / "small.jpg", np.zeros((20, 30, 3), np.uint8))
    common = ("--from", room_set.camera_file, "--to", "equirectangular:64", "-o", f"{tmp_path}/out/")
    run = fullsphere("remap", small, room_set.frames[0], *common)
    assert run.code == 3
    assert "30 x 20" in run.warnings[0]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["frame_0.jpg"]


def test_existing_files_are_refused_before_any_work(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "frame_4.jpg").write_bytes(b"precious")
    common = ("--from", room_set.camera_file, "--to", "equirectangular:64", "-o", tmp_path)
    run = fullsphere("remap", *room_set.frames, *common)
    assert run.code == 5
    assert "frame_4.jpg" in run.error_line
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"precious"]
    assert fullsphere("remap", *room_set.frames, *common, "--overwrite").code == 0
    assert len(list(tmp_path.iterdir())) == 5


# --- what goes wrong ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("equirectangular:64:yaw=nan", "yaw=nan"),
        ("equirectangular:64:pitch=inf", "pitch=inf"),
        ("equirectangular:64:roll=1e999", "roll=1e999"),
        ("perspective:0x64:hfov=90", "0x64"),
        ("equirectangular:0", "equirectangular:0"),
        ("perspective:64x64:hfov=180", "less than 180"),
        ("orthographic:64:fov=190", "at most 180"),
        ("sphere:64", "equirectangular, cylindrical, mercator, perspective"),
        ("equirectangular:64:tilt=3", "yaw="),
    ],
)
def test_a_target_that_cannot_be_is_a_usage_error(fullsphere: Run, tmp_path: Path, target: str, words: str) -> None:
    picture = save(tmp_path / "in.png", scene(64))
    run = fullsphere("remap", picture, "--from", "equirectangular:64", "--to", target, "-o", tmp_path / "o.png")
    assert run.code == 2
    assert words in run.error_line
    assert not (tmp_path / "o.png").exists()


def test_a_camera_beyond_its_lens_is_refused(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    camera = json.loads(room_set.camera_file.read_text())
    camera["half_field_of_view_deg"] = 400
    (tmp_path / "wide.json").write_text(json.dumps(camera))
    run = fullsphere(
        "remap", room_set.frames[0], "--from", tmp_path / "wide.json", "--to", "cube:8", "-o", tmp_path / "o.png"
    )
    assert run.code == 3
    assert "wide.json" in run.error_line


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("nowhere.png", "-o", "o.png"), 3, "nowhere.png: there is no such file"),
        (("in.png", "-o", "in.png"), 5, "in.png: is an input"),
        (("in.png", "-o", "in.png", "--overwrite"), 5, "in.png: is an input"),
        (("in.png", "-o", "o.gif"), 2, ".gif"),
        (("in.png", "-o", "no/o.png"), 5, "does not exist"),
        (("deep.png", "-o", "o.jpg"), 2, "uint8"),
        (("in.png", "in.png", "-o", "o.png"), 2, "need a folder"),
        (("in.png", "-o", "o.png", "--scale", "0.5"), 2, "--scale 0.5: is for cameras"),
        (("in.png", "-o", "o.png", "--scale", "nan"), 2, "--scale"),
        (("in.png", "-o", "o.png", "--memory", "much"), 2, "--memory"),
        (("in.png", "-o", "-"), 2, "--raw"),
        (("-", "-o", "o.png"), 2, "--raw"),
        (("in.png", "-o", "o.png", "--raw", "64x32:rgb24"), 2, "standard input"),
        (("-", "-o", "-", "--raw", "64x32"), 2, "64x32"),
        (("-", "-o", "-", "--raw", "64x32:yuv420p"), 2, "yuv420p"),
        (("-", "-o", "-", "--raw", "64x32:rgb24", "--format", "png"), 2, "--format"),
        (("-", "-o", "-", "--raw", "32x32:rgb24"), 3, "standard input: is 32 x 32 pixels"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    fullsphere: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], code: int, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    save(Path("in.png"), scene(64))
    save(Path("deep.png"), scene(64, 3, np.uint16))
    run = fullsphere("remap", *arguments, "--from", "equirectangular:64", "--to", "equirectangular:64:yaw=5")
    assert run.code == code
    assert words in run.error_line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep.png", "in.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
@pytest.mark.parametrize("several", [False, True])
def test_a_full_disk_ends_the_run_and_leaves_nothing(tmp_path: Path, several: bool) -> None:
    import resource

    noise = np.random.default_rng(1).integers(0, 256, (64, 128, 3), np.uint8)
    pictures = [save(tmp_path / f"{k}.png", noise) for k in range(4 if several else 1)]
    out = f"{tmp_path}/out/" if several else f"{tmp_path}/out.tif"
    with child(
        *(*pictures, "--from", "equirectangular:128", "--to", "equirectangular:512", "-o", out),
        stderr=subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    ) as process:
        said = process.communicate()[1].decode()
    assert process.returncode == 5, said
    assert "cannot be written" in said
    assert "Traceback" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in pictures)


def test_an_interrupted_batch_leaves_whole_files_or_none(room_set: Set, tmp_path: Path) -> None:
    shots = tmp_path / "shots"
    shots.mkdir()
    for k in range(40):
        shutil.copy(room_set.frames[k % 5], shots / f"{k:02}.jpg")
    out = tmp_path / "out"
    with child(
        *(shots, "--from", room_set.camera_file, "--to", "equirectangular:1024", "-o", f"{out}/", "--format", "tif"),
        stderr=subprocess.PIPE,
    ) as process:
        while not (out.exists() and any(out.glob("*.tif"))):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1].decode()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    finished = list(out.iterdir())
    assert 0 < len(finished) < 40
    assert all(read_picture(path).pixels.shape == (512, 1024, 4) for path in finished)


# --- raw frames -----------------------------------------------------------------------------------------------------


def frames_of(count: int, size: int = 96) -> list[Pixels]:
    return [np.roll(scene(size), 5 * k, axis=1) for k in range(count)]


VIEW = ("--from", "equirectangular:96", "--to", "perspective:80x60:hfov=100:pitch=20")


@pytest.mark.parametrize("threads", [1, 3])
def test_raw_frames_become_those_of_the_library(threads: int) -> None:
    frames = frames_of(7)
    with child(
        *("-", "--raw", "96x48:rgb24", *VIEW, "-o", "-", "--threads", threads),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        out, said = process.communicate(b"".join(frame.tobytes() for frame in frames))
    assert process.returncode == 0, said
    assert b"become 80x60:rgb24" in said
    assert b"7 frames" in said
    expected = b"".join(by_hand(frame, VIEW[1], VIEW[3])[0].tobytes() for frame in frames)
    assert out == expected


def test_a_reader_of_raw_frames_that_leaves_ends_the_run_in_silence() -> None:
    with child(
        *("-", "--raw", "96x48:rgba", *VIEW, "-o", "-", "--json"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(bytes(96 * 48 * 4))
        process.stdin.flush()
        assert len(process.stdout.read(1000)) == 1000
        process.stdout.close()
        with pytest.raises(BrokenPipeError):  # the sender is not kept waiting either
            while True:
                process.stdin.write(bytes(96 * 48 * 4))
                process.stdin.flush()
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()
        said = process.stderr.read()
        process.wait()
    assert (process.returncode, said) == (5, b"")


def test_an_interrupt_while_the_sender_is_silent_ends_the_run() -> None:
    with child(
        *("-", "--raw", "96x48:gray", *VIEW, "-o", "-"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(bytes(96 * 48))
        process.stdin.flush()
        assert len(process.stdout.read(80 * 60)) == 80 * 60
        process.send_signal(signal.SIGINT)
        process.wait()
        said = process.stderr.read()
        process.stdin.close()
    assert process.returncode == 130
    assert b"Traceback" not in said
    assert b"interrupted" in said


def test_an_incomplete_frame_is_named_after_those_before_it_are_written(tmp_path: Path) -> None:
    (tmp_path / "in.raw").write_bytes(bytes(2 * 96 * 48 + 17))
    with (tmp_path / "in.raw").open("rb") as coming, (tmp_path / "out.raw").open("wb") as going:
        process = child(
            *("-", "--raw", "96x48:gray", *VIEW, "-o", "-", "--json"),
            stdin=coming,
            stdout=going,
            stderr=subprocess.PIPE,
        )
        said = process.communicate()[1].decode()
    assert process.returncode == 3
    assert "frame 3 is incomplete, 17 of 4608 bytes" in said
    assert (tmp_path / "out.raw").stat().st_size == 2 * 80 * 60


def test_ffmpeg_feeds_and_takes_frames(tmp_path: Path) -> None:
    if shutil.which("ffmpeg") is None:
        pytest.skip("ffmpeg is not installed")
    for k, frame in enumerate(frames_of(4, 192)):
        save(tmp_path / f"{k}.png", frame)
    feeding = subprocess.Popen(
        ["ffmpeg", "-v", "error", "-i", str(tmp_path / "%d.png"), "-f", "rawvideo", "-pix_fmt", "bgr24", "-"],
        stdout=subprocess.PIPE,
    )
    remapping = child(
        *("-", "--raw", "192x96:bgr24", "--from", "equirectangular:192", "--to", "equirectangular:64", "-o", "-"),
        stdin=feeding.stdout,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    taking = subprocess.run(
        [
            "ffmpeg",
            "-v",
            "error",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "bgr24",
            "-s",
            "64x32",
            "-i",
            "-",
            tmp_path / "out%d.png",
        ],
        stdin=remapping.stdout,
        check=True,
    )
    with feeding, remapping:
        assert remapping.stderr is not None
        remapping.stderr.read()
    assert (feeding.returncode, remapping.returncode, taking.returncode) == (0, 0, 0)
    results = sorted(tmp_path.glob("out*.png"))
    assert len(results) == 4
    whole: Picture = read_picture(results[3])
    expected, _ = by_hand(frames_of(4, 192)[3], "equirectangular:192", "equirectangular:64")
    assert np.abs(whole.pixels.astype(int) - expected).max() <= 1
