"""A picture file read by region gives what the picture in memory gives, window by window."""

import math
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model import source_windows
from fullsphere.model.camera import Camera, Projection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.image_library import ImageOutput, ImageSpec
from fullsphere.model.lens import Perspective
from fullsphere.model.picture_file import PictureFile, open_picture
from fullsphere.model.remap import Interpolation, Remapper
from fullsphere.model.surface import Cylindrical, Equirectangular
from fullsphere.model.workers import thread_pool
from laws import fisheye, rotation

VIEW = Camera(Perspective(110.0), (160, 120), (79.5, 59.5), half_fov=math.radians(55))


def looking(yaw_deg: float, pitch_deg: float) -> NDArray[np.float64]:
    """The rotation from the source's frame to a view that is turned."""
    a, b = math.radians(yaw_deg), math.radians(pitch_deg)
    yaw = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    return np.asarray((yaw @ pitch).T)


JOBS: dict[str, tuple[Projection, Projection, NDArray[np.float64]]] = {
    "fisheye to sphere": (fisheye(420), Equirectangular((600, 300)), rotation(1)),
    "fisheye to small sphere": (fisheye(420), Equirectangular((120, 60)), rotation(2)),
    "wide pixels": (fisheye(420, 95, 0.7), Equirectangular((300, 150)), rotation(3)),
    "view": (
        Camera(Perspective(300.0), (420, 300), (209.5, 149.5), half_fov=1.0),
        Equirectangular((400, 200)),
        np.eye(3),
    ),
    "sphere, front": (Equirectangular((640, 320)), VIEW, looking(10, 5)),
    "sphere, seam": (Equirectangular((640, 320)), VIEW, looking(178, 5)),
    "sphere, zenith": (Equirectangular((640, 320)), VIEW, looking(30, 89)),
    "sphere, nadir": (Equirectangular((640, 320)), VIEW, looking(30, -88)),
    "sphere to small fisheye": (Equirectangular((640, 320)), fisheye(60, 95), rotation(4)),
    "round a cylinder": (Cylindrical((640, 200)), VIEW, looking(175, 0)),
    "window of a sphere": (Equirectangular((500, 200), (-1.0, 1.0), (-0.4, 0.4)), VIEW, looking(20, 10)),
    "cube to sphere": (CubeMap(110), Equirectangular((300, 150)), rotation(5)),
}
every_job = pytest.mark.parametrize("job", JOBS)


@pytest.fixture
def by_region(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """Every picture file is too large to be read whole."""
    monkeypatch.setattr(import_module("fullsphere.model.remap"), "_WHOLE_BYTES", 0)
    yield monkeypatch


def picture(size: tuple[int, int], channels: int, dtype: Any) -> NDArray[Any]:
    rng = np.random.default_rng(0)
    if np.dtype(dtype).kind == "u":
        return rng.integers(0, np.iinfo(dtype).max, (size[1], size[0], channels), dtype, endpoint=True)
    light: NDArray[Any] = rng.uniform(0, 2, (size[1], size[0], channels)).astype(dtype)
    return light


def written(folder: Path, kind: str, pixels: NDArray[Any]) -> Path:
    """A file of tiles (TIFF, OpenEXR) or of rows (PNG)."""
    names = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
    spec = ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], names[pixels.dtype.name])
    spec.attribute("Exif:ColorSpace", 1)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("compression", "zip")
    if kind != "png":
        spec.tile_width = spec.tile_height = 64
    path = folder / f"source.{kind}"
    output = ImageOutput.create(kind)
    assert output is not None
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(pixels))
    output.close()
    output.geterror()
    return path


def assert_as_in_memory(found: tuple[NDArray[Any], NDArray[Any]], expected: tuple[NDArray[Any], NDArray[Any]]) -> None:
    """The same weight; the same samples but for rare ones, as positions are rounded otherwise where a window begins."""
    np.testing.assert_array_equal(found[1], expected[1])
    one, other = found[0].astype(float), expected[0].astype(float)
    assert found[0].dtype == expected[0].dtype
    assert found[0].shape == expected[0].shape
    top = np.iinfo(found[0].dtype).max if found[0].dtype.kind == "u" else 4.0
    step = {"uint8": 1.0, "uint16": 1.0, "float16": 2.0**-9, "float32": 0.0}[found[0].dtype.name]
    assert np.abs(one - other).max() <= max(2e-4 * top, step)
    assert np.mean(np.abs(one - other) > max(2e-5 * top, 0.99 * step * (top != 65535))) < 2e-3


@pytest.mark.parametrize(
    ("kind", "interpolation", "antialias"),
    [("tif", "linear", True), ("png", "lanczos3", True), ("tif", "cubic", False)],
)
@every_job
def test_windows_of_a_file_are_the_picture(
    job: str, kind: str, interpolation: Interpolation, antialias: bool, tmp_path: Path, by_region: pytest.MonkeyPatch
) -> None:
    source, target, turn = JOBS[job]
    pixels = picture(source.size, 3, np.uint8)
    remapper = Remapper(source, target, turn, interpolation, antialias=antialias)
    expected = remapper(pixels)
    assert expected[1].any()
    with open_picture(written(tmp_path, kind, pixels)) as file:
        assert_as_in_memory(remapper(file), expected)
        bands = list(remapper.bands(file))
    whole = np.concatenate([band.pixels for band in bands]), np.concatenate([band.weight for band in bands])
    assert_as_in_memory(whole, expected)


