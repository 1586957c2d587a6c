"""`fullsphere inspect mosaic.json`: in words, for programs, and as a page with figures."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turning import matched, orientation

from fullsphere.cli import main as frame_of_commands
from fullsphere.cli.main import main
from fullsphere.model.files import write_json
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.store import mosaic_to_dict, save_mosaic
from laws import fisheye

Inspect = Callable[..., tuple[int, str, str]]
CAMERA = fisheye(200)
ROTATIONS = np.array([orientation(yaw, 10 * (-1) ** k) for k, yaw in enumerate((0, 90, 180, 270))])


@pytest.fixture
def inspect(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Inspect:
    """Runs the command; answers its exit code, standard output and standard error."""
    monkeypatch.setattr(frame_of_commands, "_LIBRARY_THREADS", ())

    def run(*arguments: object) -> tuple[int, str, str]:
        code = main(["inspect", *map(str, arguments)])
        return code, *capsys.readouterr()

    return run


def solved(folder: Path, pictures: bool = True) -> Mosaic:
    """Four frames with links, held-out matches and a sentence to be minded; one was left out."""
    frames = []
    for k, turn in enumerate(ROTATIONS):
        path = folder / f"{k}.png"
        if pictures:
            cv2.imwrite(str(path), np.full((200, 200, 3), 60 * (k + 1), np.uint8))
        frames.append(
            Frame(
                f"{k}.png",
                str(path),
                CAMERA.size,
                lambda: np.zeros(0),
                camera_from_world=turn,
                sigma_deg=0.001 * (k + 1),
            )
        )
    frames.append(Frame("odd.png", str(folder / "odd.png"), CAMERA.size, lambda: np.zeros(0)).left_out("shows a cat"))
    links = [
        dataclasses.replace(
            link,
            pixels_i=link.pixels_i[8:],
            pixels_j=link.pixels_j[8:],
            held_i=link.pixels_i[:8],
            held_j=link.pixels_j[:8],
            verdict="parallax" if link.i == 0 else "rotation",
        )
        for link in matched(CAMERA, ROTATIONS, count=60, noise_px=0.3)
    ]
    quality = {"matches": 208, "residual_median_px": 0.5, "held_out_matches": 32, "held_out_share": 1.0}
    return Mosaic(
        (CAMERA,),
        tuple(frames),
        tuple(links),
        level="vertical-lines",
        self_calibrated=True,
        quality={**quality, "held_out_median_px": 0.45, "level_sigma_deg": 0.1},
        diagnosis=("something moved: look at 1.png",),
    )


def bare(folder: Path) -> Mosaic:
    """As a person may write it: a frame, one left out, no links."""
    turned = Rotation.from_euler("YXZ", [30, -10, 5], degrees=True).inv().as_matrix()
    frames = (
        Frame(
            "a.jpg", str(folder / "a.jpg"), CAMERA.size, lambda: np.zeros(0), camera_from_world=turned, sigma_deg=0.01
        ),
        Frame("b\x1b[2J.jpg", str(folder / "b.jpg"), CAMERA.size, lambda: np.zeros(0)).left_out("no overlap"),
    )
    return Mosaic((CAMERA,), frames, (), level="camera-x-axes", quality={"residual_rms_px": 0.47})


def test_a_mosaic_is_told_in_words(inspect: Inspect, tmp_path: Path) -> None:
    path = tmp_path / "mosaic.json"
    save_mosaic(path, solved(tmp_path))
    code, out, err = inspect(path)
    assert (code, err) == (0, "")
    for said in (
        "4 of 5 frames have their place on the sphere",
        "lens found from the frames themselves",
        "pairs of frames see the same things",
        "of them with parallax",
        "208 matches agree to 0.50 px",
        "32 matches that no fit saw agree to 0.45 px (100 % of all such)",
        "level by: vertical-lines (to 0.1 degrees)",
        "note: something moved: look at 1.png",
        "odd.png              left out: shows a cat",
    ):
        assert said in out
    row = next(line for line in out.splitlines() if line.startswith("1.png")).split()
    assert row[1:5] == ["90.00", "-10.00", "0.00", "0.0020"]
    value = json.loads(inspect(path, "--json")[1])
    assert value["frames"][1]["links"] == int(row[7])
    assert value["frames"][1]["matches"] == int(row[8])
    assert value["frames"][1]["held_median_px"] == pytest.approx(float(row[10]), abs=0.006)
    assert value["diagnosis"] == ["something moved: look at 1.png"]


def test_a_bare_mosaic_is_told_too(inspect: Inspect, tmp_path: Path) -> None:
    path = tmp_path / "mosaic.json"
    save_mosaic(path, bare(tmp_path))
    code, out, _ = inspect(path)
    assert code == 0
    assert "1 of 2 frames have their place on the sphere" in out
    lines = out.splitlines()
    assert lines[-2].split()[:7] == ["a.jpg", "30.00", "-10.00", "5.00", "0.0100", "+0.00", "EV"]
    assert lines[-1].split(maxsplit=1) == ["b?[2J.jpg", "left out: no overlap"]  # nothing that steers the terminal
    value = json.loads(inspect(path, "--json")[1])
    assert [f["status"] for f in value["frames"]] == ["registered", "left-out"]
    assert value["quality"] == {"residual_rms_px": 0.47}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"frames": 3}, "frames is not a list"),
        ({"frames": [{"id": "a"}]}, r"frames\[0\]"),
        ({"frames": ["a"]}, r"frames\[0\]: is not an object"),
        ({"cameras": [{}]}, r"cameras\[0\]: format is None"),
        ({"links": None}, "links is not a list"),
    ],
)
def test_a_mosaic_that_was_spoilt_is_refused_by_the_key(
    inspect: Inspect, tmp_path: Path, change: dict[str, Any], named: str
) -> None:
    path = tmp_path / "mosaic.json"
    write_json(path, {**mosaic_to_dict(bare(tmp_path), tmp_path), **change}, False)
    code, _, err = inspect(path)
    assert code == 3
    assert err.count("\n") == 1
    assert re.search(named, err)


def test_the_page_shows_the_frames_and_what_holds_them(inspect: Inspect, tmp_path: Path) -> None:
    path, page = tmp_path / "mosaic.json", tmp_path / "page.html"
    save_mosaic(path, solved(tmp_path))
    assert inspect(path, "--report", page)[0] == 0
    text = page.read_text()
    for said in ("Where the frames look", "What holds the frames together", "something moved", "shows a cat", "4 of 5"):
        assert said in text
    assert "Not opened" not in text
    names = {file.name for file in (tmp_path / "page-figures").iterdir()}
    assert {f"{stem}.png" for stem in ("contact-sheet", "links", "theta", "arrows-1")} <= names
    sheet = cv2.imread(str(tmp_path / "page-figures" / "contact-sheet.png"))
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 20
    again = tmp_path / "again.html"
    assert inspect(path, "--report", again)[0] == 0
    assert again.read_bytes() == page.read_bytes()


def test_pictures_that_are_gone_are_named_and_shown_by_their_outlines(inspect: Inspect, tmp_path: Path) -> None:
    path, page = tmp_path / "mosaic.json", tmp_path / "page.html"
    save_mosaic(path, solved(tmp_path, pictures=False))
    assert inspect(path, "--report", page)[0] == 0
    assert "Not opened, and so shown by outlines alone" in page.read_text()
    assert "2.png" in page.read_text()


@pytest.mark.parametrize("registered", [0, 1])
def test_a_page_of_almost_nothing(inspect: Inspect, tmp_path: Path, registered: int) -> None:
    mosaic = bare(tmp_path)
    if not registered:
        mosaic = dataclasses.replace(mosaic, frames=mosaic.frames[1:])
    path, page = tmp_path / "mosaic.json", tmp_path / "page.html"
    save_mosaic(path, mosaic)
    code, _, err = inspect(path, "--report", page)
    assert (code, err) == (0, "")
    assert "no overlap" in page.read_text()


def test_the_page_of_a_hundred_frames_is_no_burden(inspect: Inspect, tmp_path: Path) -> None:
    mosaic = solved(tmp_path, pictures=False)
    many = [
        dataclasses.replace(mosaic.frames[k % 4], id=f"{k}.png", image=str(tmp_path / f"{k}.png")) for k in range(100)
    ]
    path, page = tmp_path / "mosaic.json", tmp_path / "page.html"
    save_mosaic(path, dataclasses.replace(mosaic, frames=tuple(many)))
    assert inspect(path, "--report", page)[0] == 0
    assert page.stat().st_size < 3_000_000
