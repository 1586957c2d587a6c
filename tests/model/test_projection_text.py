"""Projections as texts: each spelling gives what it says, and what is none is refused by the part that is wrong."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fullsphere.model.camera import Camera, FastProjection
from fullsphere.model.cube_map import CubeMap
from fullsphere.model.errors import InputError, UsageError
from fullsphere.model.lens import Equidistant, Equisolid, Orthographic, Perspective, Stereographic, Thoby
from fullsphere.model.projection_help import PROJECTIONS_HELP
from fullsphere.model.projection_text import parse_projection
from fullsphere.model.store import save_camera
from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator, Mosaic360
from laws import fisheye, pixel_rays

RAD = math.pi / 180


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("equirectangular:8192", Equirectangular((8192, 4096))),
        ("equirectangular:8192x4096", Equirectangular((8192, 4096))),
        (
            "equirectangular:4000x1000:lon=-90..90:lat=-20..25",
            Equirectangular((4000, 1000), (-90 * RAD, 90 * RAD), (-20 * RAD, 25 * RAD)),
        ),
        ("equirectangular:3600:lat=-20..25.5", Equirectangular((3600, 455), latitudes=(-20 * RAD, 25.5 * RAD))),
        ("equirectangular:100x50:lon=170..+190.", Equirectangular((100, 50), (170 * RAD, 190 * RAD))),
        ("cylindrical:4000x1000", Cylindrical((4000, 1000))),
        ("cylindrical:4000x1000:hfov=180:lat=-20..45", Cylindrical((4000, 1000), math.pi, (-20 * RAD, 45 * RAD))),
        ("cylindrical:3142:hfov=180:lat=-45..45", Cylindrical((3142, 2000), math.pi, (-45 * RAD, 45 * RAD))),
        ("mercator:4000x1000:hfov=300", Mercator((4000, 1000), 300 * RAD)),
        ("360x360:512", Mosaic360((512, 512))),
        ("360x360:512x300", Mosaic360((512, 300))),
        ("cube:64", CubeMap(64)),
        ("cube:64:layout=strip", CubeMap(64, "strip")),
        ("cube:64:layout=vertical-cross", CubeMap(64, "vertical-cross")),
    ],
)
def test_surfaces(text: str, expected: Equirectangular) -> None:
    placed = parse_projection(text)
    np.testing.assert_array_equal(placed.world_from_projection, np.eye(3))
    assert type(placed.projection) is type(expected)
    assert placed.projection.size == expected.size
    width, height = expected.size
    window = slice(0, width, 1), slice(height // 2, height // 2 + 1)
    assert isinstance(placed.projection, FastProjection)
    found = placed.projection.window_rays(*window)
    np.testing.assert_allclose(found, expected.window_rays(*window), rtol=0, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize(
    ("text", "lens", "at", "angle_deg"),
    [
        ("perspective:1920x1080:hfov=90", Perspective, (1919.5, 539.5), 45),
        ("perspective:1920x1080:vfov=60", Perspective, (959.5, 1079.5), 30),
        ("perspective:1920x1080:dfov=100", Perspective, (1919.5, 1079.5), 50),
        ("perspective:500:hfov=179.5", Perspective, (499.5, 249.5), 89.75),
        ("stereographic:2048:hfov=300", Stereographic, (2047.5, 1023.5), 150),
        ("stereographic:2048x1024:fov=300", Stereographic, (1023.5, 1023.5), 150),
        ("equidistant:3000x3000:fov=183", Equidistant, (2999.5, 1499.5), 91.5),
        ("equidistant:3000x2000:dfov=180", Equidistant, (2999.5, 1999.5), 90),
        ("equisolid:800:vfov=200", Equisolid, (399.5, 799.5), 100),
        ("orthographic:800x600:vfov=180", Orthographic, (399.5, 599.5), 90),
        ("thoby:800x600:hfov=180", Thoby, (799.5, 299.5), 90),
    ],
)
def test_a_field_of_view_ends_at_the_border(text: str, lens: type, at: tuple[float, float], angle_deg: float) -> None:
    camera = parse_projection(text).projection
    assert isinstance(camera, Camera)
    assert isinstance(camera.lens, lens)
    assert camera.centre == ((camera.size[0] - 1) / 2, (camera.size[1] - 1) / 2)
    inner = np.array(camera.centre) + (np.array(at) - camera.centre) * (1 - 1e-9)  # an ulp further nothing may be seen
    theta = math.degrees(math.acos(camera.unproject(inner)[2]))
    assert theta == pytest.approx(angle_deg, abs=2e-2 if isinstance(camera.lens, Orthographic) else 1e-5)


@pytest.mark.parametrize("text", ["perspective:64x48:hfov=90", "stereographic:64x48:vfov=200", "littleplanet:64x48"])
def test_a_view_fills_the_picture(text: str) -> None:
    assert np.isfinite(pixel_rays(parse_projection(text).projection)).all()


def test_a_circular_image_ends_with_its_field_of_view() -> None:
    circle, full = (parse_projection(f"equidistant:100x80:{key}=183").projection for key in ("fov", "vfov"))
    assert isinstance(circle, Camera)
    assert isinstance(full, Camera)
    assert circle.lens == full.lens
    assert circle.half_fov == pytest.approx(math.radians(91.5))
    radius = np.hypot(*(np.stack(np.meshgrid(np.arange(100), np.arange(80))) - np.array([49.5, 39.5])[:, None, None]))
    np.testing.assert_array_equal(np.isfinite(pixel_rays(circle)[..., 0]), radius <= 40)
    assert np.isfinite(pixel_rays(full)).all()


@pytest.mark.parametrize(("word", "limit_deg"), [("orthographic", 90), ("equidistant", 180), ("thoby", 126.2272)])
def test_corners_beyond_the_lens_see_nothing(word: str, limit_deg: float) -> None:
    camera = parse_projection(f"{word}:60:hfov={2 * limit_deg - 2:g}").projection
    assert isinstance(camera, Camera)
    assert math.degrees(camera.half_fov) == pytest.approx(limit_deg, abs=1e-3)
    assert np.isnan(pixel_rays(camera)[0, 0]).all()


@pytest.mark.parametrize(
    "text", ["equirectangular:64", "cube:8", "perspective:64:hfov=90", "360x360:16", "mercator:9x9"]
)
def test_everything_can_be_turned(text: str) -> None:
    """yaw to the right, pitch up, roll clockwise."""
    turned = parse_projection(f"{text}:yaw=30:pitch=-10.5:roll=+5").world_from_projection
    expected = Rotation.from_euler("YXZ", [30, -10.5, 5], degrees=True).as_matrix()
    np.testing.assert_allclose(turned, expected, atol=1e-15)
    np.testing.assert_allclose(
        parse_projection(f"{text}:yaw=90").world_from_projection @ [0, 0, 1], [1, 0, 0], atol=1e-15
    )
    np.testing.assert_allclose(
        parse_projection(f"{text}:pitch=90").world_from_projection @ [0, 0, 1], [0, -1, 0], atol=1e-15
    )
    np.testing.assert_allclose(
        parse_projection(f"{text}:roll=90").world_from_projection @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


def test_a_little_planet_looks_down() -> None:
    placed = parse_projection("littleplanet:200x100:yaw=40")
    assert isinstance(placed.projection, Camera)
    middle, top = placed.projection.unproject([[99.5, 49.5], [99.5, -0.5]])
    np.testing.assert_allclose(placed.world_from_projection @ middle, [0, 1, 0], atol=1e-15)
    yaw, up = math.radians(40), math.radians(60)  # 150 degrees from the nadir, where yaw says
    expected = [math.cos(up) * math.sin(yaw), -math.sin(up), math.cos(up) * math.cos(yaw)]
    np.testing.assert_allclose(placed.world_from_projection @ top, expected, atol=1e-12)
    sky = parse_projection("littleplanet:200x100:pitch=90:dfov=250").world_from_projection
    np.testing.assert_allclose(sky @ [0, 0, 1], [0, -1, 0], atol=1e-15)


def test_a_camera_from_a_file(tmp_path: Path) -> None:
    odd = tmp_path / "of: a lens.json"
    save_camera(odd, fisheye(300))
    placed = parse_projection(str(odd))
    assert placed.projection == fisheye(300)
    np.testing.assert_array_equal(placed.world_from_projection, np.eye(3))
    turned = parse_projection(f"{odd}:yaw=90")
    assert turned.projection == fisheye(300)
    np.testing.assert_allclose(turned.world_from_projection @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    with pytest.raises(InputError, match=r"missing\.json"):
        parse_projection(f"{tmp_path}/missing.json:yaw=3")
    with pytest.raises(UsageError, match=r"'hfov' says nothing of camera\.json.*yaw=, pitch=, roll="):
        parse_projection(f"{odd}:hfov=3")


KNOWN = "equirectangular, cylindrical, mercator, perspective, stereographic, littleplanet, equidistant, equisolid, "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "'' is no surface: use " + KNOWN),
        ("panorama.tif", "'panorama.tif' is no surface: use " + KNOWN),
        ("equirectanglar:100", "did you mean 'equirectangular'?"),
        ("Cube:100", "did you mean 'cube'?"),
        ("equirectangular", "does not say how large the picture is, as equirectangular:8192 does"),
        ("perspective:hfov=90", "does not say how large the picture is, as perspective:1920x1080 does"),
        ("cube:layout=strip", "does not say how large"),
        ("equirectangular:", "'' is no size"),
        ("equirectangular:4k", "'4k' is no size"),
        ("equirectangular:-4", "'-4' is no size"),
        ("equirectangular:4.5", "'4.5' is no size"),
        ("equirectangular:100x", "'100x' is no size"),
        ("equirectangular:٣٢", "is no size"),
        ("equirectangular:0", "a side has 1 to 1048576 pixels"),
        ("perspective:0x100:hfov=90", "a side has 1 to 1048576 pixels"),
        ("equirectangular:2097152", "a side has 1 to 1048576 pixels"),
        ("equirectangular:999999999999999", "is no size"),
        ("equirectangular:101", "use an even width"),
        ("equirectangular:100x100", "twice as wide as high"),
        ("equirectangular:100:lat=20..10", "run upwards"),
        ("equirectangular:100:lat=-100..10", "from -90 to 90"),
        ("equirectangular:100:lon=10..-10", "run to the right"),
        ("equirectangular:100x100:lon=0..361", "at most 360"),
        ("equirectangular:100:lon=10", "lon=10 are no two angles"),
        ("equirectangular:100:lat=nan..10", "lat=nan..10 are no two angles"),
        ("equirectangular:1000000:lon=0..1", "a side is a whole number of pixels"),
        ("equirectangular:100:hfov=90", "'hfov' says nothing of equirectangular; it takes yaw="),
        ("equirectangular:100:ywa=90", "did you mean 'yaw'?"),
        ("equirectangular:100:yaw", "'yaw' is not of the form name=value"),
        ("equirectangular:100:", "'' is not of the form name=value"),
        ("equirectangular:100:yaw=1:yaw=2", "yaw= stands there twice"),
        *((f"equirectangular:100:{key}=inf", f"{key}=inf is no angle") for key in ("yaw", "pitch", "roll")),
        ("equirectangular:100:pitch=nan", "pitch=nan is no angle"),
        ("equirectangular:100:roll=1e3", "roll=1e3 is no angle"),
        ("equirectangular:100:yaw=", "yaw= is no angle"),
        ("cylindrical:100", "write cylindrical:100xHEIGHT, or add lat="),
        ("cylindrical:100x100:hfov=361", "361 degrees is not in (0, 360]"),
        ("mercator:100:hfov=0:lat=-3..3", "0 degrees is not in (0, 360]"),
        ("mercator:100x100:lat=-90..0", "ends before the poles"),
        ("perspective:100", "one field of view, hfov= or vfov= or dfov="),
        ("perspective:100:hfv=90", "'hfv' says nothing of perspective (did you mean 'hfov'?)"),
        ("perspective:100:fov=90", "'fov' says nothing of perspective"),
        ("perspective:100:hfov=90:vfov=80", "hfov and vfov are given"),
        ("perspective:100:hfov=180", "hfov=180: the perspective lens shows more than 0 and less than 180 degrees"),
        ("stereographic:100:dfov=360", "less than 360 degrees"),
        ("littleplanet:100:hfov=370", "less than 360 degrees"),
        ("orthographic:100:fov=180.1", "at most 180 degrees"),
        ("thoby:100:fov=253", "at most 252.454 degrees"),
        ("equidistant:100:hfov=361", "at most 360 degrees"),
        ("equisolid:100:hfov=0", "more than 0"),
        ("equisolid:100:hfov=-90", "more than 0"),
        ("perspective:100:hfov=0.0000001", "f_px"),
        ("cube:100x100", "is not the side of a face"),
        ("cube:100:layout=stripe", "strip, 3x2, cross, vertical-cross (did you mean 'strip'?)"),
        ("cube:1000000", "a side is a whole number of pixels"),
        ("360x360:100:hfov=3", "'hfov' says nothing of 360x360"),
        ("x.json:yaw=fast", "yaw=fast is no angle"),
    ],
)
def test_what_is_no_projection_is_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)) as refused:
        parse_projection(text)
    assert repr(text) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_help_lists_every_surface_by_an_example_that_works() -> None:
    examples = re.findall(r"^  (?!camera)([a-z0-9]+:\S+)", PROJECTIONS_HELP, re.MULTILINE)
    words = {example.partition(":")[0] for example in examples} | set(re.findall(r", (\w+):\.\.", PROJECTIONS_HELP))
    with pytest.raises(UsageError) as refused:
        parse_projection("")
    listed = re.search(r"use (.*), or a camera", str(refused.value))
    assert listed is not None
    assert words == set(listed[1].split(", "))
    for example in examples:
        text = re.sub(r"[\[\],]", "", example).replace("SIZE", "64x48").replace("WIDTH", "64").replace("SIDE", "16")
        assert parse_projection(text).projection.size[0] in (48, 64)
