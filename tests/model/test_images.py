"""Reading pictures: pixels exactly as stored, or one clear line that says why not."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.errors import InputError
from fullsphere.model.images import open_panorama, picture_size, read_picture


def noise(shape: tuple[int, ...], dtype: type = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def encoded(ending: str, bgr: NDArray[np.generic], *options: int) -> bytes:
    done, data = cv2.imencode(ending, bgr, options)
    assert done
    return bytes(data.tobytes())


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def huge_png(side: int) -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def huge_jpeg() -> bytes:
    data = bytearray(encoded(".jpg", noise((8, 8, 3))))
    frame = data.index(b"\xff\xc0")
    data[frame + 5 : frame + 9] = struct.pack(">HH", 65500, 65500)
    return bytes(data)


def with_exif_orientation(jpeg: bytes, orientation: int) -> bytes:
    tiff = b"MM\x00*\x00\x00\x00\x08" + struct.pack(">HHHIHxxI", 1, 0x0112, 3, 1, orientation, 0)
    exif = b"Exif\x00\x00" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as error:
        read_picture(path)
    text = str(error.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text


@pytest.mark.parametrize("ending", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_lossless_pictures_come_as_stored(tmp_path: Path, ending: str, dtype: type, channels: int) -> None:
    bgr = noise((30, 41, channels), dtype)
    path = tmp_path / f"x{ending}"
    path.write_bytes(encoded(ending, bgr))
    picture = read_picture(path)
    assert picture.pixels.dtype == dtype
    assert picture.pixels.flags.c_contiguous
    assert np.array_equal(picture.pixels, bgr[..., [2, 1, 0, 3][:channels] if channels > 1 else [0]])
    assert (picture.linear, picture.orientation, picture.icc_profile) == (False, 1, None)
    assert picture_size(path) == (41, 30)


def test_floating_point_pictures_are_linear(tmp_path: Path) -> None:
    pixels = np.linspace(-1, 70_000, 20 * 10 * 3, dtype=np.float32).reshape(10, 20, 3)
    with open_panorama(tmp_path / "x.tif", (20, 10), 3, np.float32, {}, overwrite=False) as writer:
        writer.write_rows(0, pixels)
    picture = read_picture(tmp_path / "x.tif")
    assert picture.linear
    assert np.array_equal(picture.pixels, pixels)


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_pixels_are_never_rotated(tmp_path: Path, orientation: int) -> None:
    jpeg = encoded(".jpg", noise((16, 48, 3)))
    (tmp_path / "plain.jpg").write_bytes(jpeg)
    (tmp_path / "turned.jpg").write_bytes(with_exif_orientation(jpeg, orientation))
    plain, turned = read_picture(tmp_path / "plain.jpg"), read_picture(tmp_path / "turned.jpg")
    assert turned.orientation == orientation
    assert np.array_equal(turned.pixels, plain.pixels)
    assert picture_size(tmp_path / "turned.jpg") == (48, 16)


def test_grey_with_alpha_becomes_rgba(tmp_path: Path) -> None:
    grey_alpha = noise((5, 7, 2))
    rows = b"".join(b"\x00" + row.tobytes() for row in grey_alpha)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 7, 5, 8, 4, 0, 0, 0))
    data = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    (tmp_path / "x.png").write_bytes(data)
    assert np.array_equal(read_picture(tmp_path / "x.png").pixels, grey_alpha[..., [0, 0, 0, 1]])


def test_a_wrong_ending_does_not_matter(tmp_path: Path) -> None:
    bgr = noise((10, 12, 3))
    for name in ("x.jpg", "x.tif", "x.nef", "x", "x.heic", "x.%04d", "-x #?.png"):
        (tmp_path / name).write_bytes(encoded(".png", bgr))
        assert np.array_equal(read_picture(tmp_path / name).pixels, bgr[..., ::-1])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems take no names that are not UTF-8")
def test_names_that_are_not_utf8(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"f\xfcr")
    folder.mkdir()
    pixels = noise((10, 20, 3))
    for name in (b"\xff.tif", b"\xff.png"):
        path = folder / os.fsdecode(name)
        with open_panorama(path, (20, 10), 3, np.uint8, {}, overwrite=False) as writer:
            writer.write_rows(0, pixels)
        assert np.array_equal(read_picture(path).pixels, pixels)


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.jpg").write_text("P3 1 1 255 this is a text\n" * 20)
    (tmp_path / "noise.png").write_bytes(noise((5000,)).tobytes())
    assert "no such file" in refusal(tmp_path / "missing.jpg")
    assert "folder" in refusal(tmp_path)
    assert "empty" in refusal(tmp_path / "empty.jpg")
    assert "JPEG, PNG" in refusal(tmp_path / "text.jpg")
    assert "JPEG, PNG" in refusal(tmp_path / "noise.png")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.jpg")
        assert "ordinary" in refusal(tmp_path / "pipe.jpg")


RAW_HEADS = {
    "x.NEF": b"MM\x00*\x00\x00\x00\x08",
    "x.dng": b"II*\x00\x08\x00\x00\x00",
    "x.arw": b"II*\x00\x08\x00\x00\x00",
    "x.tif": b"II*\x00\x10\x00\x00\x00CR\x02\x00",
    "x.jpg": b"FUJIFILMCCD-RAW 0201",
    "x.cr3": b"\x00\x00\x00\x18ftypcrx \x00\x00\x00\x01",
    "x.orf": b"IIRO\x08\x00\x00\x00",
    "x.rw2": b"IIU\x00\x08\x00\x00\x00",
    "x.raf": b"nothing known",
}


@pytest.mark.parametrize("name", RAW_HEADS)
def test_raw_files_are_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(RAW_HEADS[name] + bytes(1000))
    assert "16-bit TIFF" in refusal(tmp_path / name)
    assert "RAW" in refusal(tmp_path / name)


@pytest.mark.parametrize("brand", [b"heic", b"mif1", b"avif"])
def test_heic_files_are_refused_with_what_to_do(tmp_path: Path, brand: bytes) -> None:
    for name in ("x.heic", "x.jpg"):
        (tmp_path / name).write_bytes(b"\x00\x00\x00\x18ftyp" + brand + bytes(1000))
        assert "16-bit TIFF" in refusal(tmp_path / name)
        assert "HEIC" in refusal(tmp_path / name)


FORMATS = {
    "baseline.jpg": lambda bgr: encoded(".jpg", bgr),
    "progressive.jpg": lambda bgr: encoded(".jpg", bgr, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "x.png": lambda bgr: encoded(".png", bgr),
    "plain.tif": lambda bgr: encoded(".tif", bgr, cv2.IMWRITE_TIFF_COMPRESSION, 1),
    "lzw.tif": lambda bgr: encoded(".tif", bgr),
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_truncated_file_gives_its_own_pixels_or_an_error(tmp_path: Path, name: str) -> None:
    smooth = cv2.GaussianBlur(noise((120, 160, 3)), (0, 0), 2)
    data = FORMATS[name](smooth)
    path = tmp_path / name
    path.write_bytes(data)
    whole = read_picture(path).pixels
    refused = 0
    lengths = [1, 8, 64, *(int(len(data) * share) for share in np.linspace(0.05, 0.99, 12)), len(data) - 1]
    for length in lengths:
        path.write_bytes(data[:length])
        try:
            assert np.array_equal(read_picture(path).pixels, whole)
        except InputError as error:
            assert str(error).startswith(str(path))
            refused += 1
    assert refused >= len(lengths) - 2  # the last byte of a PNG, of its closing chunk, is none of the picture


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.png", huge_png(40_000)), ("y.png", huge_png(2_000_000_000)), ("x.jpg", huge_jpeg())],
)
def test_a_header_that_claims_too_much_is_refused_before_any_allocation(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (tmp_path / name).write_bytes(content)
    refusal(tmp_path / name)
    with pytest.raises(InputError):
        picture_size(tmp_path / name)


def test_channels_and_samples_that_no_photograph_has_are_refused(tmp_path: Path) -> None:
    strip = noise((4, 4, 5)).tobytes()
    tags = [(256, 4), (257, 4), (258, 8), (259, 1), (262, 1), (273, 0), (277, 5), (278, 4), (279, len(strip))]
    (tmp_path / "five.tif").write_bytes(tiff_of(tags, strip))
    assert "5 channels" in refusal(tmp_path / "five.tif")
    strip = noise((4, 4)).astype(np.uint32).tobytes()
    tags = [(256, 4), (257, 4), (258, 32), (259, 1), (262, 1), (273, 0), (277, 1), (278, 4), (279, len(strip))]
    (tmp_path / "long.tif").write_bytes(tiff_of(tags, strip))
    assert "samples" in refusal(tmp_path / "long.tif")
    tags = [(256, 4), (257, 4), (258, 16), (259, 1), (262, 32803), (273, 0), (277, 1), (278, 4), (279, 32)]
    (tmp_path / "mosaic.tif").write_bytes(tiff_of(tags, strip))
    assert "RAW" in refusal(tmp_path / "mosaic.tif")


def tiff_of(tags: list[tuple[int, int]], strip: bytes) -> bytes:
    start = 8 + 2 + 12 * len(tags) + 4
    entries = b"".join(
        struct.pack("<HHII", tag, 4 if tag in (273, 279) else 3, 1, start if tag == 273 else value)
        for tag, value in tags
    )
    return b"II*\x00\x08\x00\x00\x00" + struct.pack("<H", len(tags)) + entries + bytes(4) + strip


def test_a_picture_larger_than_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fullsphere.model.errors import ResourceError

    (tmp_path / "x.png").write_bytes(encoded(".png", noise((10, 10, 3))))
    monkeypatch.setattr("fullsphere.model.resources.available_memory", lambda: 100)
    with pytest.raises(ResourceError, match="memory"):
        read_picture(tmp_path / "x.png")


def test_texts_of_the_camera_are_cleaned(tmp_path: Path) -> None:
    attributes: dict[str, str | float] = {"Make": "A\x1b[31m\nB" + "x" * 1000, "ExposureTime": 0.25, "Copyright": " "}
    with open_panorama(tmp_path / "x.tif", (8, 4), 3, np.uint8, attributes, overwrite=False) as writer:
        writer.write_rows(0, noise((4, 8, 3)))
    metadata = read_picture(tmp_path / "x.tif").metadata
    assert metadata == {"Make": ("A[31mB" + "x" * 1000)[:500], "ExposureTime": 0.25}


def test_plug_ins_named_by_the_environment_are_not_loaded(tmp_path: Path) -> None:
    # what the library sees after the import; a planted plug-in would need a compiler
    code = "import fullsphere.model.images, os, sys; sys.exit('OIIO_LIBRARY_PATH' in os.environ)"
    environment = {**os.environ, "OIIO_LIBRARY_PATH": str(tmp_path)}
    assert subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode == 0
