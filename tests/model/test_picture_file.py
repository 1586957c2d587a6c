"""Pictures read by region: the same pixels as read whole, from the parts of the file that hold them and no others."""

import os
import shutil
import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model import image_library, picture_blocks
from fullsphere.model.errors import InputError, ResourceError
from fullsphere.model.image_library import MAX_PIXELS, ImageOutput, ImageSpec
from fullsphere.model.images import open_panorama, open_picture, picture_size, read_picture

SIZE = (500, 411)  # neither side a multiple of a tile's or of a band's


def photograph(channels: int, dtype: str) -> NDArray[Any]:
    noise = np.random.default_rng(0).random((SIZE[1], SIZE[0], channels), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3).reshape(noise.shape)
    samples = np.dtype(dtype)
    scaled: NDArray[Any] = (smooth * (np.iinfo(samples).max if samples.kind == "u" else 3)).astype(samples)
    return scaled


def with_opencv(*options: int) -> Callable[[Path, NDArray[Any]], None]:
    def write(path: Path, pixels: NDArray[Any]) -> None:
        done, data = cv2.imencode(path.suffix, pixels[..., [2, 1, 0, 3][: pixels.shape[2]]], options)
        assert done
        path.write_bytes(data.tobytes())

    return write


def with_library(**attributes: str | int) -> Callable[[Path, NDArray[Any]], None]:
    """A file of rows, or of tiles of an odd shape."""

    def write(path: Path, pixels: NDArray[Any]) -> None:
        height, width, channels = pixels.shape
        names = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
        spec = ImageSpec(width, height, channels, names[pixels.dtype.name])
        spec.attribute("Exif:ColorSpace", 1)
        for name, value in attributes.items():
            if hasattr(spec, name):
                setattr(spec, name, value)
            else:
                spec.attribute(name.replace("__", ":"), value)
        output = ImageOutput.create(path.suffix[1:])
        assert output is not None
        assert output.open(str(path), spec)
        assert output.write_image(pixels)
        output.close()
        output.geterror()

    return write


def with_panorama(path: Path, pixels: NDArray[Any]) -> None:
    size = (pixels.shape[1], pixels.shape[0])
    with open_panorama(path, size, pixels.shape[2], pixels.dtype, {}, overwrite=True) as writer:
        writer.write_rows(0, pixels)


FILES: dict[str, tuple[Callable[[Path, NDArray[Any]], None], int, str]] = {
    "baseline.jpg": (with_opencv(), 3, "uint8"),
    "progressive.jpg": (with_opencv(cv2.IMWRITE_JPEG_PROGRESSIVE, 1), 3, "uint8"),
    "grey.jpg": (with_library(), 1, "uint8"),
    "eight.png": (with_opencv(), 4, "uint8"),
    "sixteen.png": (with_opencv(), 3, "uint16"),
    "plain-rows.tif": (with_library(compression="none"), 3, "uint16"),
    "one-strip.tif": (with_library(compression="zip", tiff__RowsPerStrip=411), 3, "uint8"),
    "odd-strips.tif": (with_library(compression="lzw", tiff__RowsPerStrip=7), 3, "uint8"),
    "tiles.tif": (with_panorama, 4, "uint8"),
    "grey-alpha.tif": (with_panorama, 2, "uint16"),
    "wide-tiles.tif": (with_library(compression="zip", tile_width=208, tile_height=48), 3, "float32"),
    "planes.tif": (with_library(planarconfig="separate"), 3, "uint8"),
    "rows.exr": (with_library(compression="zip"), 3, "float16"),
    "dwab-rows.exr": (with_library(compression="dwab"), 3, "float16"),
    "tiles.exr": (with_panorama, 3, "float32"),
    "offset.exr": (with_library(compression="piz", x=-40, y=25, tile_width=64, tile_height=32), 3, "float16"),
    "offset-rows.exr": (with_library(compression="zips", x=7, y=-90), 1, "float32"),
    "x.webp": (with_opencv(cv2.IMWRITE_WEBP_QUALITY, 101), 3, "uint8"),
    "x.jp2": (with_opencv(), 3, "uint8"),
}


