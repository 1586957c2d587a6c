"""Every example runs from anywhere with nothing but the installed package, and leaves nothing where it was started."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))

SAYS = {
    "01_remap_fisheye": "sphere covered: 51.",
    "02_calibrate_from_points": "rms 0.2",
    "03_stitch_rotating_frames": "4 of 4 frames",
    "04_lens_curves": "bakstein-pajdla",
    "05_cylinder": "chi-square test passes",
    "06_half_cylinder": "chi-square test passes",
    "07_many_frames": "the same as without: True",
    "08_omnistereo": "left eye: 33.",
}


def run(example: Path, *arguments: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(example), *map(str, arguments)], cwd=folder, capture_output=True, text=True, timeout=300
    )


def test_every_example_is_known_here() -> None:
    assert [example.stem for example in EXAMPLES] == list(SAYS)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.stem)
def test_example_runs_without_arguments_and_leaves_nothing(example: Path, tmp_path: Path) -> None:
    done = run(example, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert SAYS[example.stem] in done.stdout
    assert not done.stderr
    assert not list(tmp_path.iterdir())


def test_example_writes_into_the_folder_it_is_given(tmp_path: Path) -> None:
    done = run(EXAMPLES[1], tmp_path / "kept", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["camera.json"]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.stem)
def test_example_is_short(example: Path) -> None:
    assert len(example.read_text().splitlines()) < 60
