"""`fullsphere register` asked for what cannot be: an exit code, one clear line, and no file half written."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rooms import Outcome, Set

Run = Callable[..., Outcome]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bogus"], "unrecognized arguments: --bogus"),
        (["--order", "circle"], "'any', 'ring', 'sweep'"),
        (["--lens", "wide"], "there is no lens 'wide'"),
        (["--refine"], "--refine adjusts a calibrated camera"),
        (["--target", "chessboard:6x8:30mm"], "--calibrate"),
        (["--level", "sideways"], "sideways"),
        (["--threads", "1000000"], "from 1 to 4096"),
        (["--threads", "-1"], "--threads"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_wrong_option_is_a_usage_error(
    room_set: Set, fullsphere: Run, tmp_path: Path, arguments: list[str], words: str
) -> None:
    run = fullsphere("register", *room_set.frames, "-o", tmp_path / "m.json", *arguments)
    assert run.code == 2
    assert words in run.error_line
    assert "reading frames" not in run.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--camera", "--mask", "--prior"])
def test_a_file_that_is_missing_is_named(room_set: Set, fullsphere: Run, tmp_path: Path, option: str) -> None:
    run = fullsphere("register", *room_set.frames, "-o", tmp_path / "m.json", option, tmp_path / "nowhere")
    assert run.code == 3
    assert f"{tmp_path / 'nowhere'}: there is no such" in run.error_line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["nowhere.jpg", "nowhere.pto"])
def test_a_missing_frame_or_project_is_named(room_set: Set, fullsphere: Run, tmp_path: Path, name: str) -> None:
    others = room_set.frames if name.endswith(".jpg") else ()
    run = fullsphere("register", *others, tmp_path / name, "-o", tmp_path / "m.json")
    assert run.code == 3
    assert f"{tmp_path / name}: there is no such file" in run.error_line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["register", "stitch"])
def test_a_project_is_for_register_alone(room_set: Set, fullsphere: Run, tmp_path: Path, command: str) -> None:
    (tmp_path / "set.pto").write_text("p f2\n")
    run = fullsphere(command, room_set.frames[0], tmp_path / "set.pto", "-o", tmp_path / "m.tif")
    assert run.code == 2
    assert f"{tmp_path / 'set.pto'}: a Hugin project is for 'fullsphere register'" in run.error_line


def test_what_is_no_project_is_refused(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    path = tmp_path / "photo.pto"
    path.write_bytes(room_set.frames[0].read_bytes())
    run = fullsphere("register", path, "-o", tmp_path / "m.json")
    assert run.code == 3
    assert "no Hugin project" in run.error_line


def test_an_output_that_exists_is_kept(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    output = tmp_path / "m.json"
    output.write_text("mine")
    run = fullsphere("register", *room_set.frames, "-o", output)
    assert run.code == 5
    assert "--overwrite" in run.error_line
    assert "reading frames" not in run.err
    assert output.read_text() == "mine"


def test_a_frame_is_never_written_over(room_set: Set, fullsphere: Run) -> None:
    before = room_set.frames[0].read_bytes()
    assert fullsphere("register", *room_set.frames, "-o", room_set.frames[0], "--overwrite").code == 5
    assert room_set.frames[0].read_bytes() == before


@pytest.mark.parametrize("option", ["-o", "--save-camera"])
def test_a_folder_that_does_not_exist_is_told_before_the_work(
    room_set: Set, fullsphere: Run, tmp_path: Path, option: str
) -> None:
    outputs = {"-o": tmp_path / "m.json", option: tmp_path / "no" / "file.json"}
    run = fullsphere("register", *room_set.frames, *[word for pair in outputs.items() for word in pair])
    assert run.code == 5
    assert f"the folder {tmp_path / 'no'} does not exist" in run.error_line
    assert "reading frames" not in run.err


def test_a_folder_is_no_output(room_set: Set, fullsphere: Run, tmp_path: Path) -> None:
    run = fullsphere("register", *room_set.frames, "-o", tmp_path, "--overwrite")
    assert run.code == 5
    assert "is a folder" in run.error_line


@pytest.mark.parametrize("stage", ["reading frames", "matching frames"])
@pytest.mark.parametrize(("kind", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_leaves_what_was_there(
    room_set: Set, tmp_path: Path, kind: signal.Signals, code: int, stage: str
) -> None:
    # Ctrl-C is switched back on: a runner in the background may have left it ignored.
    program = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        "from fullsphere.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    output = tmp_path / "m.json"
    output.write_text("the last one")
    command = [sys.executable, "-c", program, "register", *map(str, room_set.frames), "-o", str(output), "--overwrite"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            said.append(line)
            if stage in line:
                break
        process.send_signal(kind)
        said.append(process.stderr.read())
        assert process.wait(timeout=120) == code, said
    assert "fullsphere: error: " in said[-1]
    assert "Traceback" not in said[-1]
    assert [path.name for path in tmp_path.iterdir()] == ["m.json"]
    assert output.read_text() == "the last one"
