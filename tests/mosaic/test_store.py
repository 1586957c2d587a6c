"""mosaic.json: what is written comes back, and what is not exactly a mosaic is refused by the key's name."""

import contextlib
import copy
import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from turning import frames_of, matched, orientation, ring, srgb8, turn_between

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError
from fullsphere.model.files import sha256_of
from fullsphere.model.lens import BaksteinPajdla, FloatArray, KannalaBrandt
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.compose import compose
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.store import load_mosaic, mosaic_from_dict, mosaic_to_dict, save_mosaic
from laws import SEEDS, fisheye, law, smooth_light

FIRST = Camera(BaksteinPajdla(43.2, 2.11, 13.4, 1.13), (128, 96), (64.3, 47.7), half_fov=math.radians(91.5))
SECOND = Camera(KannalaBrandt(40.1, -0.031, 0.0043, 0.0, 0.0), (128, 96), (63.1, 48.2), half_fov=1.7, aspect=1.001)


def turns(count: int, seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.array([orientation(*angles) for angles in rng.uniform([-180, -89, -180], [180, 89, 180], (count, 3))])


def no_pixels() -> Any:
    raise AssertionError("opened while it was written")


def mosaic_in(folder: Path, seed: int = 0) -> Mosaic:
    """Two shots of a rig of two in files with both circles side by side, with a mask, and a frame left out."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(seed)
    mounts, shots = turns(2, seed), turns(2, seed + 1)
    frames = []
    for shot in range(2):
        image = folder / f"dual{shot}.png"
        cv2.imwrite(str(image), rng.integers(0, 255, (96, 256, 3), np.uint8))
        for camera, side in enumerate(("left", "right")):
            frames.append(
                Frame(
                    f"dual{shot}.png:{side}",
                    str(image),
                    (128, 96),
                    no_pixels,
                    sha256=sha256_of(image),
                    camera_from_world=mounts[camera] @ shots[shot],
                    sigma_deg=0.001 * (shot + 1) / 3,
                    exposure_ev=float(rng.normal()),
                    white_balance=(float(rng.uniform(0.5, 2)), 1.0, float(rng.uniform(0.5, 2))),
                    camera=camera,
                    shot=f"dual{shot}.png",
                    crop_px=(128 * camera, 0, 128, 96),
                    quarter_turns=2 * shot,
                )
            )
    mask = np.zeros((96, 256), np.uint8)
    mask[10:80] = 255
    cv2.imwrite(str(folder / "mask.png"), mask)
    frames[0] = dataclasses.replace(frames[0], mask_image=str(folder / "mask.png"), mask=no_pixels)
    frames.append(Frame("broken.jpg", str(folder / "broken.jpg"), (0, 0), no_pixels, reason="ends early"))
    rotations = np.array([f.camera_from_world for f in frames[:4]])
    links = matched(FIRST, rotations, pairs=[(0, 1), (0, 2), (1, 3)], noise_px=0.3, seed=seed)
    links[0] = dataclasses.replace(links[0], verdict="parallax")
    links[1] = dataclasses.replace(links[1], held_i=links[1].pixels_i[:7], held_j=links[1].pixels_j[:7])
    size = len(FIRST.values), len(SECOND.values)
    return Mosaic(
        (FIRST, SECOND),
        tuple(frames),
        tuple(links),
        vignetting_ev=((-0.25, 0.1 / 3), (-0.5, -0.125)),
        shade_ev=((), (-0.1, -0.2, -0.3, -0.5, -0.1 / 3 - 1)),
        level="gravity",
        self_calibrated=True,
        quality={"matches": 120, "residual_median_px": 0.1 / 3},
        camera_from_rig=tuple(mounts),
        camera_covariances=tuple(np.diag(rng.random(n)) for n in size),
        diagnosis=("the frames show two viewpoints", "…"),
    )


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    save_mosaic(tmp_path / "mosaic.json", mosaic_in(tmp_path))
    return tmp_path / "mosaic.json"


def test_a_mosaic_comes_back(tmp_path: Path) -> None:
    mosaic = mosaic_in(tmp_path)
    save_mosaic(tmp_path / "mosaic.json", mosaic)
    read = load_mosaic(tmp_path / "mosaic.json")
    for name in ("vignetting_ev", "shade_ev", "level", "self_calibrated", "quality", "diagnosis"):
        assert getattr(read, name) == getattr(mosaic, name)
    for camera, original in zip(read.cameras, mosaic.cameras, strict=True):
        assert (camera.lens, camera.size, camera.centre) == (original.lens, original.size, original.centre)
        assert camera.half_fov == pytest.approx(original.half_fov, rel=1e-15)
    assert np.array_equal(read.camera_from_rig, mosaic.camera_from_rig)
    for covariance, known in zip(read.camera_covariances, mosaic.camera_covariances, strict=True):
        assert np.array_equal(covariance, known)
    same = [f.name for f in dataclasses.fields(Frame) if f.name not in ("load", "mask", "profile", "camera_from_world")]
    for frame, written in zip(read.frames, mosaic.frames, strict=True):
        assert [getattr(frame, name) for name in same] == [getattr(written, name) for name in same]
        assert np.array_equal(frame.camera_from_world, written.camera_from_world)  # type: ignore[arg-type]
    for link, found in zip(read.links, mosaic.links, strict=True):
        assert (link.i, link.j, link.verdict) == (found.i, found.j, found.verdict)
        assert np.array_equal(link.j_from_i, found.j_from_i)
        for name in ("pixels_i", "pixels_j", "held_i", "held_j"):
            assert np.allclose(getattr(link, name), getattr(found, name), rtol=0, atol=0.00051)


@given(seed=SEEDS)
@law(5)
def test_what_was_read_is_written_with_the_same_bytes(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    folder = tmp_path_factory.mktemp("mosaic")
    save_mosaic(folder / "mosaic.json", mosaic_in(folder, seed))
    save_mosaic(folder / "again.json", load_mosaic(folder / "mosaic.json"))
    assert (folder / "again.json").read_bytes() == (folder / "mosaic.json").read_bytes()


def test_one_camera_alone_has_no_rig(tmp_path: Path) -> None:
    frames = [
        Frame(name, name, FIRST.size, no_pixels, camera_from_world=turn)
        for name, turn in zip("ab", turns(2), strict=True)
    ]
    value = mosaic_to_dict(Mosaic((FIRST,), tuple(frames), ()), tmp_path)
    assert "camera_from_rig" not in value["cameras"][0]
    assert "calibration" not in value["cameras"][0]
    read = mosaic_from_dict(value_of(value), "x", tmp_path)
    assert read.camera_from_rig == read.camera_covariances == ()
    assert [frame.shot for frame in read.frames] == ["", ""]


def test_residuals_are_said(stored: Path) -> None:
    links = json.loads(stored.read_text())["links"]
    assert 0.1 < links[1]["residual_px"] < 1
    assert 0.1 < links[1]["held_out_residual_px"] < 1
    assert links[0]["held_out_residual_px"] is None


def test_a_mosaic_that_was_read_composes_to_the_same_panorama(tmp_path: Path) -> None:
    camera, files = fisheye(150), []
    for k, frame in enumerate(frames_of(smooth_light, camera, ring(4), lambda k, light: srgb8(light))):
        path = tmp_path / f"{k}.png"
        cv2.imwrite(str(path), frame.load()[..., ::-1])
        files.append(
            dataclasses.replace(frame, id=path.name, image=str(path), exposure_ev=0.1 * k, sha256=sha256_of(path))
        )
    mosaic = Mosaic((camera,), tuple(files), (), vignetting_ev=((-0.2, 0.1),))
    save_mosaic(tmp_path / "mosaic.json", mosaic)
    panoramas = [
        np.concatenate([band.rows for band in compose(one, Equirectangular((300, 150)))])
        for one in (mosaic, load_mosaic(tmp_path / "mosaic.json"))
    ]
    assert panoramas[0][..., :3].std() > 5
    assert np.array_equal(panoramas[0], panoramas[1])


def test_pictures_and_masks_are_found_from_elsewhere(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path.parent)
    (tmp_path / "moved").mkdir()
    for file in tmp_path.glob("*.*"):
        file.rename(tmp_path / "moved" / file.name)
    frames = load_mosaic(Path(tmp_path.name) / "moved" / "mosaic.json").frames
    whole = cv2.imread(str(tmp_path / "moved/dual0.png"))[..., ::-1]
    assert np.array_equal(frames[1].load(), whole[:, 128:])
    mask = frames[0].mask
    assert mask is not None
    assert np.array_equal(np.flatnonzero(mask()[:, 0]), np.arange(10, 80))
    assert mask().shape == (96, 128)


def test_turned_pictures_are_turned_back(tmp_path: Path) -> None:
    picture: NDArray[np.uint8] = np.arange(96 * 128 * 3, dtype=np.uint32).astype(np.uint8).reshape(128, 96, 3)
    cv2.imwrite(str(tmp_path / "a.png"), picture[..., ::-1])
    frame = Frame("a", str(tmp_path / "a.png"), FIRST.size, no_pixels, camera_from_world=np.eye(3), turned=1)
    save_mosaic(tmp_path / "mosaic.json", Mosaic((FIRST,), (frame,), ()))
    assert np.array_equal(load_mosaic(tmp_path / "mosaic.json").frames[0].load(), np.rot90(picture, -1))


def test_a_changed_picture_is_refused_when_it_is_opened(stored: Path) -> None:
    frames = load_mosaic(stored).frames
    image = stored.parent / "dual0.png"
    cv2.imwrite(str(image), np.zeros((96, 256, 3), np.uint8))
    with pytest.raises(InputError, match=r"dual0\.png: is not the picture that was registered"):
        frames[0].load()
    image.unlink()
    with pytest.raises(InputError, match=r"dual0\.png: there is no such file"):
        frames[0].load()


def test_without_a_sha256_only_the_size_is_compared(stored: Path) -> None:
    value = json.loads(stored.read_text())
    value["frames"][0].update(sha256="", crop_px=None)
    frame = mosaic_from_dict(value, "x", stored.parent).frames[0]
    with pytest.raises(InputError, match="is a frame of 256 x 96 pixels, not 128 x 96"):
        frame.load()


def test_angles_changed_by_hand_win_over_the_matrix(stored: Path) -> None:
    value = json.loads(stored.read_text())
    value["frames"][0]["yaw_deg"] = 12.5
    frame = mosaic_from_dict(value, "x", stored.parent).frames[0]
    angles = [value["frames"][0][key] for key in ("yaw_deg", "pitch_deg", "roll_deg")]
    assert frame.camera_from_world is not None
    assert turn_between(frame.camera_from_world, orientation(*angles)) < 1e-12


@pytest.mark.parametrize("given_keys", [["camera_from_world"], ["yaw_deg", "pitch_deg", "roll_deg"]])
def test_one_way_to_write_an_orientation_is_enough(stored: Path, given_keys: list[str]) -> None:
    value = json.loads(stored.read_text())
    matrix = value["frames"][0]["camera_from_world"]
    for key in {"camera_from_world", "yaw_deg", "pitch_deg", "roll_deg"} - set(given_keys):
        del value["frames"][0][key]
    read = mosaic_from_dict(value, "x", stored.parent).frames[0].camera_from_world
    assert read is not None
    assert turn_between(np.array(matrix), read) < 1e-12


def value_of(plain: Any) -> Any:
    """A value as it comes back from JSON."""
    return json.loads(json.dumps(plain, default=lambda array: array.tolist()))


def changed(*keys: str | int, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(value: Any) -> None:
        for key in keys[:-1]:
            value = value[key]
        value[keys[-1]] = to

    return change


def without(*keys: str | int) -> Callable[[dict[str, Any]], None]:
    def change(value: Any) -> None:
        for key in keys[:-1]:
            value = value[key]
        del value[keys[-1]]

    return change


MIRROR = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
SKEW = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

MALFORMED: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (changed("format", to="fullsphere-mosaic/2"), "mosaic/2', not"),
    (without("format"), "format is None"),
    (without("level"), "'level' is missing"),
    (changed("horizon", to=1), "'horizon' is unknown"),
    (changed("level", to=3), "level is 3, not a text"),
    (changed("cameras", to=[]), "cameras: there is none"),
    (changed("cameras", to={}), "cameras is not a list"),
    (changed("cameras", 1, to=7), r"cameras\[1\]: is not an object"),
    (changed("cameras", 1, "aspect", to=-1), r"cameras\[1\]: aspect"),
    (changed("cameras", 1, "image_size_px", to=[1e9, 1]), r"cameras\[1\]: image_size_px"),
    (without("cameras", 0, "vignetting"), r"cameras\[0\]: the key 'vignetting' is missing"),
    (changed("cameras", 0, "vignetting", to=[1]), r"cameras\[0\]: vignetting is not a list of 2"),
    (changed("cameras", 0, "vignetting", to=[1, 1000]), r"cameras\[0\]: vignetting is not between"),
    (changed("cameras", 1, "edge_shade", to=[-1]), r"cameras\[1\]: edge_shade is not a list of 5"),
    (changed("cameras", 1, "edge_shade", 2, to=0.5), r"cameras\[1\]: edge_shade is not between -64 and 0"),
    (without("cameras", 1, "camera_from_rig"), r"cameras\[1\]: the key 'camera_from_rig' is missing"),
    (changed("cameras", 0, "camera_from_rig", to=MIRROR), r"cameras\[0\]: camera_from_rig is not a rotation but mir"),
    (changed("cameras", 0, "calibration", "covariance", "of", to=["a"]), r"covariance: of is not the list of this"),
    (changed("cameras", 0, "calibration", "covariance", "values", to=[[1]]), "values has 1 rows, not 7"),
    (changed("cameras", 0, "calibration", "covariance", "values", 0, 0, to=-1), "values has a negative variance"),
    (changed("cameras", 0, "calibration", "covariance", to=3), "covariance: is not an object"),
    (changed("frames", to=None), "frames is not a list"),
    (changed("frames", 1, to=None), r"frames\[1\]: is not an object"),
    (changed("frames", 1, "id", to="dual0.png:left"), r"frames\[1\]: id .* is that of frames\[0\] too"),
    (changed("frames", 1, "id", to=""), r"frames\[1\]: id is empty"),
    (changed("frames", 1, "id", to=4), r"frames\[1\]: id is 4, not a text"),
    (changed("frames", 0, "status", to="lost"), r"frames\[0\]: status is 'lost'"),
    (without("frames", 0, "status"), r"frames\[0\]: status is None"),
    (without("frames", 0, "sha256"), r"frames\[0\]: the key 'sha256' is missing"),
    (changed("frames", 0, "pose", to=1), r"frames\[0\]: the key 'pose' is unknown"),
    (changed("frames", 0, "camera", to=2), r"frames\[0\]: camera is 2, not between 0 and 1"),
    (changed("frames", 0, "camera", to=-1), r"frames\[0\]: camera is -1, not between 0 and 1"),
    (changed("frames", 0, "camera", to=0.5), r"frames\[0\]: camera is 0.5, not a whole number"),
    (changed("frames", 0, "camera", to=True), r"frames\[0\]: camera is True, not a number"),
    (changed("frames", 0, "camera_from_world", to=MIRROR), r"camera_from_world is not a rotation but mirrors"),
    (changed("frames", 0, "camera_from_world", to=SKEW), r"camera_from_world is not a rotation: its rows"),
    (changed("frames", 0, "camera_from_world", to=[[1, 0, 0]]), r"camera_from_world is not a matrix of 3 rows"),
    (changed("frames", 0, "camera_from_world", 0, to=[1, 0]), r"camera_from_world is not a list of 3 numbers"),
    (without("frames", 0, "roll_deg"), r"frames\[0\]: the key 'roll_deg' is missing"),
    (changed("frames", 0, "pitch_deg", to=91), r"pitch_deg is 91, not between -90 and 90"),
    (changed("frames", 0, "yaw_deg", to="1"), r"yaw_deg is '1', not a number"),
    (changed("frames", 0, "sigma_deg", to=-1), r"sigma_deg is -1, less than 0"),
    (without("frames", 0, "sigma_deg"), r"'sigma_deg' is missing"),
    (changed("frames", 0, "exposure_ev", to=1e9), r"exposure_ev is 1e\+09, not between"),
    (changed("frames", 0, "white_balance", to=[1, 0, 1]), r"white_balance is not three factors between 0.01 and 100"),
    (changed("frames", 0, "size_px", to=[1 << 30, 1]), r"size_px: .* are not whole pixels"),
    (changed("frames", 0, "size_px", to=[12.5, 1]), r"size_px: 12.5 x 1 are not whole pixels"),
    (changed("frames", 0, "size_px", to=[96, 96]), r"size_px is 96 x 96, that of its camera 128 x 96"),
    (changed("frames", 0, "crop_px", to=[0, 0, 64, 96]), r"crop_px leaves 64 x 96 pixels, size_px says 128 x 96"),
    (changed("frames", 0, "crop_px", to=[-1, 0, 128, 96]), r"crop_px is not a left, top, width and height"),
    (changed("frames", 0, "crop_px", to=[0, 0, 128]), r"crop_px is not a list of 4 numbers"),
    (changed("frames", 0, "turned", to=4), r"turned is 4, not between 0 and 3"),
    (changed("frames", 0, "quarter_turns", to=-1), r"quarter_turns is -1, not between 0 and 3"),
    (changed("frames", 0, "image", to=""), r"image is '', not the path of a file"),
    (changed("frames", 0, "mask", to="a\0b"), r"mask is 'a\\x00b', not the path of a file"),
    (changed("frames", 0, "reason", to="x"), r"the key 'reason' is unknown"),
    (without("frames", 4, "reason"), r"frames\[4\]: the key 'reason' is missing"),
    (changed("frames", 4, "yaw_deg", to=0), r"frames\[4\]: the key 'yaw_deg' is unknown"),
    (changed("links", 0, to=0), r"links\[0\]: is not an object"),
    (without("links", 0, "matches_px"), r"links\[0\]: the key 'matches_px' is missing"),
    (changed("links", 0, "frames", to=["dual0.png:left", "?"]), r"links\[0\]: frames: '\?' is the id of none"),
    (changed("links", 0, "frames", to=["dual0.png:left"]), r"links\[0\]: frames are not the id of two"),
    (changed("links", 0, "frames", to=["dual0.png:right", "dual0.png:left"]), "in the order of the list of frames"),
    (changed("links", 1, "frames", to=["dual0.png:left", "dual0.png:right"]), "these two are linked above already"),
    (changed("links", 0, "matches", to=1), r"matches is 1, but matches_px holds those of \d+"),
    (changed("links", 0, "held_out_px", to=[1, 2, 3]), "held_out_px holds 3 numbers; a match has four"),
    (changed("links", 0, "held_out_px", to=[1, 2, 3, 1e8]), "held_out_px holds a pixel that is in no picture"),
    (changed("links", 0, "second_from_first", to=MIRROR), "second_from_first is not a rotation but mirrors"),
    (changed("links", 0, "verdict", to=None), "verdict is None, not a text"),
    (changed("quality", to=[]), "quality: is not an object"),
    (changed("quality", "matches", to="many"), "quality: matches is 'many', not a number"),
    (without("quality", "self_calibrated"), "quality: the key 'self_calibrated' is missing"),
    (changed("quality", "self_calibrated", to=1), "self_calibrated is 1, not true or false"),
    (changed("diagnosis", to="fine"), "diagnosis is not a list"),
    (changed("diagnosis", to=[1]), r"diagnosis\[0\] is 1, not a text"),
]


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("content")
    return value_of(mosaic_to_dict(mosaic_in(folder), folder))


@pytest.mark.parametrize(("change", "message"), MALFORMED)
def test_what_is_no_mosaic_is_refused_by_the_key(
    content: Any, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    value = copy.deepcopy(content)
    change(value)
    with pytest.raises(InputError, match=f"^there.json: .*{message}"):
        mosaic_from_dict(value, "there.json", Path())


@pytest.mark.parametrize("text", ["[]", "{", "", '{"format": 1, "format": 2}', '{"level": NaN}', '{"level": 1e999}'])
def test_what_is_no_json_object_is_refused_by_the_file(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(InputError, match=r"bad\.json: "):
        load_mosaic(tmp_path / "bad.json")


@given(seed=SEEDS)
@law(60)
def test_a_damaged_mosaic_is_read_or_refused(content: Any, seed: int) -> None:
    """Whatever value stands in whatever place: nothing but InputError."""
    value, rng = copy.deepcopy(content), np.random.default_rng(seed)
    at: Any = value
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        key = keys[int(rng.integers(len(keys)))]
        if not (isinstance(at[key], dict | list) and at[key] and rng.random() < 0.9):
            break
        at = at[key]
    odd: list[Any] = [None, True, -1, 0, 0.5, 1e300, 10**300, "", "x", "a\0b", [], {}, [[]], [1], {"a": 1}]
    at[key] = odd[int(rng.integers(len(odd)))]
    with contextlib.suppress(InputError):
        mosaic_to_dict(mosaic_from_dict(value, "there.json", Path()), Path())
