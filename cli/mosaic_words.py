"""What a solved mosaic is like, in words: frames, cameras, residuals, and what is to be minded."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fullsphere.cli.wording import camera_lines, printable

if TYPE_CHECKING:
    from fullsphere.mosaic.project import Frame, Mosaic
    from fullsphere.mosaic.residuals import FrameResiduals


def summary(path: Path, mosaic: Mosaic) -> dict[str, Any]:
    """The mosaic as values for programs."""
    from fullsphere.mosaic.residuals import by_frame, residuals

    each = by_frame(mosaic, residuals(mosaic))
    return {
        "file": str(path),
        "kind": "mosaic",
        "cameras": [
            {
                "lens": camera.lens.projection,
                "image_size_px": list(camera.size),
                "field_of_view_deg": 2 * math.degrees(camera.half_fov),
            }
            for camera in mosaic.cameras
        ],
        "self_calibrated": mosaic.self_calibrated,
        "frames": [_frame(frame, found) for frame, found in zip(mosaic.frames, each, strict=True)],
        "registered": len(mosaic.registered),
        "links": len(mosaic.links),
        "links_with_parallax": sum(link.verdict == "parallax" for link in mosaic.links),
        "level": mosaic.level,
        "quality": dict(mosaic.quality),
        "diagnosis": list(mosaic.diagnosis),
    }


def _frame(frame: Frame, found: FrameResiduals) -> dict[str, Any]:
    from fullsphere.mosaic.store import yaw_pitch_roll_deg

    value: dict[str, Any] = {"id": frame.id, "status": "registered" if frame.registered else "left-out"}
    if frame.camera_from_world is None:
        return {**value, "reason": frame.reason}
    yaw, pitch, roll = (round(angle, 9) + 0.0 for angle in yaw_pitch_roll_deg(frame.camera_from_world))  # no -0
    angles = {"yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll, "sigma_deg": frame.sigma_deg}
    return {**value, "reason": "", **angles, "exposure_ev": frame.exposure_ev, **found._asdict()}


def lines(path: Path, mosaic: Mosaic) -> list[str]:
    """The mosaic in words, for a terminal."""
    values = summary(path, mosaic)
    registered, count = len(mosaic.registered), len(mosaic.frames)
    said = [f"{path}: {registered} of {count} frames have their place on the sphere"]
    for camera in mosaic.cameras:
        said += camera_lines(camera)
    said.append("lens found from the frames themselves" if mosaic.self_calibrated else "lens known beforehand")
    said += [*quality_lines(mosaic), *(f"note: {printable(sentence)}" for sentence in mosaic.diagnosis)]
    said.append(
        "frame                     yaw    pitch     roll     sigma  exposure  links  matches  median px  held out px"
    )
    for frame in values["frames"]:
        name = f"{printable(frame['id']):20}"
        if frame["status"] != "registered":
            said.append(f"{name} left out: {printable(frame['reason'])}")
            continue
        sigma = f"{'-':>9}" if frame["sigma_deg"] is None else f"{frame['sigma_deg']:9.4f}"
        said.append(
            f"{name} {frame['yaw_deg']:8.2f} {frame['pitch_deg']:8.2f} {frame['roll_deg']:8.2f} {sigma} "
            f"{frame['exposure_ev']:+6.2f} EV {frame['links']:6d} {frame['matches']:8d} "
            f"{number(frame['median_px']):>10} {number(frame['held_median_px']):>12}"
        )
    return said


def quality_lines(mosaic: Mosaic) -> list[str]:
    """What the frames are merged of, how well they fit, and how the mosaic was levelled."""
    from fullsphere.mosaic.brackets import described

    quality, merged = mosaic.quality, described(mosaic.frames)
    said = [f"merged: {merged}"] if merged else []
    broken = sum(link.verdict == "parallax" for link in mosaic.links)
    parallax = f", {broken} of them with parallax" if broken else ""
    count = len(mosaic.links)
    said.append(f"{count} pair{'' if count == 1 else 's'} of frames with things that both see{parallax}")
    if "matches" in quality:
        said.append(f"{quality['matches']:g} matches agree to {quality['residual_median_px']:.2f} px (median)")
    if quality.get("held_out_matches"):
        said.append(
            f"{quality['held_out_matches']:g} matches that no fit saw agree to {quality['held_out_median_px']:.2f} px "
            f"({100 * quality['held_out_share']:.0f} % of all such)"
        )
    tilt = quality.get("level_sigma_deg")
    said.append(f"level by: {mosaic.level}" + ("" if tilt is None else f" (to {tilt:.2g} degrees)"))
    return said


def number(value: float | None) -> str:
    """A median as it is shown."""
    return "-" if value is None else f"{value:.2f}"
