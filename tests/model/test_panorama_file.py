"""Writing panoramas: whole, checked, in place; or an error, and nothing left behind."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.errors import OutputError, ResourceError, UsageError
from fullsphere.model.images import (
    PanoramaWriter,
    check_panorama,
    gpano,
    open_panorama,
    open_picture,
    picture_size,
    read_picture,
)
from fullsphere.model.panorama_writers import StreamWriter, TiledWriter

SIZE = (1100, 550)  # neither side a multiple of a tile's


def panorama(channels: int, dtype: type, seed: int = 0) -> NDArray[np.generic]:
    noise = np.random.default_rng(seed).random((SIZE[1], SIZE[0], channels))
    return (noise * (np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 3)).astype(dtype)


def write(path: Path, pixels: NDArray[np.generic], step: int = 100, **options: object) -> None:
    size = (pixels.shape[1], pixels.shape[0])
    options = {"attributes": {}, "overwrite": False, **options}
    with open_panorama(path, size, pixels.shape[2], pixels.dtype, **options) as writer:  # type: ignore[arg-type]
        for y0 in range(0, len(pixels), step):
            writer.write_rows(y0, pixels[y0 : y0 + step])


@pytest.mark.parametrize("step", [1, 100, 256, 550])
def test_a_tiff_holds_what_was_written_whatever_the_bands(tmp_path: Path, step: int) -> None:
    pixels = panorama(4, np.uint16)
    write(tmp_path / "x.tif", pixels, step)
    assert np.array_equal(read_picture(tmp_path / "x.tif").pixels, pixels)


@pytest.mark.parametrize("ending", [".tif", ".TIFF", ".png"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_lossless_formats_hold_what_was_written(tmp_path: Path, ending: str, dtype: type, channels: int) -> None:
    pixels = panorama(channels, dtype)[:300]
    if ending == ".png" and dtype is np.float32:
        with pytest.raises(UsageError, match=r"\.tif"):
            write(tmp_path / f"x{ending}", pixels)
        return
    write(tmp_path / f"x{ending}", pixels)
    read = read_picture(tmp_path / f"x{ending}").pixels
    assert read.dtype == pixels.dtype
    assert np.array_equal(read, pixels[..., [0, 0, 0, 1]] if channels == 2 else pixels)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_a_jpeg_is_close_and_has_no_alpha(tmp_path: Path, channels: int) -> None:
    ramp = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].transpose(1, 2, 0) * 255 // 1100
    pixels = np.dstack([ramp, 255 - ramp])[..., :channels].astype(np.uint8)
    write(tmp_path / "x.jpeg", pixels)
    read = read_picture(tmp_path / "x.jpeg").pixels
    colours = 1 if channels < 3 else 3
    assert read.shape[2] == colours
    assert np.abs(read.astype(int) - pixels[..., :colours]).max() <= 6  # of a smooth picture, at quality 95


@pytest.mark.parametrize(("ending", "compressions"), [(".tif", ("lzw", "zip", "none")), (".png", ("zip", "none"))])
def test_every_compression_holds_the_same_pixels(tmp_path: Path, ending: str, compressions: tuple[str, ...]) -> None:
    pixels = np.cumsum(panorama(3, np.uint8) // 100, axis=1, dtype=np.uint8)
    sizes = []
    for compression in (None, *compressions):
        path = tmp_path / f"{compression}{ending}"
        write(path, pixels, compression=compression)
        assert np.array_equal(read_picture(path).pixels, pixels)
        sizes.append(path.stat().st_size)
    assert sizes[0] == sizes[1]
    assert sizes[-1] > pixels.nbytes
    assert all(size < 0.7 * pixels.nbytes for size in sizes[:-1])


def test_a_jpeg_has_the_quality_that_is_asked_for(tmp_path: Path) -> None:
    pixels = panorama(3, np.uint8)  # white noise, of which most is lost
    sizes = []
    for quality in ("1", "30", "60", "90", "100"):
        write(tmp_path / f"{quality}.jpg", pixels, compression=quality)
        sizes.append((tmp_path / f"{quality}.jpg").stat().st_size)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 5 * sizes[0]
    write(tmp_path / "x.jpg", pixels)
    write(tmp_path / "95.jpg", pixels, compression="95")
    assert (tmp_path / "x.jpg").read_bytes() == (tmp_path / "95.jpg").read_bytes()


@pytest.mark.parametrize(
    ("name", "compression", "known"),
    [
        ("x.tif", "piz", "zip, lzw, none"),
        ("x.tif", "", "zip, lzw, none"),
        ("x.png", "lzw", "zip, none"),
        ("x.jpg", "zip", "1 to 100"),
        ("x.jpg", "0", "1 to 100"),
        ("x.jpg", "101", "1 to 100"),
    ],
)
def test_an_unknown_compression_is_refused_with_the_known_ones(name: str, compression: str, known: str) -> None:
    with pytest.raises(UsageError, match=known):
        check_panorama(Path(name), (100, 50), 3, np.uint8, compression)


def test_the_same_panorama_is_the_same_bytes(tmp_path: Path) -> None:
    # many tiles, so that threads of the library, if it used them, would meet
    pixels = np.tile(panorama(3, np.uint8), (2, 2, 1))
    size = (pixels.shape[1], pixels.shape[0])
    for ending in (".tif", ".png", ".jpg"):
        for name, step in (("a", 100), ("b", 550)):
            write(tmp_path / f"{name}{ending}", pixels, step, attributes=gpano(size))
        content = (tmp_path / f"a{ending}").read_bytes()
        assert (tmp_path / f"b{ending}").read_bytes() == content
        assert time.strftime("%Y:%m").encode() not in content  # the day, as metadata spell it


def test_a_tiff_is_tiled_and_says_that_its_alpha_is_straight(tmp_path: Path) -> None:
    if shutil.which("exiftool") is None:
        pytest.skip("exiftool is not installed")
    write(tmp_path / "x.tif", panorama(4, np.uint8))
    told = exiftool(tmp_path / "x.tif", "-TileWidth", "-ExtraSamples", "-Compression")
    assert told["TileWidth"] == 256
    assert told["ExtraSamples"] == "Unassociated Alpha"
    assert told["Compression"] == "LZW"


def exiftool(path: Path, *tags: str) -> dict[str, object]:
    run = subprocess.run(["exiftool", "-json", *tags, str(path)], check=True, capture_output=True)
    (told,) = json.loads(run.stdout)
    del told["SourceFile"]
    return dict(told)


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")
@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg"])
def test_exiftool_reads_the_gpano_fields_and_the_capture_data(tmp_path: Path, ending: str) -> None:
    capture = {
        "Make": 'A&"<B>',
        "ExposureTime": 1 / 30,
        "Exif:FocalLength": 8.0,
        "Exif:DateTimeOriginal": "2015:03:16 17:04:35",
    }
    path = tmp_path / f"x{ending}"
    write(path, panorama(3, np.uint8), attributes={**gpano(SIZE), **capture})
    told = exiftool(path, "-XMP-GPano:all")
    assert told.pop("StitchingSoftware").startswith("fullsphere ")  # type: ignore[attr-defined]
    assert told == {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": True,
        "FullPanoWidthPixels": 1100,
        "FullPanoHeightPixels": 550,
        "CroppedAreaImageWidthPixels": 1100,
        "CroppedAreaImageHeightPixels": 550,
        "CroppedAreaLeftPixels": 0,
        "CroppedAreaTopPixels": 0,
    }
    assert exiftool(path, "-Make", "-ExposureTime", "-FocalLength", "-DateTimeOriginal") == {
        "Make": 'A&"<B>',
        "ExposureTime": "1/30",
        "FocalLength": "8.0 mm",
        "DateTimeOriginal": "2015:03:16 17:04:35",
    }


def test_gpano_is_for_full_spheres_only() -> None:
    with pytest.raises(UsageError, match="twice"):
        gpano((1000, 501))


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg"])
def test_the_colour_profile_is_carried(tmp_path: Path, ending: str) -> None:
    profile = minimal_profile()
    write(tmp_path / f"x{ending}", panorama(3, np.uint8), icc_profile=profile)
    assert read_picture(tmp_path / f"x{ending}").icc_profile == profile


def minimal_profile() -> bytes:
    """A display profile with the sRGB primaries and gamma 2.2; 70 kB, more than one JPEG segment takes."""

    def xyz(*values: float) -> bytes:
        return b"XYZ \x00\x00\x00\x00" + b"".join(round(v * 65536).to_bytes(4, "big", signed=True) for v in values)

    tags = {
        b"wtpt": xyz(0.9642, 1, 0.8249),
        b"rXYZ": xyz(0.4361, 0.2225, 0.0139),
        b"gXYZ": xyz(0.3851, 0.7169, 0.0971),
        b"bXYZ": xyz(0.1431, 0.0606, 0.7141),
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"curv\x00\x00\x00\x00\x00\x00\x00\x01\x02\x33\x00\x00"),
        b"desc": b"desc\x00\x00\x00\x00\x00\x00\x00\x02x\x00" + bytes(78),
        b"cprt": b"text\x00\x00\x00\x00" + b"c" * 70_000 + b"\x00",
    }
    table, body, place = b"", b"", 128 + 4 + 12 * len(tags)
    for name, content in tags.items():
        content += bytes(-len(content) % 4)
        table += name + (place + len(body)).to_bytes(4, "big") + len(content).to_bytes(4, "big")
        body += content
    size = (place + len(body)).to_bytes(4, "big")
    head = size + bytes(4) + b"\x02\x10\x00\x00mntrRGB XYZ " + bytes(12) + b"acsp" + bytes(28)
    head += b"".join(round(v * 65536).to_bytes(4, "big") for v in (0.9642, 1, 0.8249)) + bytes(48)
    return head + len(tags).to_bytes(4, "big") + table + body


@pytest.mark.parametrize(
    ("name", "size", "channels", "dtype", "said"),
    [
        ("x.webp", (100, 50), 3, np.uint8, ".tif, .tiff, .exr, .png"),
        ("x", (100, 50), 3, np.uint8, "ending"),
        ("x.jpg", (70_000, 35_000), 3, np.uint8, "65500"),
        ("x.jpg", (100, 50), 3, np.uint16, "uint8 samples"),
        ("x.tif", (1 << 21, 1 << 20), 3, np.uint8, "side"),
        ("x.tif", (0, 50), 3, np.uint8, "side"),
        ("x.tif", (100, 50), 5, np.uint8, "channels"),
        ("x.tif", (100, 50), 3, np.int32, "samples"),
    ],
)
def test_what_no_format_holds_is_a_usage_error(
    name: str, size: tuple[int, int], channels: int, dtype: type, said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        check_panorama(Path(name), size, channels, dtype)


def test_room_is_asked_for_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="free"):
        check_panorama(tmp_path / "x.tif", (1 << 20, 1 << 19), 4, np.float32)
    check_panorama(tmp_path / "x.tif", (4000, 2000), 3, np.uint8)


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg"])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_panorama_leaves_what_was_there(tmp_path: Path, ending: str, error: type[BaseException]) -> None:
    path, pixels = tmp_path / f"x{ending}", panorama(3, np.uint8)
    path.write_bytes(b"old")
    with pytest.raises(error), open_panorama(path, SIZE, 3, np.uint8, {}, overwrite=True) as writer:
        writer.write_rows(0, pixels[:300])
        raise error
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", [".tif", ".png"])
def test_rows_that_are_missing_out_of_order_or_of_another_kind(tmp_path: Path, ending: str) -> None:
    pixels = panorama(3, np.uint8)
    for rows in ([(0, pixels[:549])], [(1, pixels[:10])], [(0, pixels[:10]), (11, pixels[:10])], [(0, pixels[:, 1:])]):
        with (
            pytest.raises(ValueError, match="rows"),
            open_panorama(tmp_path / f"x{ending}", SIZE, 3, np.uint8, {}, overwrite=False) as writer,
        ):
            for y0, part in rows:
                writer.write_rows(y0, part)
    with (
        pytest.raises(ValueError, match="uint16"),
        open_panorama(tmp_path / f"x{ending}", SIZE, 3, np.uint8, {}, overwrite=False) as writer,
    ):
        writer.write_rows(0, pixels.astype(np.uint16))
    assert list(tmp_path.iterdir()) == []


FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
from fullsphere.model.errors import OutputError
from fullsphere.model.images import open_panorama
pixels = np.random.default_rng(0).integers(0, 255, (600, 1200, 3), np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
for name in ("x.tif", "x.png", "x.jpg"):
    try:
        with open_panorama(Path(sys.argv[1]) / name, (1200, 600), 3, np.uint8, {}, overwrite=True) as writer:
            writer.write_rows(0, pixels)
        print(name, "written")
    except OutputError as error:
        print(name, str(error).startswith(sys.argv[1]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_is_an_error_and_leaves_what_was_there(tmp_path: Path) -> None:
    names = ["x.tif", "x.png", "x.jpg"]
    for name in names:
        (tmp_path / name).write_bytes(b"old")
    child = subprocess.run([sys.executable, "-c", FULL_DISK, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert child.stdout.splitlines() == [f"{name} True" for name in names]
    assert child.stderr == ""
    assert child.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert all((tmp_path / name).read_bytes() == b"old" for name in names)


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg"])
def test_a_file_that_does_not_read_back_is_not_put_in_place(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer_class = TiledWriter if ending == ".tif" else StreamWriter
    finish = PanoramaWriter.finish

    def finish_and_damage(self: PanoramaWriter) -> None:
        finish(self)
        with self._temporary.open("r+b") as file:
            file.seek(-20_000, 2)
            file.write(bytes(1000))

    monkeypatch.setattr(writer_class, "finish", finish_and_damage)
    with pytest.raises(OutputError, match="read back"):
        write(tmp_path / f"x{ending}", panorama(3, np.uint8))
    assert list(tmp_path.iterdir()) == []


MORE_THAN_4_GB = """
import resource, sys
from pathlib import Path
import numpy as np
from fullsphere.model.images import open_panorama
size = (46340, 23170)
with open_panorama(Path(sys.argv[1]), size, 4, np.uint8, {}, False, compression="none") as writer:
    for y0 in range(0, size[1], 256):
        rows = np.empty((min(256, size[1] - y0), size[0], 4), np.uint8)
        rows[:] = (np.arange(len(rows)) + y0)[:, None, None] % 251
        writer.write_rows(y0, rows)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="measures memory")
