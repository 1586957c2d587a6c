"""The command line's frame: help without the libraries, one line and an exit code for every error."""

import os
import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fullsphere.cli import main as frame
from fullsphere.cli.main import main
from fullsphere.cli.progress import show_progress
from fullsphere.model.errors import (
    CameraError,
    FullsphereError,
    GeometryError,
    InputError,
    OutputError,
    ResourceError,
    UsageError,
)

COMMAND = [sys.executable, "-c", "import sys; from fullsphere.cli.main import main; sys.exit(main())"]


def run(*arguments: str, **options: object) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(  # type: ignore[call-overload,no-any-return]
        [*COMMAND, *arguments], **{"capture_output": True, "text": True, "check": False, "timeout": 60, **options}
    )


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., int]], None]:
    """Puts a function in the place of what `fullsphere probe` does."""
    monkeypatch.setattr(frame, "_LIBRARY_THREADS", ())  # the environment of the tests stays as it is

    def install(work: Callable[..., int]) -> None:
        module = types.ModuleType("fullsphere.cli.probe")
        module.__dict__.update(add_arguments=lambda parser: parser.add_argument("--size", type=int), run=work)
        monkeypatch.setitem(sys.modules, "fullsphere.cli.probe", module)
        monkeypatch.setitem(frame.COMMANDS, "probe", "try something")

    return install


def failing(error: BaseException) -> Callable[..., int]:
    def work(_args: object) -> int:
        raise error

    return work


def test_help_of_the_whole_needs_none_of_the_libraries() -> None:
    code = (
        "import sys; from fullsphere.cli.main import main; assert main(['--help']) == 0;"
        "heavy = {'numpy', 'scipy', 'cv2', 'numba', 'OpenImageIO', 'matplotlib', 'rich', 'jinja2'} & set(sys.modules);"
        "sys.exit(', '.join(heavy) or 0)"
    )
    help_ = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (help_.returncode, help_.stderr) == (0, "")
    assert all(name in help_.stdout for name in frame.COMMANDS)


@pytest.mark.parametrize("name", frame.COMMANDS)
def test_help_of_a_command_needs_none_of_the_libraries_either(name: str) -> None:
    code = (
        f"import sys; from fullsphere.cli.main import main;main([{name!r}, '--help']); sys.exit('numpy' in sys.modules)"
    )
    help_ = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (help_.returncode, help_.stderr) == (0, "")
    for option in ("--json", "--debug", "--threads", "--overwrite", "--strict"):
        assert option in help_.stdout


def test_the_version_is_the_installed_one(capsys: pytest.CaptureFixture[str]) -> None:
    from importlib.metadata import version

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"fullsphere {version('fullsphere')}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["bogus"],
        ["probe", "--bogus"],
        ["probe", "--siz", "7"],  # no abbreviations: they would change meaning with the next option
        ["probe", "--size", "x"],
        ["probe", "--threads", "0"],
        ["probe", "--threads", "-3"],
        ["probe", "--threads", "9999999999"],
    ],
)
def test_wrong_usage_is_one_line_that_leads_to_the_help(
    command: Callable[..., None], capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    command(lambda _args: 0)
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("fullsphere: error: ")
    assert output.err.count("\n") == 1
    assert "--help" in output.err


def test_options_reach_the_command(command: Callable[..., None]) -> None:
    seen: list[object] = []

    def work(args: object) -> int:
        seen.append({key: value for key, value in vars(args).items() if key not in ("run", "command")})
        return 3

    command(work)
    assert main(["probe", "--size", "7", "--threads", "2", "--json", "--strict"]) == 3
    assert main(["probe"]) == 3
    assert seen == [
        {"size": 7, "threads": 2, "json": True, "debug": False, "overwrite": False, "strict": True},
        {"size": None, "threads": None, "json": False, "debug": False, "overwrite": False, "strict": False},
    ]


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UsageError("x"), 2),
        (InputError("x"), 3),
        (CameraError("x"), 3),
        (GeometryError("x"), 4),
        (OutputError("x"), 5),
        (OSError(28, "No space left on device"), 5),
        (ResourceError("x"), 6),
        (MemoryError(), 6),
        (KeyboardInterrupt(), 130),
        (FullsphereError("x"), 1),
        (RuntimeError("x"), 1),
        (AssertionError(), 1),
    ],
)
def test_every_error_has_its_exit_code_and_one_line(
    command: Callable[..., None], capsys: pytest.CaptureFixture[str], error: BaseException, code: int
) -> None:
    command(failing(error))
    assert main(["probe"]) == code
    said = capsys.readouterr().err
    assert said.startswith("fullsphere: error: ")
    assert said.count("\n") == 1
    assert ("--debug" in said) == (code == 1)
    assert main(["probe", "--debug"]) == code
    assert "Traceback" in capsys.readouterr().err


def test_a_subclass_of_an_error_has_its_exit_code(command: Callable[..., None]) -> None:
    class SpecialError(GeometryError):
        pass

    command(failing(SpecialError("x")))
    assert main(["probe"]) == 4


