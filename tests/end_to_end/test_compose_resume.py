"""A run that is killed leaves no half file, and the next one goes on from what was finished, to the same bytes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from projects import project_in
from rooms import Outcome

Run = Callable[..., Outcome]

TALL = ("--to", "perspective:200x1300:hfov=20")

KILLED_AFTER = """
import os, signal, sys
from fullsphere.cli.main import main
from fullsphere.mosaic.spool import Spool

keep, left = Spool._keep, int(sys.argv[1])

def keep_and_die(self, band):
    global left
    keep(self, band)
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)

Spool._keep = keep_and_die
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return project_in(tmp_path_factory.mktemp("project"), 3, exposures_ev=(0.0, 0.4, -0.3))


def killed(bands: int, *arguments: str | Path) -> None:
    run = subprocess.run([sys.executable, "-c", KILLED_AFTER, str(bands), *map(str, arguments)], capture_output=True)
    assert run.returncode == -signal.SIGKILL, run.stderr.decode()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("p.tif", ["--size", "1100"]),
        pytest.param("p.jpg", ["--to", "cube:500", "--nadir", "fill"], marks=pytest.mark.slow),
        pytest.param("p.exr", ["--to", "littleplanet:1100"], marks=pytest.mark.slow),
    ],
)
def test_a_killed_run_goes_on_to_the_same_bytes(
    name: str, options: list[str], project: Path, fullsphere: Run, tmp_path: Path
) -> None:
    whole = tmp_path / "whole" / name
    whole.parent.mkdir()
    assert fullsphere("compose", project, "-o", whole, *options).code == 0
    path = tmp_path / name
    killed(1, "compose", project, "-o", path, "--resume", *options)
    assert not path.exists()
    assert len(list(tmp_path.glob(".fullsphere-*.partial"))) == 1  # nobody was left to remove it
    run = fullsphere("compose", project, "-o", path, "--resume", *options)
    assert run.code == 0, run.err
    assert "256 of" in run.err
    assert path.read_bytes() == whole.read_bytes()
    assert {entry.name for entry in tmp_path.iterdir()} == {name, "whole"}


def test_bands_of_something_else_or_damaged_ones_are_made_anew(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    path, spool = tmp_path / "p.tif", tmp_path / "p.tif.unfinished"
    killed(2, "compose", project, "-o", path, "--resume", *TALL)
    bands = sorted(spool.glob("band-*"))
    assert len(bands) == 2
    content = bytearray(bands[1].read_bytes())
    content[5000] ^= 1
    bands[1].write_bytes(content)
    run = fullsphere("compose", project, "-o", path, "--resume", *TALL)
    assert (run.code, "256 of 1300 rows" in run.err) == (0, True)
    for k, changed in enumerate(([*TALL, "--blend", "feather"], ["--to", "perspective:200x1300:hfov=22"])):
        other = tmp_path / f"q{k}.tif"
        killed(1, "compose", project, "-o", other, "--resume", *TALL)
        run = fullsphere("compose", project, "-o", other, "--resume", *changed)
        assert (run.code, "finished before" in run.err) == (0, False), run.err


def test_a_project_that_was_changed_is_made_anew(fullsphere: Run, tmp_path: Path) -> None:
    own, path = project_in(tmp_path / "own", 2), tmp_path / "p.tif"
    killed(1, "compose", own, "-o", path, "--resume", *TALL)
    value = json.loads(own.read_text())
    value["frames"][1]["exposure_ev"] = 0.5
    own.write_text(json.dumps(value))
    run = fullsphere("compose", own, "-o", path, "--resume", *TALL)
    assert (run.code, "finished before" in run.err) == (0, False), run.err


def test_a_folder_of_other_things_is_left_alone(project: Path, fullsphere: Run, tmp_path: Path) -> None:
    (tmp_path / "p.tif.unfinished").mkdir()
    (tmp_path / "p.tif.unfinished" / "letter.txt").write_text("mine")
    run = fullsphere("compose", project, "-o", tmp_path / "p.tif", "--resume", "--size", 256)
    assert (run.code, "no folder of finished bands" in run.error_line) == (5, True)
    assert (tmp_path / "p.tif.unfinished" / "letter.txt").read_text() == "mine"
