"""The parts of the remap command: which picture becomes which file, sizes that fit, and frames through pipes."""

from __future__ import annotations

import argparse
import math
import os
import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.cli.channel import Channel, ClosedError
from fullsphere.cli.remap_batch import Job, outputs_of, planned
from fullsphere.cli.remap_raw import remap_frames
from fullsphere.cli.remap_source import Change, changed, check_size, crop, fitting_scale, scale, spelled
from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError, OutputError, UsageError
from fullsphere.model.lens import Equidistant
from fullsphere.model.raw_frames import RawFormat
from fullsphere.model.surface import Equirectangular

# --- which picture becomes which file ------------------------------------------------------------------------------


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    folder = tmp_path / "shots"
    folder.mkdir()
    for name in ("b.jpg", "a.PNG", "c.webp", ".hidden.jpg", "notes.txt"):
        (folder / name).write_bytes(b"x")
    (folder / "more.jpg").mkdir()
    return folder


def test_one_picture_becomes_the_file_named(tmp_path: Path) -> None:
    assert planned([Path("x/a.jpg")], str(tmp_path / "b.tif"), None) == [Job(Path("x/a.jpg"), tmp_path / "b.tif")]


def test_one_picture_into_a_folder_keeps_its_name(shots: Path, tmp_path: Path) -> None:
    expected = [Job(shots / "b.jpg", tmp_path / "b.jpg")]
    assert planned([shots / "b.jpg"], str(tmp_path), None) == expected
    assert planned([shots / "b.jpg"], f"{tmp_path}/", None) == expected


def test_the_pictures_of_a_folder_come_by_name_and_nothing_else_of_it(shots: Path, tmp_path: Path) -> None:
    jobs = planned([shots], f"{tmp_path}/out/", None)
    assert [job.picture.name for job in jobs] == ["a.PNG", "b.jpg", "c.webp"]
    assert [job.output for job in jobs] == [tmp_path / "out" / name for name in ("a.PNG", "b.jpg", "c.tif")]
    jobs = planned([shots], f"{tmp_path}/out/", "exr")
    assert [job.output.name for job in jobs] == ["a.exr", "b.exr", "c.exr"]


def test_two_pictures_of_one_name_are_refused(shots: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"b.jpg.*b.tif.*would both become .*b.png"):
        planned([shots / "b.jpg", tmp_path / "b.tif"], f"{tmp_path}/", "png")


def test_several_pictures_do_not_become_one_file(shots: Path, tmp_path: Path) -> None:
    for given in ([shots / "b.jpg", shots / "c.webp"], [shots]):
        with pytest.raises(UsageError, match=r"need a folder; write -o .*x.tif/"):
            planned(given, str(tmp_path / "x.tif"), None)


def test_a_format_beside_the_name_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--format"):
        planned([Path("a.jpg")], str(tmp_path / "x.tif"), "png")


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no pictures"):
        planned([tmp_path], f"{tmp_path}/out/", None)


def jobs_of(folder: Path, out: Path, names: str) -> list[Job]:
    return [Job(folder / f"{name}.jpg", out / f"{name}.tif") for name in names]


def test_the_folder_of_several_is_made_and_taken_away_again_if_nothing_came(tmp_path: Path) -> None:
    out = tmp_path / "out"
    jobs = jobs_of(tmp_path, out, "ab")
    with outputs_of(jobs, overwrite=False, make_folder=True):
        assert list(out.iterdir()) == []
    assert not out.exists()
    with outputs_of(jobs, overwrite=False, make_folder=True):
        (out / "a.tif").write_bytes(b"x")
    assert (out / "a.tif").exists()


def test_a_folder_in_no_folder_is_not_made(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, tmp_path / "no" / "out", "ab")
    with (
        pytest.raises(OutputError, match="does not exist; make it first"),
        outputs_of(jobs, overwrite=False, make_folder=True),
    ):
        pass


def test_any_output_that_exists_is_refused_unless_it_may_be_replaced(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, tmp_path, "abc")
    (tmp_path / "c.tif").write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"c\.tif.*--overwrite"), outputs_of(jobs, overwrite=False, make_folder=True):
        pass
    with outputs_of(jobs, overwrite=True, make_folder=False):
        pass


@pytest.mark.parametrize("overwrite", [False, True])
def test_no_input_is_an_output_whatever_its_name(tmp_path: Path, overwrite: bool) -> None:
    jobs = jobs_of(tmp_path, tmp_path, "abc")
    (tmp_path / "b.jpg").write_bytes(b"precious")
    (tmp_path / "c.tif").hardlink_to(tmp_path / "b.jpg")
    with pytest.raises(OutputError, match="is an input of this run"), outputs_of(jobs, overwrite, make_folder=False):
        pass


