"""What a photograph hands on to the pictures made of it, and what viewers are told of a sphere."""

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fullsphere.model.errors import UsageError
from fullsphere.model.exif_block import exif_block
from fullsphere.model.images import carried, gpano, noted_ev, open_panorama, open_picture, read_picture
from fullsphere.model.picture_metadata import CAPTURE_NAMES, Value

CAPTURE: dict[str, Value] = {
    "Make": "Acme & Söhne",
    "Model": "F8",
    "Artist": "A",
    "Copyright": "C",
    "DateTime": "2015:03:16 18:04:35",
    "ExposureTime": 1 / 30,
    "FNumber": 2.8,
    "Exif:DateTimeOriginal": "2015:03:16 17:04:35",
    "Exif:FocalLength": 8.0,
    "Exif:ExposureBiasValue": -0.5,
    "Exif:LensModel": "FC-E8",
    "Exif:PhotographicSensitivity": 200,
    "GPS:LatitudeRef": "N",
    "GPS:Latitude": (50.0, 6.0, 12.5),
    "GPS:LongitudeRef": "E",
    "GPS:Longitude": (14.0, 23.0, 1.25),
    "GPS:AltitudeRef": 0,
    "GPS:Altitude": 210.5,
    "GPS:TimeStamp": (17.0, 4.0, 35.0),
    "GPS:DateStamp": "2015:03:16",
    "GPS:ImgDirectionRef": "T",
    "GPS:ImgDirection": 123.4,
}
LOST_IN_TIFF = {"Exif:PhotographicSensitivity", "GPS:AltitudeRef"}  # by the library that writes it


def written(path: Path, attributes: dict[str, Value], icc_profile: bytes | None = None) -> Path:
    pixels = np.random.default_rng(0).integers(0, 255, (32, 64, 3)).astype("f2" if path.suffix == ".exr" else "u1")
    with open_panorama(path, (64, 32), 3, pixels.dtype, attributes, False, icc_profile) as writer:
        writer.write_rows(0, pixels)
    return path


@pytest.mark.parametrize("ending", [".tif", ".exr", ".png", ".jpg"])
def test_what_the_camera_noted_comes_back_from_every_format(tmp_path: Path, ending: str) -> None:
    assert set(CAPTURE) == set(CAPTURE_NAMES)
    attributes, _ = carried(CAPTURE, None, 3)
    for turn in ("first.", "second."):  # what was carried once is carried again
        path = written(tmp_path / (turn + ending[1:]), {**attributes, **gpano((64, 32))})
        picture = read_picture(path)
        assert picture.orientation == 1
        assert set(picture.metadata) == set(CAPTURE) - (LOST_IN_TIFF if ending == ".tif" else set())
        for name, value in picture.metadata.items():
            assert value == (CAPTURE[name] if isinstance(value, str) else pytest.approx(CAPTURE[name], rel=1e-6)), name
        with open_picture(path) as file:
            assert file.metadata == picture.metadata
        attributes, _ = carried(picture.metadata, None, 3)


def exiftool(path: Path, *tags: str) -> dict[str, Any]:
    run = subprocess.run(["exiftool", "-json", "-n", *tags, str(path)], check=True, capture_output=True)
    (told,) = json.loads(run.stdout)
    del told["SourceFile"]
    return dict(told)


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")
@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg"])
def test_exiftool_reads_the_place_and_the_exposure(tmp_path: Path, ending: str) -> None:
    attributes, _ = carried(CAPTURE, None, 3)
    path = written(tmp_path / f"x{ending}", attributes)
    told = exiftool(path, "-GPSLatitude", "-GPSLongitude", "-GPSAltitude", "-GPSDateTime", "-Orientation", "-FNumber")
    assert told.pop("GPSDateTime") == "2015:03:16 17:04:35Z"
    assert told.pop("GPSLatitude") == pytest.approx(50 + 6 / 60 + 12.5 / 3600)
    assert told.pop("GPSLongitude") == pytest.approx(14 + 23 / 60 + 1.25 / 3600)
    assert told == {"GPSAltitude": 210.5, "Orientation": 1, "FNumber": pytest.approx(2.8)}
    assert exiftool(path, "-ExposureCompensation") == {"ExposureCompensation": -0.5}
    if ending != ".tif":  # the library that writes a TIFF leaves out what EXIF wants in it
        assert not {"Error", "ExifTool:Error"} & set(exiftool(path, "-validate", "-error"))


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg", ".exr"])
def test_below_the_sea_is_never_above_it(tmp_path: Path, ending: str) -> None:
    path = written(tmp_path / f"x{ending}", {"GPS:Altitude": 12.0, "GPS:AltitudeRef": 1})
    metadata = read_picture(path).metadata
    assert "GPS:Altitude" not in metadata or metadata["GPS:AltitudeRef"] == 1