@pytest.mark.parametrize(("window_bytes", "interpolation"), [(1, "cubic"), (4_000, "lanczos3")])
@every_job
def test_tiles_are_split_until_their_windows_fit(
    job: str, interpolation: Interpolation, window_bytes: int, tmp_path: Path, by_region: pytest.MonkeyPatch
) -> None:
    """Down to a single pixel of the target, whose window is read however large it is."""
    source, target, turn = JOBS[job]
    if window_bytes == 1:
        target = fisheye(14, 95)
    by_region.setattr(source_windows, "WINDOW_BYTES", window_bytes)
    pixels = picture(source.size, 3, np.uint8)
    remapper = Remapper(source, target, turn, interpolation)
    with open_picture(written(tmp_path, "tif", pixels)) as file:
        assert_as_in_memory(remapper(file), remapper(pixels))


@pytest.mark.parametrize(
    ("kind", "dtype", "channels"),
    [
        ("tif", np.uint8, 1),
        ("tif", np.uint8, 4),
        ("tif", np.uint16, 4),
        ("tif", np.uint16, 3),
        ("tif", np.float32, 3),
        ("exr", np.float16, 3),
        ("png", np.uint16, 3),
    ],
)
@pytest.mark.parametrize("job", ["fisheye to small sphere", "sphere, seam"])
def test_every_kind_of_sample(
    job: str, kind: str, dtype: Any, channels: int, tmp_path: Path, by_region: pytest.MonkeyPatch
) -> None:
    source, target, turn = JOBS[job]
    pixels = picture(source.size, channels, dtype)
    if channels in (2, 4):
        pixels[..., -1] |= np.dtype(dtype).type(np.iinfo(dtype).max // 2 + 1)
    for linear_light in (False, True):
        remapper = Remapper(source, target, turn, linear_light=linear_light)
        with open_picture(written(tmp_path, kind, pixels)) as file:
            assert (file.dtype, file.channels) == (np.dtype(dtype), channels)
            memory = file.window(0, 0, *file.size)
            found = remapper(file)
        assert_as_in_memory(found, remapper(memory))


@pytest.mark.parametrize("job", ["fisheye to sphere", "sphere, zenith", "sphere, seam"])
def test_threads_change_no_byte_of_a_file(job: str, tmp_path: Path, by_region: pytest.MonkeyPatch) -> None:
    source, target, turn = JOBS[job]
    with open_picture(written(tmp_path, "tif", picture(source.size, 3, np.uint8)), 100_000) as file:
        alone = Remapper(source, target, turn)(file)
        for threads in (2, 5):
            with thread_pool(threads) as pool:
                found = Remapper(source, target, turn, executor=pool, kept_bytes=200_000)(file)
            np.testing.assert_array_equal(found[0], alone[0])
            np.testing.assert_array_equal(found[1], alone[1])


def test_only_the_part_that_is_seen_is_read(tmp_path: Path, by_region: pytest.MonkeyPatch) -> None:
    source = Equirectangular((640, 320))
    narrow = Camera(Perspective(300.0), (60, 60), (29.5, 29.5), half_fov=math.radians(9))
    read = []
    window = PictureFile.window

    def noted(self: PictureFile, left: int, top: int, width: int, height: int) -> NDArray[Any]:
        read.append((left, top, left + width, top + height))
        return window(self, left, top, width, height)

    by_region.setattr(PictureFile, "window", noted)
    with open_picture(written(tmp_path, "tif", picture(source.size, 3, np.uint8))) as file:
        Remapper(source, narrow)(file)
    left, top, right, bottom = np.array(read).T
    assert left.min() > 290
    assert right.max() < 350
    assert top.min() > 130
    assert bottom.max() < 190


def test_a_file_that_fits_is_read_whole_and_is_the_same_bytes(tmp_path: Path) -> None:
    for job in ("fisheye to sphere", "sphere, zenith", "cube to sphere"):
        source, target, turn = JOBS[job]
        pixels = picture(source.size, 3, np.uint8)
        with open_picture(written(tmp_path, "tif", pixels)) as file:
            found = Remapper(source, target, turn)(file)
        np.testing.assert_array_equal(found[0], Remapper(source, target, turn)(pixels)[0])


def test_a_source_of_40000_columns_by_region(tmp_path: Path, by_region: pytest.MonkeyPatch) -> None:
    source = Equirectangular((40_000, 100), (-math.pi, math.pi), (-0.008, 0.008))
    target = Equirectangular((900, 40), (math.pi - 0.05, math.pi + 0.05), (-0.003, 0.003))
    pixels = picture(source.size, 3, np.uint8)
    remapper = Remapper(source, target)
    with open_picture(written(tmp_path, "tif", pixels)) as file:
        assert_as_in_memory(remapper(file), remapper(pixels))