# --- what the pictures are ------------------------------------------------------------------------------------------


def camera(size: tuple[int, int] = (3000, 2000)) -> Camera:
    return Camera(Equidistant(600.0), size, (1501.0, 990.0), half_fov=math.radians(95))


@pytest.mark.parametrize(("text", "factor"), [("0.5", 0.5), (".25", 0.25), ("2", 2), ("1/3", Fraction(1, 3))])
def test_a_scale_is_a_number_or_a_ratio(text: str, factor: float) -> None:
    assert scale(text).factor == factor


@pytest.mark.parametrize("text", ["", "0", "-1", "nan", "inf", "1e3", "1/0", "0/1", "1/2/3", "1001", "x", "½"])
def test_what_is_no_scale_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"scale|zero|1000"):
        scale(text)


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "1,2,3x", "1.5,2,3x4", "nan,0,3x4", "1,2,-3x4", "1,2,3x4x5"])
def test_what_is_no_rectangle_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="rectangle"):
        crop(text)


def test_changes_are_made_in_the_order_given() -> None:
    first_scaled = changed(camera(), [scale("0.5"), crop("100,50,800x700")], "c.json")
    assert first_scaled == camera().scaled(0.5).cropped(100, 50, 800, 700)
    first_cropped = changed(camera(), [crop("200,100,1600x1400"), scale("1/2")], "c.json")
    assert first_cropped.size == first_scaled.size == (800, 700)
    assert np.allclose(first_cropped.project([0.3, -0.2, 0.4]), first_scaled.project([0.3, -0.2, 0.4]))


def test_only_cameras_are_scaled_and_cropped() -> None:
    with pytest.raises(UsageError, match=r"--crop 0,0,8x8: is for cameras"):
        changed(Equirectangular((64, 32)), [crop("0,0,8x8")], "equirectangular:64")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ((3000, 2000), (1500, 1000), "0.5"),
        ((4000, 3000), (1333, 1000), "1/3"),
        ((3001, 2001), (1500, 1000), "0.5"),
        ((3000, 2000), (6000, 4000), "2"),
        ((4056, 3040), (1920, 1439), "80/169"),
        ((3000, 2000), (3000, 1999), None),
        ((3000, 2000), (1500, 900), None),
    ],
)
def test_the_scale_that_would_fit_is_found(old: tuple[int, int], new: tuple[int, int], said: str | None) -> None:
    factor = fitting_scale(old, new)
    assert (None if factor is None else spelled(factor)) == said
    if factor is not None:
        assert camera(old).scaled(float(scale(spelled(factor)).factor)).size == new


