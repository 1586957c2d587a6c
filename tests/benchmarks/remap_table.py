"""The one table of the remapping benchmarks: rows that are judged against a limit, and rows for information."""

import os
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

HEADER = ("measure", "ours", "peer", "ratio", "limit", "holds")


class Row(NamedTuple):
    """One line of the table, as text; `holds` is "yes", "NO", or "" where nothing is judged."""

    measure: str
    ours: str = ""
    peer: str = ""
    ratio: str = ""
    limit: str = ""
    holds: str = ""


def seconds_row(measure: str, ours: float, peer: float, limit: float | None) -> Row:
    """Two times, and their ratio, which is to be at most `limit`."""
    ratio = ours / peer
    text, holds = ("", "") if limit is None else (f"<= {limit:g}", _verdict(ratio <= limit))
    return Row(measure, _seconds(ours), _seconds(peer), f"{ratio:.3f}", text, holds)


def decibel_row(measure: str, ours: float, peer: float, least: float) -> Row:
    """Two PSNR, and their difference, which is to be at least `least` in hundredths of a decibel."""
    gain = round(ours - peer, 2) + 0.0  # no -0.0
    return Row(measure, f"{ours:.2f} dB", f"{peer:.2f} dB", f"{gain:+.2f} dB", f">= {least:g}", _verdict(gain >= least))


def limit_row(measure: str, ours: float, limit: float, unit: str) -> Row:
    """A value that is to be at most `limit`."""
    return Row(measure, f"{ours:.3g} {unit}", "", "", f"<= {limit:g}", _verdict(ours <= limit))


def absent_row(measure: str, what: str) -> Row:
    """A comparison that cannot be made here; `what` is not installed, or not offered."""
    return Row(measure, peer=f"{what}: missing")


def print_table(rows: Sequence[Row]) -> None:
    """Columns as wide as they need be; lines that compare nothing come below."""
    lines = [HEADER, *(row for row in rows if row.ours or row.peer)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEADER))]
    for number, line in enumerate(lines):
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
        if number == 0:
            print("  ".join("-" * width for width in widths))
    print()
    for row in rows:
        if not (row.ours or row.peer):
            print(row.measure)


def alternating(runs: int, jobs: Mapping[str, Callable[[], float | None]]) -> dict[str, float]:
    """Medians of the seconds of each job, which take turns; a first turn of all is not counted.

    A job that answers seconds has measured itself; for others the call is timed.  What is said on stderr beside the
    medians, the range and the processors' time, tells whether something else kept the machine busy.
    """
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    busy: dict[str, list[float]] = {name: [] for name in jobs}
    note(f"speed: {runs} runs of {', '.join(jobs)}")
    for run in range(runs + 1):
        for name, job in jobs.items():
            started, busy_before = time.perf_counter(), sum(os.times()[:4])
            measured = job()
            if run:
                seconds[name].append(time.perf_counter() - started if measured is None else measured)
                busy[name].append(sum(os.times()[:4]) - busy_before)
    for name, values in seconds.items():
        median, cpu = statistics.median(values), statistics.median(busy[name])
        note(f"  {name}: median {median:.4f} s, {min(values):.4f} to {max(values):.4f}; processors {cpu:.2f} s a call")
    return {name: statistics.median(values) for name, values in seconds.items()}


def note(text: str) -> None:
    """Say on stderr what goes on."""
    print(text, file=sys.stderr, flush=True)


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if value >= 1 else f"{1000 * value:.1f} ms"


def _verdict(holds: bool) -> str:
    return "yes" if holds else "NO"
