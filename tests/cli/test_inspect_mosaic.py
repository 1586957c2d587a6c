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
from fullsphere.cli.mosaic_page import contact_picture, page_of_mosaic
from fullsphere.cli.plots_mosaic import WHOLE, contact_sheet, view_of
from fullsphere.model.files import write_json
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.store import load_mosaic, mosaic_to_dict, save_mosaic
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
        "pairs of frames with things that both see",
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


def test_thinned_frames_leave_the_picture_free() -> None:
    mosaic = solved(Path("gone"))
    many = [dataclasses.replace(mosaic.frames[k % 4], id=f"{k}.png") for k in range(100)]
    few = contact_sheet(mosaic, WHOLE, None).figure.axes[0]
    assert [text.get_text() for text in few.texts] == [f"{k}.png" for k in range(4)]
    drawing = contact_sheet(dataclasses.replace(mosaic, frames=tuple(many), links=()), WHOLE, None)
    names = [text.get_text() for text in drawing.figure.axes[0].texts]
    assert len(names) == 17
    assert names[:2] == ["0.png", "6.png"]
    assert "One in 6 of the 100 frames" in drawing.caption


def test_a_narrow_mosaic_is_shown_large_and_a_wide_one_whole(tmp_path: Path) -> None:
    camera = dataclasses.replace(CAMERA, half_fov=np.deg2rad(10))
    frames = [
        dataclasses.replace(solved(tmp_path).frames[0], id=str(yaw), camera_from_world=orientation(yaw, 5))
        for yaw in (20, 30)
    ]
    mosaic = Mosaic((camera,), tuple(frames), ())
    view = view_of(mosaic)
    assert not view.whole
    assert view.longitudes[0] < 20 - 10 < 30 + 10 < view.longitudes[1]
    assert view.latitudes[0] < -5 < 15 < view.latitudes[1]
    assert view.longitudes[1] - view.longitudes[0] < 60
    behind = dataclasses.replace(frames[1], camera_from_world=orientation(175))
    assert view_of(dataclasses.replace(mosaic, frames=(frames[0], behind))) == WHOLE
    assert view_of(solved(tmp_path)) == WHOLE
    assert view_of(dataclasses.replace(mosaic, frames=())) == WHOLE


def test_frames_lie_in_the_sheet_where_their_outlines_say(tmp_path: Path) -> None:
    """A white frame among black ones is white around its own axis, and nowhere else."""
    mosaic = solved(tmp_path)
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((200, 200, 3), 255 * (k == 1), np.uint8))
    path = tmp_path / "mosaic.json"
    save_mosaic(path, mosaic)
    sheet, missing = contact_picture(load_mosaic(path), WHOLE)
    assert missing == []
    assert sheet is not None
    height, width = sheet.shape[:2]
    assert (width, height) == (1600, 800)

    def at(yaw: float, pitch: float) -> int:
        return int(sheet[round((90 - pitch) / 180 * height), round((yaw + 180) / 360 * width), 0])

    assert at(90, -10) > 240  # the frame that looks there
    assert at(0, 10) < 100
    assert at(-90, 10) < 60


def test_two_cameras_have_an_arrow_figure_each(tmp_path: Path) -> None:
    mosaic = solved(tmp_path)
    frames = [dataclasses.replace(frame, camera=k % 2, shot=str(k // 2)) for k, frame in enumerate(mosaic.frames)]
    mosaic = dataclasses.replace(mosaic, cameras=(CAMERA, CAMERA), frames=tuple(frames))
    mosaic = dataclasses.replace(mosaic, camera_from_rig=(np.eye(3), ROTATIONS[1] @ ROTATIONS[0].T))
    path = tmp_path / "mosaic.json"
    save_mosaic(path, mosaic)
    sections = page_of_mosaic("mosaic.json", load_mosaic(path)).sections
    names = [drawing.name for section in sections for drawing in section.drawings]
    assert names == ["contact-sheet", "links", "theta", "arrows-1", "arrows-2"]
    assert [section.heading for section in sections][-2:] == ["Camera 1", "Camera 2"]


def test_without_held_out_matches_the_page_says_whose_residuals_it_shows(tmp_path: Path) -> None:
    mosaic = solved(tmp_path)
    none = np.empty((0, 2))
    links = tuple(dataclasses.replace(link, held_i=none, held_j=none) for link in mosaic.links)
    mosaic = dataclasses.replace(mosaic, links=links, quality={"matches": 208, "residual_median_px": 0.5})
    path = tmp_path / "mosaic.json"
    save_mosaic(path, mosaic)
    page = page_of_mosaic("mosaic.json", load_mosaic(path))
    [theta] = [drawing for section in page.sections for drawing in section.drawings if drawing.name == "theta"]
    assert "none were held back" in theta.caption
    assert "Matches that no fit saw" not in [finding.name for finding in page.findings]


def test_outlines_reach_the_edges_of_the_sheet() -> None:
    axes = contact_sheet(solved(Path("gone")), WHOLE, None).figure.axes[0]
    behind = axes.lines[4]  # the frame that looks along 180 degrees; a light line lies below each coloured one
    x = np.asarray(behind.get_xdata(), float)
    assert {-180.0, 180.0} <= set(x[np.isfinite(x)].tolist())
    assert not (np.abs(np.diff(x)) > 180).any()  # no line right across