def test_every_scale_that_is_proposed_fits() -> None:
    random = np.random.default_rng(4)
    for _ in range(300):
        old = tuple(int(x) for x in random.integers(100, 9000, 2))
        new = camera((old[0], old[1])).scaled(float(random.uniform(0.05, 3))).size
        factor = fitting_scale((old[0], old[1]), new)
        assert factor is not None
        assert camera((old[0], old[1])).scaled(float(scale(spelled(factor)).factor)).size == new


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((1500, 1000), "a.jpg: is 1500 x 1000 pixels, but --from c.json is for 3000 x 2000; .* add --scale 0.5"),
        ((1500, 1500), "a.jpg: is 1500 x 1500 .* for 3000 x 2000; .* --crop LEFT,TOP,1500x1500"),
        ((3100, 2001), "another camera"),
    ],
)
def test_a_picture_of_another_size_is_refused_with_what_may_fit(size: tuple[int, int], words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_size("a.jpg", size, camera(), "c.json", [])


def test_a_picture_of_another_size_than_stated_is_refused_with_what_was_stated() -> None:
    changes: list[Change] = [scale("0.5"), crop("0,0,10x10")]
    with pytest.raises(InputError, match=r"--from c.json --scale 0.5 --crop 0,0,10x10 is for 10 x 10"):
        check_size("a.jpg", (1500, 1000), changed(camera(), changes, "c.json"), "c.json", changes)
    check_size("a.jpg", (10, 10), changed(camera(), changes, "c.json"), "c.json", changes)


# --- from thread to thread ------------------------------------------------------------------------------------------


def test_a_channel_hands_on_in_order_and_then_the_error() -> None:
    channel: Channel[int] = Channel(3)
    for k in range(3):
        channel.give(k)
    channel.end(InputError("broken"))
    items = iter(channel)
    assert [next(items) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(InputError, match="broken"):
        next(items)


def test_closing_wakes_who_waits_on_either_side() -> None:
    full: Channel[int] = Channel()
    full.give(1)
    empty: Channel[int] = Channel()
    caught: list[BaseException] = []

    def wait(work: Any) -> None:
        try:
            work()
        except BaseException as error:
            caught.append(error)

    waiting = [
        threading.Thread(target=wait, args=(work,)) for work in (lambda: full.give(2), lambda: next(iter(empty)))
    ]
    for thread in waiting:
        thread.start()
    full.close()
    empty.close(OutputError("gone"))
    for thread in waiting:
        thread.join()
    assert {type(error) for error in caught} == {ClosedError, OutputError}


# --- frames through pipes -------------------------------------------------------------------------------------------

FORM = RawFormat((60, 40), "rgb24")


class Pipes:
    """Both ends of what the command sees as standard input and output."""

    def __init__(self) -> None:
        (self.inner_in, self.feed), (self.take, self.inner_out) = os.pipe(), os.pipe()
        self._open = [self.inner_in, self.feed, self.take, self.inner_out]

    def close(self, descriptor: int) -> None:
        self._open.remove(descriptor)
        os.close(descriptor)

    def close_all(self) -> None:
        while self._open:
            self.close(self._open[0])


@pytest.fixture
def pipes() -> Iterator[Pipes]:
    both = Pipes()
    yield both
    both.close_all()


def feed(pipes: Pipes, content: bytes) -> None:
    def work() -> None:
        rest = memoryview(content)
        try:
            while rest:
                rest = rest[os.write(pipes.feed, rest) :]
        except OSError:  # the command has left
            return
        pipes.close(pipes.feed)

    threading.Thread(target=work, daemon=True).start()


def taken(pipes: Pipes, into: bytearray) -> threading.Thread:
    def work() -> None:
        while piece := os.read(pipes.take, 1 << 16):
            into.extend(piece)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def inverted(frame: NDArray[Any]) -> NDArray[Any]:
    return 255 - frame


@pytest.mark.parametrize("count", [1, 2, 3, 4, 50])
def test_every_frame_comes_out_in_order(pipes: Pipes, count: int) -> None:
    content = np.random.default_rng(3).integers(0, 256, count * FORM.frame_bytes, np.uint8)
    out = bytearray()
    feed(pipes, content.tobytes())
    taking = taken(pipes, out)
    assert remap_frames(FORM, FORM, inverted, pipes=(pipes.inner_in, pipes.inner_out)) == count
    pipes.close(pipes.inner_out)
    taking.join()
    assert bytes(out) == (255 - content).tobytes()


def test_whole_frames_are_written_before_an_incomplete_one_is_named(pipes: Pipes) -> None:
    out = bytearray()
    feed(pipes, bytes(3 * FORM.frame_bytes - 1))
    taking = taken(pipes, out)
    with pytest.raises(InputError, match="standard input: frame 3 is incomplete, 7199 of 7200 bytes"):
        remap_frames(FORM, FORM, inverted, pipes=(pipes.inner_in, pipes.inner_out))
    pipes.close(pipes.inner_out)
    taking.join()
    assert bytes(out) == b"\xff" * (2 * FORM.frame_bytes)


def test_a_reader_that_has_gone_ends_the_work_although_the_sender_goes_on(pipes: Pipes) -> None:
    frames = 0

    def counted(frame: NDArray[Any]) -> NDArray[Any]:
        nonlocal frames
        frames += 1
        if frames == 2:
            pipes.close(pipes.take)
        return frame

    def send_for_ever() -> None:
        try:
            while True:
                os.write(pipes.feed, bytes(FORM.frame_bytes))
        except OSError:
            pass

    threading.Thread(target=send_for_ever, daemon=True).start()
    with pytest.raises(BrokenPipeError):
        remap_frames(FORM, FORM, counted, pipes=(pipes.inner_in, pipes.inner_out))


def test_a_fault_in_the_work_does_not_wait_for_either_pipe(pipes: Pipes) -> None:
    os.write(pipes.feed, bytes(FORM.frame_bytes))  # and then nothing: the sender is slow

    def failing(_frame: NDArray[Any]) -> NDArray[Any]:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        remap_frames(FORM, FORM, failing, pipes=(pipes.inner_in, pipes.inner_out))


def test_closed_standard_streams_are_errors_that_name_them() -> None:
    there, gone = os.pipe()
    os.close(gone)
    with pytest.raises(InputError, match="standard input: cannot be read"):
        remap_frames(FORM, FORM, inverted, pipes=(gone, there))
    with pytest.raises(OutputError, match="standard output: cannot be written"):
        remap_frames(FORM, FORM, inverted, pipes=(there, gone))
    os.close(there)