def written(folder: Path, name: str) -> Path:
    write, channels, dtype = FILES[name]
    write(folder / name, photograph(channels, dtype))
    return folder / name


def as_stored(path: Path, name: str) -> NDArray[Any]:
    pixels = read_picture(path).pixels
    return pixels[..., 2:] if FILES[name][1] == 2 else pixels


@pytest.mark.parametrize("name", FILES)
def test_windows_and_strips_are_parts_of_the_whole(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    whole = as_stored(path, name)
    _, channels, dtype = FILES[name]
    rng = np.random.default_rng(1)
    for cache_bytes in (0, 300_000, 1 << 26):
        with open_picture(path, cache_bytes) as file:
            assert (file.size, file.channels, file.dtype.name) == (SIZE, channels, dtype)
            assert file.linear == (dtype in ("float16", "float32"))
            for _ in range(10):
                left, top = int(rng.integers(0, SIZE[0])), int(rng.integers(0, SIZE[1]))
                width, height = int(rng.integers(1, SIZE[0] - left + 1)), int(rng.integers(1, SIZE[1] - top + 1))
                window = file.window(left, top, width, height)
                assert window.dtype == file.dtype
                assert window.flags.c_contiguous
                assert np.array_equal(window, whole[top : top + height, left : left + width])
            for rows in (1, 100, 10_000):
                end = 0
                for top, strip in file.strips(rows):
                    assert top == end
                    assert np.array_equal(strip, whole[top : top + len(strip)])
                    end += len(strip)
                assert end == SIZE[1]


@pytest.mark.parametrize("name", ["baseline.jpg", "eight.png", "odd-strips.tif", "rows.exr", "tiles.tif"])
def test_windows_that_go_down_decode_each_row_once(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, name)
    decoded = 0
    read_part = image_library.read_part

    def counted(*args: Any) -> NDArray[Any]:
        nonlocal decoded
        samples = read_part(*args)
        decoded += samples.shape[0] * samples.shape[1]
        return samples

    monkeypatch.setattr(picture_blocks, "read_part", counted)
    with open_picture(path) as file:
        for top in range(0, SIZE[1], 40):
            for left in range(0, SIZE[0], 90):
                file.window(left, top, min(100, SIZE[0] - left), min(60, SIZE[1] - top))
    assert decoded == SIZE[0] * SIZE[1]


def test_a_tiled_file_reads_the_tiles_that_are_touched(tmp_path: Path) -> None:
    path = written(tmp_path, "tiles.tif")
    whole = read_picture(path).pixels
    content = bytearray(path.read_bytes())
    # Tiles stand in the file in their order, so the last bytes before the directory are of the lower right ones.
    content[len(content) * 8 // 10 : len(content) * 9 // 10] = bytes(len(content) * 9 // 10 - len(content) * 8 // 10)
    path.write_bytes(content)
    with open_picture(path) as file:
        assert np.array_equal(file.window(10, 10, 300, 240), whole[10:250, 10:310])
        with pytest.raises(InputError, match=r"tiles\.tif: is damaged"):
            file.window(0, 300, SIZE[0], 111)
        assert np.array_equal(file.window(10, 10, 300, 240), whole[10:250, 10:310])
    with pytest.raises(InputError):
        read_picture(path)


@pytest.mark.parametrize("name", ["baseline.jpg", "eight.png", "odd-strips.tif", "rows.exr"])
def test_damage_is_met_where_it_is_and_everything_below_stays_refused(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    whole = read_picture(path).pixels
    if name.endswith(".tif"):  # its directory stands behind the pixels: damage them instead of cutting them off
        content = bytearray(path.read_bytes())
        for place in range(len(content) * 6 // 10, len(content) * 9 // 10, 50):
            content[place : place + 4] = b"\xff\xff\xff\xff"
        path.write_bytes(content)
    else:
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    with open_picture(path) as file:
        assert np.array_equal(file.window(0, 0, SIZE[0], 120), whole[:120])
        for top in (350, 351, 350):
            with pytest.raises(InputError, match="damaged or cut short"):
                file.window(300, top, 50, 60)
        assert np.array_equal(file.window(5, 50, 400, 100), whole[50:150, 5:405])
        with pytest.raises(InputError, match="damaged or cut short"):
            for top, strip in file.strips(64):
                assert np.array_equal(strip, whole[top : top + len(strip)])


@pytest.mark.parametrize("name", FILES)
def test_a_cut_file_gives_its_own_pixels_or_an_error(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    whole, content = as_stored(path, name), path.read_bytes()
    refused = 0
    for share in (0.0005, 0.2, 0.5, 0.8, 0.99):
        path.write_bytes(content[: int(len(content) * share)])
        try:
            with open_picture(path) as file:
                for top in (0, 200, 300, 100):
                    assert np.array_equal(file.window(3, top, 400, 111), whole[top : top + 111, 3:403])
        except InputError as error:
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)
            refused += 1
    assert refused >= 3


@pytest.mark.parametrize("name", ["baseline.jpg", "odd-strips.tif", "tiles.tif", "tiles.exr", "rows.exr"])
@pytest.mark.parametrize("cache_bytes", [0, 500_000])
def test_many_threads_read_one_file(tmp_path: Path, name: str, cache_bytes: int) -> None:
    path = written(tmp_path, name)
    whole = read_picture(path).pixels
    with open_picture(path, cache_bytes) as file, ThreadPoolExecutor(6) as pool:

        def right(seed: int) -> bool:
            if seed == 0:
                return all(np.array_equal(strip, whole[top : top + len(strip)]) for top, strip in file.strips(50))
            corners = np.random.default_rng(seed).integers(0, 300, (10, 2)).tolist()
            return all(
                np.array_equal(file.window(left, top, 100, 100), whole[top : top + 100, left : left + 100])
                for left, top in corners
            )

        assert all(pool.map(right, range(6)))


def test_threads_decode_a_block_once_and_all_meet_its_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "tiles.tif")
    content, decoded = bytearray(path.read_bytes()), []
    content[len(content) * 8 // 10 : len(content) * 9 // 10] = bytes(len(content) * 9 // 10 - len(content) * 8 // 10)
    path.write_bytes(content)
    read_part = image_library.read_part

    def counted(*args: Any) -> NDArray[Any]:
        decoded.append(args[3])
        return read_part(*args)

    monkeypatch.setattr(picture_blocks, "read_part", counted)
    with open_picture(path) as file, ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda _: file.window(0, 0, 400, 250), range(12)))
        assert len(decoded) == len(set(decoded)) == 2
        for result in [pool.submit(file.window, 0, 300, SIZE[0], 111) for _ in range(6)]:
            with pytest.raises(InputError, match="damaged"):
                result.result()


def test_a_closed_file_is_not_read(tmp_path: Path) -> None:
    for name in ("eight.png", "tiles.tif"):
        with open_picture(written(tmp_path, name)) as file:
            file.window(0, 0, 10, 10)
            strips = file.strips(64)
            next(strips)
        with pytest.raises(ValueError, match="is closed"):
            file.window(0, 0, 10, 10)
        with pytest.raises(ValueError, match="is closed"):
            next(strips)


def test_a_rectangle_outside_the_picture_is_a_mistake(tmp_path: Path) -> None:
    with open_picture(written(tmp_path, "eight.png")) as file:
        for box in ((-1, 0, 5, 5), (0, 0, 0, 5), (0, 0, 501, 5), (499, 0, 2, 5), (0, 410, 5, 2)):
            with pytest.raises(ValueError, match="not within"):
                file.window(*box)


def test_a_file_replaced_while_it_is_read_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path, "eight.png")
    with open_picture(path, cache_bytes=0) as file:
        file.window(0, 400, 10, 10)
        with_opencv()(tmp_path / "other.png", photograph(3, "uint8"))
        shutil.move(tmp_path / "other.png", path)
        with pytest.raises(InputError, match="replaced"):
            file.window(0, 0, 10, 10)


def big_tiff(path: Path, side: int, tile: int, pixels: NDArray[np.uint8]) -> None:
    """A grey BigTIFF of side x side pixels, every tile of which is the same bytes of the file."""
    count = (side // tile) ** 2
    start = 16 + 8 + 20 * 10 + 8
    tags = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1), (277, 3, 1, 1)]
    tags += [(322, 4, 1, tile), (323, 4, 1, tile), (324, 16, count, start), (325, 16, count, start + 8 * count)]
    head = b"II+\x00" + struct.pack("<HHQQ", 8, 0, 16, len(tags))
    head += b"".join(struct.pack("<HHQQ", *tag) for tag in tags) + bytes(8)
    places = struct.pack("<Q", start + 16 * count) * count + struct.pack("<Q", tile * tile) * count
    path.write_bytes(head + places + pixels.tobytes())
    os.truncate(path, 100_000_000)  # without room on the disk: OpenImageIO takes far less for a forgery


