"""What the command says on standard error: one line for each thing, whatever a file's name contains."""

from __future__ import annotations

import logging
import sys


def error(text: str) -> None:
    """Say why the command failed."""
    _say("error", text)


def warn(text: str) -> None:
    """Say what was left out or is doubtful, in a command that goes on."""
    _say("warning", text)


def note(text: str) -> None:
    """Say how far the work is."""
    _write(f"{_one_line(text)}\n")


class LogLines(logging.Handler):
    """Shows what the library logs: warnings as warnings, the rest (with --debug) as notes."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            text = record.getMessage()
        except Exception:  # a wrong format string must not end a run
            self.handleError(record)
            return
        if record.levelno >= logging.WARNING:
            warn(text)
        else:
            note(f"{record.name}: {text}")


def _say(kind: str, text: str) -> None:
    _write(f"fullsphere: {kind}: {_one_line(text)}\n")


def _one_line(text: str) -> str:
    """The text with newlines, terminal escapes and undecodable bytes spelled out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text.strip())


def _write(line: str) -> None:
    if sys.stderr is None:  # closed by whoever started us
        return
    encoding = sys.stderr.encoding or "utf-8"
    sys.stderr.write(line.encode(encoding, "backslashreplace").decode(encoding))
    sys.stderr.flush()
