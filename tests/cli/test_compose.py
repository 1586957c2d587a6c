"""The parts of the compose command: what the options mean, and what they refuse."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

from fullsphere.cli import composing, console
from fullsphere.cli.viewer_metadata import viewer_metadata
from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.projection_text import parse_projection
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.reference import Exposure
from laws import fisheye


def options(*words: str | Path) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    composing.add_arguments(parser, composing.AUTO)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args([str(word) for word in words])


def test_nothing_asked_for_is_the_whole_sphere_as_the_frames_are(tmp_path: Path) -> None:
    wanted = composing.check_arguments(options("-o", tmp_path / "p.tif"), None)
    assert (wanted.target, wanted.dtype, wanted.exposure) == (None, None, Exposure("auto"))
    assert not (wanted.fill or wanted.resume or wanted.preview or wanted.layers)


@pytest.mark.parametrize(
    ("words", "width", "size"),
    [
        ([], 4096, (4096, 2048)),
        (["--size", "512"], 4096, (512, 256)),
        (["--size", "auto"], 4096, None),
        (["--to", "cube:64"], None, (192, 128)),
        (["--preview"], None, (composing.PREVIEW_PX, composing.PREVIEW_PX // 2)),
    ],
)
def test_sizes(words: list[str], width: int | None, size: tuple[int, int] | None, tmp_path: Path) -> None:
    target = composing.check_arguments(options("-o", tmp_path / "p.tif", *words), width).target
    assert (target.projection.size if target else None) == size


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("none", Exposure("none")),
        ("3", Exposure("frame", "3")),
        ("IMG 1.jpg", Exposure("frame", "IMG 1.jpg")),
        ("auto", Exposure("auto")),
    ],
)
def test_exposures(text: str, expected: Exposure, tmp_path: Path) -> None:
    assert composing.check_arguments(options("-o", tmp_path / "p.tif", "--exposure", text), 64).exposure == expected


@pytest.mark.parametrize(
    ("name", "frames", "held"),
    [
        ("p.jpg", np.float32, "uint8"),
        ("p.jpeg", np.uint16, "uint8"),
        ("p.png", np.float32, "uint16"),
        ("p.png", np.uint8, "uint8"),
        ("p.tif", np.uint16, "uint16"),
        ("p.TIF", np.float16, "float32"),
        ("p.exr", np.uint8, "float16"),
        ("p.exr", np.float32, "float32"),
    ],
)
def test_the_depth_that_a_format_holds(name: str, frames: type, held: str) -> None:
    assert composing.held(Path(name), np.dtype(frames)).name == held


def test_sizes_that_a_format_does_not_hold_are_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="65500"):
        composing.check_arguments(options("-o", tmp_path / "p.jpg", "--to", "cube:30000"), None)


@pytest.mark.parametrize(("text", "amount"), [("500MB", 500_000_000), ("2GB", 2_000_000_000)])
def test_amounts_of_memory(text: str, amount: int) -> None:
    assert console.bytes_of(text) == amount


@pytest.mark.parametrize("text", ["", "2", "2 GB", "-1GB", "2TB", "1.5GB"])
def test_what_is_no_amount(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="500MB"):
        console.bytes_of(text)


def test_missing_files_are_named(tmp_path: Path) -> None:
    def nothing() -> np.ndarray:
        raise AssertionError

    there, gone = tmp_path / "a.jpg", tmp_path / "b.jpg"
    there.write_bytes(b"x")
    frames = tuple(
        Frame(path.name, str(path), (64, 64), nothing, camera_from_world=np.eye(3)) for path in (there, gone)
    )
    mosaic = Mosaic((fisheye(64),), frames, ())
    with pytest.raises(InputError, match=r"b\.jpg.*m\.json needs it"):
        composing.check_frames(mosaic, Path("m.json"))
    composing.check_frames(mosaic, Path("m.json"), [there, there])
    with pytest.raises(InputError, match=r"b\.jpg: there is no such file; check"):
        composing.check_frames(mosaic, Path("m.json"), [there, gone])


@pytest.mark.parametrize(
    ("text", "whole"),
    [("equirectangular:512", (512, 256)), ("equirectangular:128:lon=0..90:lat=-45..45", (512, 256)), ("cube:64", None)],
)
def test_viewers_are_told_of_spheres_and_their_windows(text: str, whole: tuple[int, int] | None) -> None:
    told = viewer_metadata(parse_projection(text).projection)
    found = (told["GPano:FullPanoWidthPixels"], told["GPano:FullPanoHeightPixels"]) if told else None
    assert found == whole