def test_a_picture_too_large_to_be_read_whole_is_read_by_region(tmp_path: Path) -> None:
    tile = np.random.default_rng(0).integers(0, 255, (1024, 1024), np.uint8)
    big_tiff(tmp_path / "x.tif", 200 * 1024, 1024, tile)
    assert picture_size(tmp_path / "x.tif") == (200 * 1024, 200 * 1024)
    with open_picture(tmp_path / "x.tif") as file:
        assert file.size[0] * file.size[1] > MAX_PIXELS
        window = file.window(150 * 1024 - 300, 199 * 1024 - 20, 700, 50)
        assert np.array_equal(window[..., 0], np.roll(tile, (20, 300), (0, 1))[:50, :700])
    with pytest.raises(InputError, match=r"more than|exceeds"):
        read_picture(tmp_path / "x.tif")
    big_tiff(tmp_path / "y.tif", 300 * 1024, 1024, tile)
    with pytest.raises(InputError, match="more than"), open_picture(tmp_path / "y.tif"):
        pass


def test_a_tile_larger_than_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "tiles.tif")
    monkeypatch.setattr("fullsphere.model.resources.available_memory", lambda: 100_000)
    with pytest.raises(ResourceError, match="tiles"), open_picture(path):
        pass


def test_colours_of_an_exr_come_divided_by_alpha(tmp_path: Path) -> None:
    multiplied = np.array([[[0.5, 1.0, 4.0, 0.5], [0.25, 0, 0.5, 1.0], [3.0, 0, 1.0, 0.0]]], np.float16)
    with_library(channelnames=("R", "G", "B", "A"), alpha_channel=3)(tmp_path / "x.exr", multiplied)  # type: ignore[arg-type]
    straight = np.array([[[1.0, 2.0, 8.0, 0.5], [0.25, 0, 0.5, 1.0], [3.0, 0, 1.0, 0.0]]])
    assert np.array_equal(read_picture(tmp_path / "x.exr").pixels, straight)
    with open_picture(tmp_path / "x.exr") as file:
        assert file.dtype == np.float16
        assert np.array_equal(file.window(0, 0, 3, 1), straight)


def test_texts_that_are_not_utf8_are_read_and_faults_that_quote_them_are_told(tmp_path: Path) -> None:
    path = written(tmp_path, "rows.exr")
    content = path.read_bytes()
    assert b"chlist" in content
    path.write_bytes(content.replace(b"chlist", b"\xb5hlist"))
    with pytest.raises(InputError, match="cannot be opened") as error, open_picture(path):
        pass
    assert str(error.value).isprintable()
    for ending in ("exr", "jpg", "tif"):
        latin, dtype = tmp_path / f"latin.{ending}", np.dtype("f2" if ending == "exr" else "u1")
        with open_panorama(latin, (16, 16), 3, dtype, {"Artist": "Jxger & Sxhne"}, overwrite=False) as writer:
            writer.write_rows(0, np.zeros((16, 16, 3), dtype))
        latin.write_bytes(latin.read_bytes().replace(b"Jxger & Sxhne", "Jäger & Söhne".encode("latin-1")))
        assert read_picture(latin).metadata["Artist"] == "Jäger & Söhne"
