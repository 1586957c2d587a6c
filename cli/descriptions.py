"""What a file of fullsphere holds, in lines for people and as values for programs."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fullsphere.cli.wording import camera_lines, printable
from fullsphere.model.errors import InputError

if TYPE_CHECKING:
    from fullsphere.model.camera import Camera

_STEP_DEG = 10  # between the rows of a curve's table


class Description(NamedTuple):
    """A file described: its kind ("camera", "mosaic", "target" or "picture"), values by name, and lines of text."""

    kind: str
    summary: dict[str, Any]
    lines: list[str]


class CurveRow(NamedTuple):
    """A sample of r(theta) as a camera.json holds it; `sigma_px` is None where the file says nothing of it."""

    theta_deg: float
    r_px: float
    sigma_px: float | None
    extrapolated: bool


class CameraFile(NamedTuple):
    """A camera.json with what stands beside the camera: `record` is its `calibration`, {} if there is none."""

    path: Path
    camera: Camera
    record: dict[str, Any]
    curve: list[CurveRow]


def describe(path: Path) -> Description:
    """Say what a camera.json, mosaic.json, target.json or picture holds.

    Raises
    ------
    InputError
        If the file cannot be read, or is of no kind that is known here.
    """
    if path.suffix.lower() != ".json":
        return _picture(path)
    value = _content(path)
    kind = str(value.get("format"))
    for known, described in _KINDS.items():
        if kind.startswith(f"fullsphere-{known}/"):
            return described(path, value)
    raise InputError(
        f"{path}: format is {value.get('format')!r}; inspect knows camera.json, mosaic.json, target.json and pictures"
    )


def read_camera_file(path: Path) -> CameraFile:
    """A camera.json with its curve and its record.

    Raises
    ------
    InputError
        If the file is no camera.json, or describes no camera.
    """
    if path.suffix.lower() != ".json":
        raise InputError(
            f"{path}: two files are compared if both are a camera.json; give one file to have it described"
        )
    return _camera_file(path, _content(path))


def _content(path: Path) -> dict[str, Any]:
    from fullsphere.model.files import read_json

    value = read_json(path)
    if not isinstance(value, dict):
        raise InputError(f"{path}: is not an object of keys and values, so no file that fullsphere wrote")
    return value


def _camera_file(path: Path, value: dict[str, Any]) -> CameraFile:
    from fullsphere.model.store import camera_from_dict, camera_to_dict

    camera = camera_from_dict(value, str(path))
    record = value.get("calibration", {})
    seen = observed_range(record)
    highest = math.inf if seen is None else seen[1]
    curve = value.get("curve") or camera_to_dict(camera)["curve"]
    sigma = curve.get("sigma_px", [None] * len(curve["theta_deg"]))
    rows = [
        CurveRow(theta, r, s, theta > highest)
        for theta, r, s in zip(curve["theta_deg"], curve["r_px"], sigma, strict=True)
    ]
    return CameraFile(path, camera, record, rows)


def shown_rows(curve: list[CurveRow]) -> list[CurveRow]:
    """The samples of a curve at every ten degrees, and the last one."""
    return [row for row in curve if row.theta_deg % _STEP_DEG == 0 or row is curve[-1]]


def observed_range(record: dict[str, Any]) -> tuple[float, float] | None:
    """Smallest and largest angle in degrees at which points were seen, if the record of a calibration says so."""
    seen = record.get("observed_theta_deg")
    if isinstance(seen, list) and len(seen) == 2 and all(map(_is_number, seen)):
        return float(seen[0]), float(seen[1])
    return None


def record_lines(record: dict[str, Any]) -> list[str]:
    """How a camera was found, from the `calibration` of its file; nothing that is not there or not of its kind."""
    if not record:
        return ["no record of a calibration: where these values come from is not known"]
    lines = []
    numbers = {key: record[key] for key in ("rms_px", "points", "views") if _is_number(record.get(key))}
    if len(numbers) == 3:
        views = f"{numbers['views']:g} view{'' if numbers['views'] == 1 else 's'}"
        lines.append(f"calibrated with rms {numbers['rms_px']:.4f} px over {numbers['points']:g} points in {views}")
    seen = observed_range(record)
    if seen is not None:
        lines.append(f"points seen from {seen[0]:.1f} to {seen[1]:.1f} degrees off axis")
    if isinstance(record.get("inputs"), dict) and record["inputs"]:
        lines.append("made from " + ", ".join(f"{printable(name)}" for name in record["inputs"]))
    if isinstance(record.get("program"), str):
        lines.append(f"made by {printable(record['program'])}")
    return lines


def _camera(path: Path, value: dict[str, Any]) -> Description:
    found = _camera_file(path, value)
    camera, rows = found.camera, shown_rows(found.curve)
    summary = {
        "file": str(path),
        "kind": "camera",
        "image_size_px": list(camera.size),
        "lens": camera.lens.projection,
        "values": dict(zip(camera.parameter_names, camera.values.tolist(), strict=True)),
        "half_field_of_view_deg": math.degrees(camera.half_fov),
        "calibration": found.record or None,
        "curve": [row._asdict() for row in rows],
    }
    first, *others = camera_lines(camera)
    lines = [f"{path}: {first}", *others, *record_lines(found.record), "theta (deg)   r (px)    sigma (px)"]
    for row in rows:
        sigma = "         -" if row.sigma_px is None else f"{row.sigma_px:10.4f}"
        lines.append(f"{row.theta_deg:9g} {row.r_px:10.3f} {sigma}{'  extrapolated' if row.extrapolated else ''}")
    return Description("camera", summary, lines)


def _mosaic(path: Path, value: dict[str, Any]) -> Description:
    from fullsphere.cli import mosaic_words
    from fullsphere.mosaic.store import mosaic_from_dict

    mosaic = mosaic_from_dict(value, str(path), path.parent)
    return Description("mosaic", mosaic_words.summary(path, mosaic), mosaic_words.lines(path, mosaic))


def _target(path: Path, value: dict[str, Any]) -> Description:
    from fullsphere.model.calibration.target_file import load_target

    target = load_target(path)
    size = ", ".join(f"{extent:g}" for extent in (target.points.max(0) - target.points.min(0)).round(3).tolist())
    boards = [_object(board, f"{path}: boards[{k}]") for k, board in enumerate(_list(value, "boards", path))]
    plural = "" if len(boards) == 1 else "s"
    lines = [
        f"{path}: calibration target of {len(boards)} board{plural}, "
        f"{len(target.points)} marks over {size} mm (x, y, z)",
        *(f"board {k + 1}: {_board(board)}" for k, board in enumerate(boards)),
    ]
    summary = {"file": str(path), "kind": "target", "marks": len(target.points), "boards": boards}
    return Description("target", summary, lines)


def _board(board: dict[str, Any]) -> str:
    """Kind and values of a board, and whether it is rolled."""
    values = ", ".join(
        f"{name} {printable(value)}" for name, value in sorted(board.items()) if name not in ("kind", "placement")
    )
    placement = board.get("placement")
    radius = placement.get("radius_mm") if isinstance(placement, dict) else None
    return f"{printable(board.get('kind'))}, {values}, {'flat' if radius is None else f'rolled, radius {radius:g} mm'}"


def _picture(path: Path) -> Description:
    from fullsphere.model.image_library import opened

    with opened(path) as (reader, spec):
        size, kind = (spec.width, spec.height), str(reader.format_name())
        projection, full = spec.getattribute("GPano:ProjectionType"), spec.getattribute("GPano:FullPanoWidthPixels")
        summary = {
            "file": str(path),
            "kind": "picture",
            "size_px": list(size),
            "format": kind,
            "channels": spec.nchannels,
            "sample": str(spec.format),
            "gpano": projection if isinstance(projection, str) else None,
        }
    lines = [f"{path}: {kind} picture, {size[0]} x {size[1]} pixels, {spec.nchannels} channels of {summary['sample']}"]
    if summary["gpano"] is None:
        shape = "; twice as wide as high, as a full sphere is" if size[0] == 2 * size[1] else ""
        lines.append(f"no GPano fields: viewers do not know it as a panorama{shape}")
    else:
        whole = size[0] == 2 * size[1] and str(full) == str(size[0])
        lines.append(f"GPano: {printable(projection)}, {'the whole sphere' if whole else 'a part of the sphere'}")
    return Description("picture", summary, lines)


_KINDS: dict[str, Callable[[Path, dict[str, Any]], Description]] = {
    "camera": _camera,
    "mosaic": _mosaic,
    "target": _target,
}


def _list(value: dict[str, Any], key: str, path: Path) -> list[Any]:
    if not isinstance(value.get(key), list):
        raise InputError(f"{path}: {key} is missing or not a list; is it a mosaic that was edited?")
    found: list[Any] = value[key]
    return found


def _object(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: is not an object of keys and values")
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