def test_what_exif_has_no_place_for_is_left_out() -> None:
    assert exif_block({}) == b""
    assert exif_block({"Unknown": 1, "GPano:ProjectionType": "x"}) == b""
    odd: dict[str, Value] = {
        "ExposureTime": -1.0,
        "FNumber": float("nan"),
        "Exif:FocalLength": float("inf"),
        "Exif:PhotographicSensitivity": 100_000,
        "GPS:Latitude": (1.0, 2.0),
        "GPS:Altitude": 1e30,
        "GPS:AltitudeRef": "below",
        "Exif:ExposureBiasValue": "?",
    }
    assert exif_block(odd) == b""
    assert b"100/1" not in exif_block({"Make": "x\x00y"})
    assert b"xy\x00" in exif_block({"Make": "x\x00y"})


@pytest.mark.parametrize("ending", [".tif", ".png", ".jpg", ".exr"])
def test_each_attribute_can_be_written_alone(tmp_path: Path, ending: str) -> None:
    for number, (name, value) in enumerate(CAPTURE.items()):
        metadata = read_picture(written(tmp_path / f"{number}{ending}", {name: value})).metadata
        assert set(metadata) == {name} - (LOST_IN_TIFF if ending == ".tif" else set())


def test_attributes_that_are_not_what_their_name_says_are_not_read(tmp_path: Path) -> None:
    odd: dict[str, Value] = {"ExposureTime": "soon", "GPS:Latitude": "north", "Make": 7, "GPS:Longitude": (1.0, 2.0)}
    odd |= {"GPS:TimeStamp": (1.0, float("nan"), 2.0), "FNumber": float("inf"), "GPS:Altitude": (1.0, 2.0, 3.0)}
    assert read_picture(written(tmp_path / "x.exr", {**odd, "Model": "F8"})).metadata == {"Model": "F8"}


@pytest.mark.parametrize("seconds", [1 / 8000, 1 / 32_000, 0.3, 30.0, 3600.0, 1e-6])
def test_exposure_times_are_kept_to_a_thousandth(tmp_path: Path, seconds: float) -> None:
    found = read_picture(written(tmp_path / "x.jpg", {"ExposureTime": seconds})).metadata["ExposureTime"]
    assert found == pytest.approx(seconds, rel=1e-3)


def test_metadata_too_long_for_a_jpeg_are_an_error(tmp_path: Path) -> None:
    from fullsphere.model.errors import OutputError

    with pytest.raises(OutputError, match="fit"):
        written(tmp_path / "x.jpg", {"Copyright": "c" * 70_000})
    assert list(tmp_path.iterdir()) == []


def test_a_profile_goes_where_it_describes_the_samples() -> None:
    rgb, grey, cmyk = (bytes(16) + space + bytes(108) for space in (b"RGB ", b"GRAY", b"CMYK"))
    assert [carried({}, rgb, channels)[1] for channels in (1, 2, 3, 4)] == [None, None, rgb, rgb]
    assert [carried({}, grey, channels)[1] for channels in (1, 2, 3, 4)] == [grey, grey, None, None]
    assert carried({}, cmyk, 3)[1] is None
    assert carried({}, rgb, 3, same_samples=False)[1] is None
    assert carried({}, None, 3)[1] is None
    assert carried({"Orientation": 6, "Make": "A"}, None, 3)[0]["Orientation"] == 1


def test_a_window_of_the_sphere_says_where_it_lies() -> None:
    fields = gpano((3600, 1800), (900, 300, 1800, 900))  # longitudes from -90, latitudes down from 60, 10 px a degree
    assert {name.removeprefix("GPano:"): value for name, value in fields.items() if name.endswith("Pixels")} == {
        "FullPanoWidthPixels": 3600,
        "FullPanoHeightPixels": 1800,
        "CroppedAreaImageWidthPixels": 1800,
        "CroppedAreaImageHeightPixels": 900,
        "CroppedAreaLeftPixels": 900,
        "CroppedAreaTopPixels": 300,
    }
    assert gpano((3600, 1800), (0, 0, 3600, 1800)) == gpano((3600, 1800))
    for window in ((-1, 0, 10, 10), (3595, 0, 10, 10), (0, 1795, 10, 10), (0, 0, 0, 10), (0, 0, 10, -1)):
        with pytest.raises(UsageError, match="no part"):
            gpano((3600, 1800), window)
    with pytest.raises(UsageError, match="twice"):
        gpano((1000, 501))


def test_the_exposure_that_was_noted_counts_in_ev() -> None:
    noted = {"ExposureTime": 1 / 50, "FNumber": 4.0, "Exif:PhotographicSensitivity": 200.0}
    ev = noted_ev(noted)
    assert ev is not None
    assert ev == pytest.approx(math.log2(1 / 50 * 2 / 16))
    assert noted_ev({**noted, "ExposureTime": 1 / 25}) == pytest.approx(ev + 1)
    assert noted_ev({**noted, "FNumber": 8.0}) == pytest.approx(ev - 2)
    assert noted_ev({**noted, "Exif:PhotographicSensitivity": 100.0}) == pytest.approx(ev - 1)
    for name in noted:
        assert noted_ev({key: value for key, value in noted.items() if key != name}) is None
        assert noted_ev({**noted, name: 0.0}) is None
