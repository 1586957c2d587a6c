"""OpenEXR panoramas: high values kept, colours multiplied by alpha in the file and never seen so outside."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.errors import OutputError, UsageError
from fullsphere.model.image_library import ImageInput
from fullsphere.model.images import check_panorama, gpano, open_panorama, open_picture, read_picture
from fullsphere.model.panorama_writers import PanoramaWriter, TiledWriter
from fullsphere.model.tiled_exr import COMPRESSIONS, LOSSY

SIZE = (700, 550)


def scene(channels: int, dtype: str) -> NDArray[Any]:
    """Smooth, from -1 to 60 000, with alpha of 0 and 1 in the last of 2 or 4 channels."""
    noise = np.random.default_rng(0).random((SIZE[1], SIZE[0], channels), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 5).reshape(noise.shape)
    pixels = np.exp2(40 * (smooth - 0.4)) - 1
    pixels[0, :3, 0] = (60_000, -1, 1e-5)
    if channels in (2, 4):
        pixels[..., -1] = 1
        pixels[100:300, 100:400] = 0
    limited: NDArray[Any] = np.minimum(pixels, 60_000).astype(dtype)
    return limited


def write(path: Path, pixels: NDArray[Any], step: int = 100, **options: Any) -> None:
    options = {"attributes": {}, "overwrite": False, **options}
    with open_panorama(path, (pixels.shape[1], pixels.shape[0]), pixels.shape[2], pixels.dtype, **options) as writer:
        for y0 in range(0, len(pixels), step):
            writer.write_rows(y0, pixels[y0 : y0 + step])


@pytest.mark.parametrize("dtype", ["float16", "float32"])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_a_file_holds_what_was_written(tmp_path: Path, dtype: str, channels: int) -> None:
    pixels = scene(channels, dtype)
    for compression in {*COMPRESSIONS} - {*LOSSY}:
        path = tmp_path / f"{compression}.exr"
        write(path, pixels, 256, compression=compression)
        with open_picture(path) as file:
            assert (file.channels, file.dtype.name, file.linear) == (channels, dtype, True)
            assert np.array_equal(file.window(0, 0, *SIZE), pixels)
        read = read_picture(path).pixels
        assert read.dtype == np.float32
        assert np.array_equal(read[..., [0, 3]] if channels == 2 else read, pixels)


def test_values_that_are_no_numbers_are_kept(tmp_path: Path) -> None:
    pixels = scene(4, "float32")
    pixels[200, 200:203] = [[np.nan, np.inf, -np.inf, 1], [1e30, -0.0, 1e-40, 1], [np.nan, 1, 1, 0]]
    write(tmp_path / "x.exr", pixels)
    pixels[200, 202, :3] = 0  # where nothing was seen there is no colour
    assert np.array_equal(read_picture(tmp_path / "x.exr").pixels, pixels, equal_nan=True)


def test_colours_are_multiplied_by_alpha_in_the_file_only(tmp_path: Path) -> None:
    pixels = scene(4, "float32")
    pixels[..., 3] = np.random.default_rng(0).random(pixels.shape[:2])
    write(tmp_path / "x.exr", pixels)
    reader = ImageInput.open(str(tmp_path / "x.exr"))
    assert reader is not None
    assert reader.spec().channelnames == ("R", "G", "B", "A")
    stored = reader.read_image(0, 0, 0, 4, "float")
    assert stored is not None
    assert np.array_equal(stored[..., :3], pixels[..., :3] * pixels[..., 3:])
    assert np.array_equal(stored[..., 3], pixels[..., 3])
    assert np.allclose(read_picture(tmp_path / "x.exr").pixels, pixels, rtol=1e-6, atol=0)


@pytest.mark.parametrize("compression", LOSSY)
def test_lossy_compression_is_close_and_smaller(tmp_path: Path, compression: str) -> None:
    pixels = scene(3, "float16")[:300]
    write(tmp_path / "exact.exr", pixels)
    write(tmp_path / "lossy.exr", pixels, compression=compression)
    assert (tmp_path / "lossy.exr").stat().st_size < 0.5 * (tmp_path / "exact.exr").stat().st_size
    read = read_picture(tmp_path / "lossy.exr").pixels
    assert np.median(np.abs(read - pixels) / (np.abs(pixels) + 0.1)) < 0.02


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_the_same_picture_is_the_same_bytes_whatever_the_bands(tmp_path: Path, compression: str) -> None:
    pixels = scene(4, "float16")[:300]
    attributes = {"Make": "Acme", "ExposureTime": 0.5}
    for name, step in (("a", 1), ("b", 300)):
        write(tmp_path / f"{name}.exr", pixels, step, compression=compression, attributes=attributes)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert b"capDate" not in (tmp_path / "a.exr").read_bytes()


def test_attributes_keep_their_names(tmp_path: Path) -> None:
    write(tmp_path / "x.exr", scene(3, "float16")[:350], attributes={**gpano((700, 350)), "Exif:FocalLength": 8.0})
    reader = ImageInput.open(str(tmp_path / "x.exr"))
    assert reader is not None
    spec = reader.spec()
    assert spec.getattribute("GPano:ProjectionType") == "equirectangular"
    assert spec.getattribute("GPano:FullPanoWidthPixels") == 700
    assert spec.getattribute("Exif:FocalLength") == 8
    assert (spec.tile_width, spec.tile_height) == (256, 256)


def test_what_the_format_does_not_hold_is_refused_before_the_work() -> None:
    with pytest.raises(UsageError, match=r"float16 or float32 samples, not uint8; write a \.tif"):
        check_panorama(Path("x.exr"), (100, 50), 3, np.uint8)
    with pytest.raises(UsageError, match=r"not float16; write a \.exr"):
        check_panorama(Path("x.tif"), (100, 50), 3, np.float16)
    with pytest.raises(UsageError, match="zip, piz, dwaa, dwab, none"):
        check_panorama(Path("x.exr"), (100, 50), 3, np.float16, "lzw")


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_panorama_leaves_what_was_there(tmp_path: Path, error: type[BaseException]) -> None:
    path, pixels = tmp_path / "x.exr", scene(3, "float16")
    path.write_bytes(b"old")
    with pytest.raises(error), open_panorama(path, SIZE, 3, pixels.dtype, {}, overwrite=True) as writer:
        writer.write_rows(0, pixels[:300])
        raise error
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_file_that_does_not_read_back_is_not_put_in_place(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish = PanoramaWriter.finish

    def finish_and_damage(self: PanoramaWriter) -> None:
        finish(self)
        size = self._temporary.stat().st_size
        with self._temporary.open("r+b") as file:
            file.seek(size - size // 4)
            file.write(bytes(size // 4))

    monkeypatch.setattr(TiledWriter, "finish", finish_and_damage)
    with pytest.raises(OutputError, match="read back"):
        write(tmp_path / "x.exr", scene(3, "float16"), compression=compression)
    assert list(tmp_path.iterdir()) == []


FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
from fullsphere.model.errors import OutputError
from fullsphere.model.images import open_panorama
pixels = np.random.default_rng(0).random((600, 1200, 3), np.float32)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
try:
    with open_panorama(Path(sys.argv[1]), (1200, 600), 3, np.float32, {}, True, compression=sys.argv[2]) as writer:
        writer.write_rows(0, pixels)
    print("written")
except OutputError as error:
    print(str(error).startswith(sys.argv[1]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
@pytest.mark.parametrize(
    ("name", "compression", "limit"),
    [("x.exr", "zip", 100_000), ("x.exr", "none", 8_640_000), ("x.tif", "none", 2_000_000)],
)
def test_a_full_disk_is_an_error_and_leaves_what_was_there(
    tmp_path: Path, name: str, compression: str, limit: int
) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    code = [sys.executable, "-c", FULL_DISK, str(path), compression, str(limit)]
    child = subprocess.run(code, capture_output=True, text=True, timeout=60, check=False)
    assert (child.stdout, child.stderr, child.returncode) == ("True\n", "", 0)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
