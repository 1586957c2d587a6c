"""How much memory and disk there is, for limits that are stated before the work instead of met in the middle of it."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from fullsphere.model.errors import ResourceError

_MEMORY_INFO = Path("/proc/meminfo")
_GROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")  # what a container may use


def available_memory() -> int | None:
    """Bytes of memory that this process can still hope for; None where the system does not tell."""
    amounts = []
    with contextlib.suppress(OSError, ValueError, StopIteration):
        line = next(x for x in _MEMORY_INFO.read_text().splitlines() if x.startswith("MemAvailable:"))
        amounts.append(int(line.split()[1]) * 1024)
    with contextlib.suppress(OSError, ValueError):  # the file says "max" where there is no limit
        amounts.append(int(_GROUP_LIMIT.read_text()))
    if not amounts and hasattr(os, "sysconf"):
        with contextlib.suppress(OSError, ValueError):
            amounts.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return min(amounts, default=None)


def require_memory(needed: int, what: str, advice: str) -> None:
    """Raise ResourceError if `needed` bytes, for `what`, are more than there are."""
    available = available_memory()
    if available is not None and needed > available:
        raise ResourceError(
            f"{what} needs {_in_words(needed)} of memory and {_in_words(available)} are available; {advice}"
        )


def require_disk(needed: int, folder: Path, what: str, advice: str) -> None:
    """Raise ResourceError if `needed` bytes, for `what`, are more than `folder` has room for."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError:
        return  # the folder itself is the problem, and whoever opens a file in it says so
    if needed > free:
        raise ResourceError(f"{what} needs about {_in_words(needed)} and {_in_words(free)} are free; {advice}")


def _in_words(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e8 else f"{count / 1e6:.1f} MB"
