"""Files are replaced whole or not at all; JSON is read strictly."""

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from fullsphere.model.errors import InputError, OutputError
from fullsphere.model.files import check_output, read_json, replacing, sha256_of, write_json


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_replacing_puts_the_new_file_in_place(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    with replacing(target, overwrite=False) as temporary:
        assert temporary.parent == tmp_path
        assert not target.exists()
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"new"
    assert names(tmp_path) == ["out.bin"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, GeneratorExit])
def test_an_exception_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")
    with pytest.raises(error), replacing(target, overwrite=True) as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["out.bin"]


def test_the_result_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    with replacing(tmp_path / "out", overwrite=False):
        pass
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_a_link_at_the_target_is_replaced_and_not_followed(tmp_path: Path) -> None:
    treasure, link = tmp_path / "treasure", tmp_path / "out"
    treasure.write_bytes(b"precious")
    link.symlink_to(treasure)
    with replacing(link, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    assert treasure.read_bytes() == b"precious"
    assert not link.is_symlink()
    assert link.read_bytes() == b"new"


def test_a_dangling_link_counts_as_existing(tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="exists"):
        check_output(tmp_path / "out", overwrite=False)


def test_a_file_that_appears_during_the_work_is_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(OutputError, match="--overwrite"), replacing(target, overwrite=False) as temporary:
        temporary.write_bytes(b"ours")
        target.write_bytes(b"theirs")
    assert target.read_bytes() == b"theirs"
    assert names(tmp_path) == ["out"]


def test_names_that_are_long_or_not_utf8_can_be_written(tmp_path: Path) -> None:
    for name in ("x" * 255, os.fsdecode(b"bad\xff.bin"), "-leading", "%04d #?.bin"):
        try:
            (tmp_path / name).touch()
        except OSError:
            continue  # a file system that does not take such names
        with replacing(tmp_path / name, overwrite=True) as temporary:
            temporary.write_bytes(b"new")
        assert (tmp_path / name).read_bytes() == b"new"


def test_check_output_accepts_a_free_name_and_leaves_nothing(tmp_path: Path) -> None:
    check_output(tmp_path / "out.tif", overwrite=False, inputs=[tmp_path / "missing"])
    assert names(tmp_path) == []


def test_check_output_refuses_what_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "old").write_bytes(b"old")
    (tmp_path / "folder").mkdir()
    os.link(tmp_path / "old", tmp_path / "other-name")
    for name, overwrite, inputs, said in (
        ("old", False, [], "--overwrite"),
        ("folder", True, [], "folder"),
        ("missing/out", True, [], "does not exist"),
        ("old/out", True, [], "written"),
        ("old", True, ["old"], "input"),
        ("old", True, ["other-name"], "input"),
        ("y" * 300, True, [], "written"),
    ):
        with pytest.raises(OutputError, match=said):
            check_output(tmp_path / name, overwrite, [tmp_path / other for other in inputs])
    assert (tmp_path / "old").read_bytes() == b"old"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder in which not even root can write")
def test_check_output_refuses_devices_and_folders_that_take_no_files() -> None:
    with pytest.raises(OutputError, match="ordinary"):
        check_output(Path("/dev/null"), overwrite=True)
    with pytest.raises(OutputError, match="written"):  # even for root
        check_output(Path("/proc/out.tif"), overwrite=True)


def test_json_comes_back_and_is_sorted_and_ends_with_a_newline(tmp_path: Path) -> None:
    value = {"b": [1, 2.5, None, True, "ä\n\udcff"], "a": {"matrix": np.eye(2), "empty": [], "none": {}}}
    write_json(tmp_path / "x.json", value, overwrite=False)
    text = (tmp_path / "x.json").read_text()
    assert text.index('"a"') < text.index('"b"')
    assert text.endswith("}\n")
    assert "[1.0, 0.0]" in text
    assert read_json(tmp_path / "x.json") == {
        **value,
        "a": {"matrix": [[1.0, 0.0], [0.0, 1.0]], "empty": [], "none": {}},
    }
    assert read_json(tmp_path / "x.json") == json.loads(text)


def test_floats_come_back_to_the_last_bit(tmp_path: Path) -> None:
    values = np.random.default_rng(0).standard_normal(100) * 10.0 ** np.arange(-50, 50)
    write_json(tmp_path / "x.json", values, overwrite=False)
    assert read_json(tmp_path / "x.json") == values.tolist()


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf")])
def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path, number: float) -> None:
    with pytest.raises(OutputError, match=r"curve\.r_px\[1\]"):
        write_json(tmp_path / "x.json", {"curve": {"r_px": np.array([0, number])}}, overwrite=False)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'{"a": {"b": [1, 1e999]}}', r"a\.b\[1\] is not a finite"),
        (b'{"a": NaN}', "a is not a finite"),
        (b'{"a": -Infinity}', "a is not a finite"),
        (b'{"a": ' + b"9" * 400 + b"}", "a is not a finite"),
        (b'{"a": ' + b"9" * 5000 + b"}", "number"),
        (b'{"k": 1, "k": 1}', "'k' stands twice"),
        (b'{"a": {"k": 1, "k": 2}}', "'k' stands twice"),
        (b"[" * 100_000, "deep"),
        (b"[" * 100 + b"]" * 100, "deep"),
        (b'{"a": 1', "line 1, column"),
        (b"", "not JSON"),
        (b'{"a": "\xff"}', "UTF-8"),
    ],
)
def test_json_that_is_not_strict_is_refused_by_name(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "camera.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=said) as refusal:
        read_json(path)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_json_of_absurd_size_is_refused_before_it_is_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fullsphere.model.files.MAX_JSON_BYTES", 10)
    (tmp_path / "x.json").write_text("[1, 2, 3, 4, 5]")
    with pytest.raises(InputError, match="larger"):
        read_json(tmp_path / "x.json")


def test_a_missing_file_and_a_folder_are_input_errors(tmp_path: Path) -> None:
    for read in (read_json, sha256_of):
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "missing")
        with pytest.raises(InputError, match="folder"):
            read(tmp_path)


def test_sha256_is_that_of_the_bytes(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"abc")
    assert sha256_of(tmp_path / "x") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
