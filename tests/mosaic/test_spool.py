"""Finished bands come back as they were, those of the same key and whole ones only."""

from pathlib import Path

import numpy as np
import pytest

from fullsphere.model.errors import OutputError, ResourceError
from fullsphere.mosaic.compose import Band
from fullsphere.mosaic.spool import Spool, key_of

SIZE = (30, 50)


def bands(dtype: type = np.uint16) -> list[Band]:
    rng = np.random.default_rng(0)
    return [Band(top, rng.integers(0, 255, (min(20, 50 - top), 30, 4)).astype(dtype)) for top in (0, 20, 40)]


def fill(folder: Path, count: int = 3, key: str = "a", dtype: type = np.uint16) -> list[Band]:
    with Spool(folder, key, SIZE, dtype) as spool:
        return list(spool.keeping(bands(dtype)[:count]))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("count", [0, 2, 3])
def test_kept_bands_come_back(count: int, dtype: type, tmp_path: Path) -> None:
    handed_on = fill(tmp_path / "s", count, dtype=dtype)
    with Spool(tmp_path / "s", "a", SIZE, dtype) as spool:
        found = list(spool.kept())
        assert [band.top for band in found] == [band.top for band in handed_on]
        for band, kept in zip(bands(dtype), found, strict=False):
            np.testing.assert_array_equal(kept.rows, band.rows)
        spool.remove()
    assert not (tmp_path / "s").exists()


def test_bands_of_another_key_are_gone(tmp_path: Path) -> None:
    fill(tmp_path / "s")
    with Spool(tmp_path / "s", "b", SIZE, np.uint16) as spool:
        assert not list(spool.kept())


@pytest.mark.parametrize("harm", ["cut", "flip", "miss"])
def test_a_damaged_band_and_what_follows_it_are_not_kept(harm: str, tmp_path: Path) -> None:
    fill(tmp_path / "s")
    path = tmp_path / "s" / "band-0000020"
    content = bytearray(path.read_bytes())
    content[100] ^= 255
    path.write_bytes(bytes({"cut": content[:-240], "flip": content, "miss": b""}[harm]))
    with Spool(tmp_path / "s", "a", SIZE, np.uint16) as spool:
        assert [band.top for band in spool.kept()] == [0]


def test_one_run_at_a_time(tmp_path: Path) -> None:
    with Spool(tmp_path / "s", "a", SIZE, np.uint8), pytest.raises(ResourceError, match="another run"):
        Spool(tmp_path / "s", "a", SIZE, np.uint8)


def test_what_a_killed_run_left_beside_is_removed(tmp_path: Path) -> None:
    left, others = tmp_path / ".fullsphere-0123456789abcdef.partial", tmp_path / "mine.tif"
    for path in (left, others):
        path.write_bytes(b"x")
        with Spool(tmp_path / "s", "a", SIZE, np.uint8) as spool:
            spool.note_temporary(path)
        with Spool(tmp_path / "s", "a", SIZE, np.uint8):
            pass
    assert not left.exists()
    assert others.exists()


def test_a_folder_of_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "picture.jpg").write_bytes(b"x")
    with pytest.raises(OutputError, match="no folder of finished bands"):
        Spool(tmp_path, "a", SIZE, np.uint8)


def test_keys_differ_where_facts_do() -> None:
    assert key_of("a", [1, 2], np.eye(2)) == key_of("a", [1, 2], np.eye(2).tolist())
    facts: list[tuple[object, ...]] = [("a",), ("b",), ("a", 1), ("a", 1.5), ([],)]
    assert len({key_of(*some) for some in facts}) == 5
