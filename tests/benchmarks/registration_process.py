"""Programs run as processes of their own: how long they take, and how much memory."""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Spent(NamedTuple):
    """Of one process: seconds on the clock, and the most memory that was resident, bytes."""

    seconds: float
    peak_bytes: int


def fullsphere(*arguments: str) -> list[str]:
    """The program under test with these arguments."""
    program = [sys.executable, "-c", "import sys; from fullsphere.cli.main import main; sys.exit(main(sys.argv[1:]))"]
    return [*program, *arguments]


def register_command(files: Sequence[Path], output: Path, *options: str) -> list[str]:
    """`fullsphere register` for these frames."""
    return fullsphere("register", *map(str, files), "-o", str(output), "--overwrite", *options)


def run(command: Sequence[str], folder: Path) -> Spent:
    """Run a program to its end in a folder.

    Raises
    ------
    SystemExit
        If it fails: what it said last is the message.
    """
    with (folder / "said.log").open("w+") as said:
        started = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            last = said.read()[-600:]
            raise SystemExit(f"{Path(command[0]).name} ended with {process.returncode}: {last}")
    return Spent(seconds, usage.ru_maxrss * 1024)