def test_names_from_outside_do_not_break_the_line(
    command: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    command(failing(InputError("a\nb\x1b[31m\udcff.jpg: é is damaged")))
    assert main(["probe"]) == 3
    assert capsys.readouterr().err == "fullsphere: error: a\\nb\\x1b[31m\\udcff.jpg: é is damaged\n"


def test_warnings_of_the_library_are_lines_on_stderr(
    command: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    import logging

    def work(_args: object) -> int:
        logging.getLogger("fullsphere.model").warning("frame %s is dark", "7")
        logging.getLogger("fullsphere.model").debug("detail")
        return 0

    command(work)
    assert main(["probe"]) == 0
    assert capsys.readouterr().err == "fullsphere: warning: frame 7 is dark\n"
    assert main(["probe", "--debug"]) == 0
    assert "detail" in capsys.readouterr().err
    assert logging.getLogger("fullsphere").handlers == []


SLOW_WORK = """
import signal, sys, time, types
signal.signal(signal.SIGINT, signal.default_int_handler)  # a runner in the background may have left it ignored
from pathlib import Path
from fullsphere.cli import main as frame
from fullsphere.model.files import replacing
def run(args):
    with replacing(Path(sys.argv[1]) / "out", True):
        print("ready", flush=True)
        time.sleep(30)
sys.modules["fullsphere.cli.probe"] = types.SimpleNamespace(add_arguments=lambda parser: None, run=run)
frame.COMMANDS["probe"] = "wait"
sys.exit(frame.main(["probe"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_work_and_removes_what_was_begun(tmp_path: Path, number: signal.Signals, code: int) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", SLOW_WORK, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    assert list(tmp_path.iterdir()) != []
    child.send_signal(number)
    _, said = child.communicate(timeout=20)
    assert child.returncode == code
    assert said.startswith("fullsphere: error: ")
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_signal_handler_of_the_caller_is_put_back(command: Callable[..., None]) -> None:
    before = signal.getsignal(signal.SIGTERM)
    command(lambda _args: 0)
    assert main(["probe"]) == 0
    assert signal.getsignal(signal.SIGTERM) is before


PRINTING = """
import sys, types
from fullsphere.cli import main as frame
def run(args):
    for _ in range(100000):
        print("a line of results")
    return 0
sys.modules["fullsphere.cli.probe"] = types.SimpleNamespace(add_arguments=lambda parser: None, run=run)
frame.COMMANDS["probe"] = "print"
sys.exit(frame.main(["probe"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX pipes")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_away_is_no_fault(unbuffered: str) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", PRINTING],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
    )
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.readline()
    child.stdout.close()
    assert child.stderr.read() == ""
    child.stderr.close()
    assert child.wait(timeout=20) == 5


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_results_that_find_no_room_are_an_error(unbuffered: str) -> None:
    with Path("/dev/full").open("w") as full:
        child = subprocess.run(
            [sys.executable, "-c", PRINTING],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
    assert child.returncode == 5
    assert child.stderr.startswith("fullsphere: error: standard output: cannot be written")
    assert child.stderr.count("\n") == 1


def test_a_closed_standard_output_is_no_fault() -> None:
    assert (
        run("--version", stdout=None, stderr=None, capture_output=False, preexec_fn=lambda: os.close(1)).returncode == 0
    )


def test_the_libraries_are_told_to_use_one_thread(
    monkeypatch: pytest.MonkeyPatch, command: Callable[..., None]
) -> None:
    monkeypatch.undo()
    code = (
        "import os; from fullsphere.cli.main import main; main(['bogus']);"
        "print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert child.stdout == "1 1\n"


class TestProgress:
    def test_it_hands_the_items_on(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert list(show_progress()(iter("abc"), title="reading frames", total=3)) == ["a", "b", "c"]
        said = capsys.readouterr().err.splitlines()
        assert [line.split(":")[0] for line in said] == ["reading frames ...", "reading frames"]

    def test_quiet_says_nothing(self, capsys: pytest.CaptureFixture[str]) -> None:
        items = [1, 2]
        assert show_progress(quiet=True)(items) is items
        assert capsys.readouterr().err == ""

    def test_long_work_says_how_far_it_is(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        seconds = iter(range(0, 1000, 6))
        monkeypatch.setattr(time, "monotonic", lambda: float(next(seconds)))
        assert list(show_progress()([1, 2, 3], title="turning")) == [1, 2, 3]
        assert "turning: 2 of 3" in capsys.readouterr().err

    def test_an_error_of_the_work_comes_through(self) -> None:
        def broken() -> Iterator[int]:
            yield 1
            raise ValueError("inside")

        with pytest.raises(ValueError, match="inside"):
            list(show_progress()(broken(), title="x"))

    def test_on_a_terminal_a_bar_is_drawn_even_for_work_inside_of_work(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        progress = show_progress()
        pairs = [(a, b) for a in progress([1, 2], title="outer") for b in progress([3], title="inner [bold]")]
        assert pairs == [(1, 3), (2, 3)]
        assert "outer" in capsys.readouterr().err
