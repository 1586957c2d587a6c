"""Finished bands of a panorama kept in a folder, so that a run that was killed goes on where it was.

Each band is a file of its own with a checksum, and the folder says by a key what it is of: the mosaic, the options and
the program's version.  What does not match is thrown away and made anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fullsphere.model.errors import OutputError, ResourceError
from fullsphere.model.files import output_errors
from fullsphere.mosaic.compose import Band

FORMAT = "fullsphere-bands/1"

_MANIFEST = "manifest.json"
_BAND = "band-{:07d}"
_OWN = re.compile(r"band-[0-9]{7}(\.new)?|manifest\.json(\.new)?", re.ASCII)
_TEMPORARY = re.compile(r"\.fullsphere-[0-9a-f]{16}\.partial", re.ASCII)
_DIGEST_BYTES = 32


def key_of(*facts: Any) -> str:
    """A short text that differs wherever any of the facts, which JSON holds, does."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=_listed).encode()).hexdigest()


class Spool:
    """The bands of one panorama in a folder; used by one process at a time, as a context.

    Parameters
    ----------
    folder
        Made where it is missing.
    key
        What the bands are of, as `key_of` gives it; bands of another one are removed.
    size, dtype
        Width and height of the panorama and the type of its samples, of which there are four a pixel.

    Raises
    ------
    OutputError
        If the folder holds other things, or cannot be written.
    ResourceError
        If another process uses it.
    """

    def __init__(self, folder: Path, key: str, size: tuple[int, int], dtype: DTypeLike) -> None:
        self.folder, self._key, self._size, self._dtype = Path(folder), key, size, np.dtype(dtype)
        self._handle: io.BufferedRandom | None = None
        with output_errors(self.folder):
            self.folder.mkdir(exist_ok=True)
            if not {entry.name for entry in self.folder.iterdir()} <= self._known():
                raise OutputError(
                    f"{self.folder}: is no folder of finished bands; move it away, or name another output"
                )
        self._lock()
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def bytes_per_pixel(self) -> int:
        """Of a pixel in the bands."""
        return 4 * self._dtype.itemsize

    def kept(self) -> Iterator[Band]:
        """The finished bands from the top, as far as they follow one another and are whole."""
        top = 0
        while top < self._size[1]:
            rows = self._read(top)
            if rows is None:
                return
            yield Band(top, rows)
            top += len(rows)

    def keeping(self, bands: Iterable[Band]) -> Iterator[Band]:
        """The same bands, each kept before it is handed on."""
        for band in bands:
            self._keep(band)
            yield band

    def note_temporary(self, path: Path) -> None:
        """Remember a temporary file beside the folder, for the next run to remove if this one is killed."""
        self._write_manifest(path.name)

    def remove(self) -> None:
        """Take the bands and the folder away."""
        self._empty()
        self.close()
        with output_errors(self.folder):
            (self.folder / _MANIFEST).unlink(missing_ok=True)
            self.folder.rmdir()

    def close(self) -> None:
        """Let another process use the folder."""
        if self._handle is not None:
            self._handle.close()
            self._handle = None

    def _known(self) -> set[str]:
        return {entry.name for entry in self.folder.iterdir() if _OWN.fullmatch(entry.name)}

    def _lock(self) -> None:
        with output_errors(self.folder):
            self._handle = (self.folder / _MANIFEST).open("a+b")
        try:
            import fcntl
        except ImportError:  # no Unix
            return
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.close()
            raise ResourceError(f"{self.folder}: another run is at work on it; wait for its end") from error
        except OSError:  # a file system without locks
            return

    def _begin(self) -> None:
        before = self._manifest()
        temporary = before.get("temporary", "")
        if isinstance(temporary, str) and _TEMPORARY.fullmatch(temporary):
            with contextlib.suppress(OSError):
                (self.folder.parent / temporary).unlink()
        if before.get("format") != FORMAT or before.get("key") != self._key:
            self._empty()
        self._write_manifest("")

    def _manifest(self) -> dict[str, Any]:
        assert self._handle is not None
        self._handle.seek(0)
        try:
            found = json.loads(self._handle.read())
        except ValueError:  # a new file, or one that was being written
            return {}
        return found if isinstance(found, dict) else {}

    def _write_manifest(self, temporary: str) -> None:
        """Within the file that is locked."""
        assert self._handle is not None
        content = json.dumps({"format": FORMAT, "key": self._key, "temporary": temporary}).encode()
        with output_errors(self.folder):
            self._handle.truncate(0)
            self._handle.write(content)
            self._handle.flush()

    def _empty(self) -> None:
        with output_errors(self.folder):
            for name in self._known() - {_MANIFEST}:
                (self.folder / name).unlink()

    def _keep(self, band: Band) -> None:
        rows = np.ascontiguousarray(band.rows)
        path = self.folder / _BAND.format(band.top)
        written = path.with_name(f"{path.name}.new")
        with output_errors(self.folder), written.open("wb") as file:
            file.write(hashlib.sha256(rows.data).digest())
            file.write(rows.data)
        with output_errors(self.folder):
            written.replace(path)

    def _read(self, top: int) -> NDArray[Any] | None:
        try:
            content = np.fromfile(self.folder / _BAND.format(top), np.uint8)
        except OSError:
            return None
        digest, rows = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        row_bytes = self._size[0] * self.bytes_per_pixel
        if not rows.size or rows.size % row_bytes or hashlib.sha256(rows.data).digest() != digest.tobytes():
            return None
        found: NDArray[Any] = rows.view(self._dtype).reshape(-1, self._size[0], 4)
        return found if top + len(found) <= self._size[1] else None


def _listed(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no fact for a key")