def test_a_gigapixel_is_written_out_of_core_as_a_big_tiff(tmp_path: Path) -> None:
    path = tmp_path / "x.tif"
    child = subprocess.run([sys.executable, "-c", MORE_THAN_4_GB, str(path)], capture_output=True, text=True)
    assert child.stderr == ""
    assert int(child.stdout) < 500  # MB: the libraries, and some bands of 47 MB
    with path.open("rb") as file:
        assert file.read(4) in (b"II+\x00", b"MM\x00+")
    assert path.stat().st_size > 1 << 32
    with open_picture(path) as file:
        assert file.size == (46340, 23170)
        assert np.array_equal(file.window(46000, 23000, 340, 170)[:, 7, 2], np.arange(23000, 23170) % 251)


def test_a_missing_folder_and_an_existing_file(tmp_path: Path) -> None:
    pixels = panorama(1, np.uint8)[:10]
    with pytest.raises(OutputError, match="does not exist"):
        write(tmp_path / "no" / "x.tif", pixels)
    (tmp_path / "x.tif").write_bytes(b"old")
    with pytest.raises(OutputError, match="--overwrite"):
        write(tmp_path / "x.tif", pixels)
    write(tmp_path / "x.tif", pixels, overwrite=True)
    assert picture_size(tmp_path / "x.tif") == (1100, 10)
