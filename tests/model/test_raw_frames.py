"""Raw frames: what ffmpeg writes is what is read, and what does not fit is refused by frame and bytes."""

import io
import subprocess

import numpy as np
import pytest

from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.raw_frames import PIXEL_FORMATS, RawFormat, parse_raw_format, read_frames, write_frame


def stream_of(form: RawFormat, count: int) -> bytes:
    return np.random.default_rng(7).integers(0, 256, count * form.frame_bytes, np.uint8).tobytes()


@pytest.mark.parametrize("pixels", PIXEL_FORMATS)
def test_frames_written_are_the_bytes_read(pixels: str) -> None:
    form = parse_raw_format(f"7x5:{pixels}")
    content, written = stream_of(form, 8), io.BytesIO()
    for frame in read_frames(io.BytesIO(content), form, "in"):
        assert frame.shape == form.shape
        write_frame(written, frame, form)
    assert written.getvalue() == content


class Dribbling(io.BytesIO):
    """A pipe gives and takes what it happens to have room for."""

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        return super().readinto(buffer[:11])

    def write(self, content: memoryview) -> int:  # type: ignore[override]
        return super().write(content[:13])


def test_short_reads_and_writes_are_put_together() -> None:
    form = RawFormat((7, 5), "rgb24")
    content, written = stream_of(form, 3), Dribbling()
    for frame in read_frames(Dribbling(content), form, "in"):
        write_frame(written, frame, form)
    assert written.getvalue() == content


def test_samples_of_two_bytes_are_little_endian() -> None:
    (frame,) = (x.copy() for x in read_frames(io.BytesIO(b"\x01\x02\x03\x04"), RawFormat((2, 1), "gray16le"), "in"))
    assert frame.dtype == np.uint16
    assert frame.tolist() == [[0x0201, 0x0403]]


def test_channels_come_in_the_order_of_the_name() -> None:
    command = ["ffmpeg", "-v", "error", "-f", "lavfi", "-i", "color=red:s=4x2:r=1:d=1", "-f", "rawvideo"]
    try:
        content = subprocess.run([*command, "-pix_fmt", "bgr24", "-"], capture_output=True, check=True).stdout
    except FileNotFoundError:
        pytest.skip("ffmpeg is not installed")
    (frame,) = (x.copy() for x in read_frames(io.BytesIO(content), RawFormat((4, 2), "bgr24"), "in"))
    assert frame[0, 0, 2] > 200
    assert frame[0, 0, 0] < 50


@pytest.mark.parametrize(
    ("cut", "words"), [(1, "frame 3 is incomplete, 104 of 105 bytes"), (104, "frame 3 .* 1 of 105")]
)
def test_an_incomplete_frame_is_named_after_the_whole_ones(cut: int, words: str) -> None:
    form, seen = RawFormat((7, 5), "rgb24"), 0
    with pytest.raises(InputError, match=words):
        for _ in read_frames(io.BytesIO(stream_of(form, 3)[:-cut]), form, "standard input"):
            seen += 1
    assert seen == 2


def test_no_frame_at_all_is_an_error() -> None:
    with pytest.raises(InputError, match="no frame; does the sender write 7x5:gray"):
        list(read_frames(io.BytesIO(), RawFormat((7, 5), "gray"), "in"))


@pytest.mark.parametrize(
    "text",
    ["", "7x5", "7x5:", "7x5:rgb25", "0x5:rgb24", "7x0:gray", "99999x5:gray", "-7x5:gray", "7x5:gray:x", "٧x5:gray"],
)
def test_what_spells_no_format_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="raw frames"):
        parse_raw_format(text)


def test_a_frame_of_another_shape_or_type_is_not_written() -> None:
    form = RawFormat((7, 5), "rgb24")
    for frame in (np.zeros((7, 5, 3), np.uint8), np.zeros((5, 7), np.uint8), np.zeros((5, 7, 3), np.uint16)):
        with pytest.raises(ValueError, match="not"):
            write_frame(io.BytesIO(), frame, form)


def test_the_format_is_spelled_as_it_is_read() -> None:
    form = parse_raw_format("7x5:rgb48le")
    assert parse_raw_format(str(form)) == form
    assert str(form.resized((8, 4))) == "8x4:rgb48le"
