"""The command `fullsphere`: finds the subcommand, runs it, and turns what goes wrong into one line and an exit code.

Nothing heavy is imported here: a subcommand's module is loaded when it is asked for, and imports NumPy and the rest
only when it runs, so that help and usage errors answer at once.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import Any, NoReturn

from fullsphere.cli import messages

COMMANDS = {
    "demo": "show everything on a built-in scene: calibrate, stitch, compare with the truth",
    "target": "print a calibration target at true scale",
    "calibrate": "find the camera of a lens from known 3D points in its pictures",
    "register": "find how the camera was turned for each frame of a panorama",
    "compose": "make the panorama of a mosaic.json that was registered",
    "stitch": "turn the frames of a rotating camera into a panorama of the whole sphere",
    "omnistereo": "turn the frames of a camera on a turning arm into the 360 x 360 mosaic and a stereo panorama",
    "remap": "resample pictures or video frames from any projection to any other",
    "inspect": "say what a camera, mosaic, target or picture file holds, or how two cameras differ",
}
"""Every subcommand, which is the module of that name in this package, and its one line of help."""

INTERNAL_FAULT, USAGE, INPUT, GEOMETRY, OUTPUT, RESOURCE, INTERRUPTED, TERMINATED = 1, 2, 3, 4, 5, 6, 130, 143

_EXIT_CODES = {
    "UsageError": USAGE,
    "InputError": INPUT,
    "CameraError": INPUT,
    "GeometryError": GEOMETRY,
    "OutputError": OUTPUT,
    "ResourceError": RESOURCE,
}

_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)

# One thread for the linear algebra and for OpenCV: sums are then added in one order whatever the machine, and our own
# pool does not compete with a second one.  The libraries read this while they are imported.
_LIBRARY_THREADS = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


class _Terminated(BaseException):
    """SIGTERM came; a BaseException, so that it unwinds through everything and cleans up as Ctrl-C does."""


class _Parser(argparse.ArgumentParser):
    """Raises UsageError instead of printing the usage and leaving."""

    def error(self, message: str) -> NoReturn:
        from fullsphere.model.errors import UsageError

        raise UsageError(f"{message}; see '{self.prog} --help'")


class _ShowVersion(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"fullsphere {version('fullsphere')}")  # noqa: T201
        parser.exit()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`, by default the process's own, and answer its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        with _termination_raised():
            code = _run(arguments)
    except SystemExit as leaving:  # argparse after --help
        code = leaving.code if isinstance(leaving.code, int) else INTERNAL_FAULT
    except BrokenPipeError:
        code = OUTPUT
    except BaseException as error:
        code = _report(error, debug="--debug" in arguments)
    return _stdout_flushed(code)


def _run(arguments: list[str]) -> int:
    for variable in _LIBRARY_THREADS:
        os.environ[variable] = "1"
    args = _parse(arguments)
    with _log_shown(debug=args.debug):
        return int(args.run(args))


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="fullsphere",
        allow_abbrev=False,
        description="Calibrates ultra-wide lenses and makes full-sphere panoramas.",
    )
    parser.add_argument(
        "--version", action=_ShowVersion, nargs=0, default=argparse.SUPPRESS, help="print the version and leave"
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="command")
    asked = next((word for word in arguments if not word.startswith("-")), None)
    for name, line in COMMANDS.items():
        command = commands.add_parser(name, help=line, description=f"{line[0].upper()}{line[1:]}.", allow_abbrev=False)
        if name == asked:
            module = importlib.import_module(f"fullsphere.cli.{name}")
            command.epilog = getattr(module, "EPILOG", None)
            command.formatter_class = argparse.RawDescriptionHelpFormatter  # keeps the lines of the examples
            module.add_arguments(command)
            _add_common_options(command)
            command.set_defaults(run=module.run)
    return parser.parse_args(arguments)


def _add_common_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("common options")
    group.add_argument("--overwrite", action="store_true", help="replace outputs that exist")
    group.add_argument("--strict", action="store_true", help="fail with exit code 3 where an input had to be left out")
    group.add_argument("--threads", type=_positive, metavar="N", help="work on N threads (default: one a core)")
    group.add_argument("--json", action="store_true", help="print the results as JSON, for programs")
    group.add_argument("--debug", action="store_true", help="show the library's log, and the traceback of an error")


def _positive(text: str) -> int:
    number = int(text) if text.isdecimal() else 0
    if not 1 <= number <= 4096:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 4096")
    return number


def _report(error: BaseException, debug: bool) -> int:
    """Say in one line what went wrong; answer the exit code."""
    if debug:
        import traceback

        traceback.print_exception(error)
    if isinstance(error, KeyboardInterrupt):
        messages.error("interrupted")
        return INTERRUPTED
    if isinstance(error, _Terminated):
        messages.error("terminated")
        return TERMINATED
    if isinstance(error, MemoryError):
        messages.error("out of memory; try a smaller size or fewer threads")
        return RESOURCE
    if isinstance(error, OSError) and error.errno in _NO_ROOM:
        messages.error(f"{error.filename or 'standard output'}: cannot be written ({error.strerror}); make room")
        return OUTPUT
    for kind in type(error).__mro__:  # by name: importing the classes would cost every --help their package
        if kind.__name__ in _EXIT_CODES and kind.__module__ == "fullsphere.model.errors":
            messages.error(str(error))
            return _EXIT_CODES[kind.__name__]
    advice = "" if debug else "; run again with --debug and report what it shows"
    messages.error(f"internal fault: {type(error).__name__}: {error}{advice}")
    return INTERNAL_FAULT


@contextlib.contextmanager
def _termination_raised() -> Iterator[None]:
    """Let SIGTERM raise in the main thread, so that temporary files are removed."""

    def terminate(_signal: int, _frame: FrameType | None) -> NoReturn:
        raise _Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def _log_shown(debug: bool) -> Iterator[None]:
    logger, handler = logging.getLogger("fullsphere"), messages.LogLines()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG if debug else logging.WARNING)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def _stdout_flushed(code: int) -> int:
    """The exit code, after what is still in the buffer of standard output has reached its reader, or has not."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except BrokenPipeError:  # in silence: whoever closed the pipe (head, a pager) has read enough
        pass
    except OSError as error:
        messages.error(f"standard output: cannot be written ({error.strerror})")
    with contextlib.suppress(OSError, ValueError):  # or Python complains of the rest of the buffer when it ends
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    return code or OUTPUT


if __name__ == "__main__":
    sys.exit(main())
