"""The page about a solved mosaic: frames on the sphere, what holds them together, and how well they fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fullsphere.cli.mosaic_words import number, quality_lines
from fullsphere.cli.page import Finding, Page, Section, Table
from fullsphere.cli.wording import camera_lines

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.cli.figures import Drawing
    from fullsphere.mosaic.project import Frame, Mosaic
    from fullsphere.mosaic.residuals import FrameResiduals, Residuals

_HEADINGS = ("frame", "yaw", "pitch", "roll", "sigma", "exposure", "links", "matches", "median", "held out")


def page_of_mosaic(name: str, mosaic: Mosaic) -> Page:
    """The page about a mosaic; frames whose pictures cannot be opened are shown by their outlines."""
    from fullsphere.cli import plots_mosaic as plots
    from fullsphere.mosaic.residuals import against_theta, by_frame, residuals

    found = residuals(mosaic)
    sheet, missing = _sheet(mosaic)
    registered, left_out = mosaic.registered, [frame for frame in mosaic.frames if not frame.registered]
    sphere = [plots.contact_sheet(mosaic, sheet)] if registered else []
    if mosaic.links:
        sphere.append(plots.link_graph(mosaic, found))
    drawings: list[Drawing] = []
    if found.i.size:
        drawings.append(plots.against_theta(against_theta(found), held=bool(found.held.any())))
        for k, camera in enumerate(mosaic.cameras):
            own = found.where(_of_camera(mosaic, found, k))
            drawings.append(plots.arrows(camera, own, f"arrows-{k + 1}"))
    table = Table(_HEADINGS, tuple(_row(f, r) for f, r in zip(mosaic.frames, by_frame(mosaic, found), strict=True)))
    absent = (f"Not opened, and so shown by outlines alone: {'; '.join(missing)}.",) if missing else ()
    sections = [
        Section("On the sphere", absent, (), tuple(sphere)),
        Section("How well it fits", tuple(quality_lines(mosaic)), (), tuple(drawings)),
        Section("Frames", (_UNITS,), (table,)),
        Section(
            "Left out",
            () if left_out else ("No frame was left out.",),
            (Table(("frame", "why"), tuple((f.id, f.reason) for f in left_out), texts=(0, 1)),) if left_out else (),
        ),
        *(
            Section(f"Camera {k + 1}" if len(mosaic.cameras) > 1 else "Camera", tuple(camera_lines(camera)))
            for k, camera in enumerate(mosaic.cameras)
        ),
    ]
    return Page(f"{name}: a mosaic of {len(registered)} frames", _findings(mosaic), mosaic.diagnosis, tuple(sections))


_UNITS = (
    "Angles in degrees, exposure in EV; median residuals in pixels: of the fit's matches, and of those that no fit saw."
)


def _findings(mosaic: Mosaic) -> tuple[Finding, ...]:
    quality, registered = mosaic.quality, mosaic.registered
    every = len(registered) == len(mosaic.frames)
    said = [Finding("Frames", f"{len(registered)} of {len(mosaic.frames)} on the sphere", "good" if every else "look")]
    if quality.get("held_out_matches"):
        text = f"{quality['held_out_median_px']:.2f} px over {quality['held_out_matches']:g} matches"
        said.append(Finding("Matches that no fit saw", text))
    sigma = [frame.sigma_deg for frame in registered if frame.sigma_deg is not None]
    if sigma:
        said.append(
            Finding("Orientations known to", f"{sorted(sigma)[len(sigma) // 2]:.2g}°, the worst {max(sigma):.2g}°")
        )
    said.append(Finding("Level by", mosaic.level))
    said.append(Finding("Lens", "found from the frames" if mosaic.self_calibrated else "known beforehand"))
    return tuple(said)


def _row(frame: Frame, found: FrameResiduals) -> tuple[str, ...]:
    from fullsphere.mosaic.store import yaw_pitch_roll_deg

    if frame.camera_from_world is None:
        return (frame.id, *["left out"], *[""] * (len(_HEADINGS) - 2))
    angles = [f"{angle:.2f}" for angle in yaw_pitch_roll_deg(frame.camera_from_world)]
    sigma = "" if frame.sigma_deg is None else f"{frame.sigma_deg:.4f}"
    medians = number(found.median_px), number(found.held_median_px)
    return (frame.id, *angles, sigma, f"{frame.exposure_ev:+.2f}", str(found.links), str(found.matches), *medians)


def _of_camera(mosaic: Mosaic, found: Residuals, camera: int) -> NDArray[np.bool_]:
    import numpy as np

    return np.array([frame.camera == camera for frame in mosaic.frames])[found.j]


def _sheet(mosaic: Mosaic) -> tuple[NDArray[np.uint8] | None, list[str]]:
    """What the frames show together (H, W, 3), and what became of those that cannot be opened."""
    import numpy as np

    from fullsphere.model.colour import encoded_from_linear
    from fullsphere.model.errors import FullsphereError
    from fullsphere.mosaic.overview import overviews, working_sphere

    width, height = working_sphere(1).size
    light, weight, missing = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32), []
    for frame in mosaic.registered:  # one at a time: any number of them
        alone = _alone(mosaic, frame)
        try:
            (seen,) = overviews(alone, working_sphere(1))
        except FullsphereError as error:
            missing.append(str(error))
            continue
        much = seen.quality**4
        light += seen.light * much[..., None]
        weight += much
    if not weight.any():
        return None, missing
    shown = light / np.maximum(weight, 1e-12)[..., None]
    white = max(float(np.percentile(shown[weight > 0], 99)), 1e-6)
    sheet = encoded_from_linear(np.minimum(shown / white, 1), np.uint8)
    return np.where(weight[..., None] > 0, sheet, np.uint8(255)), missing


def _alone(mosaic: Mosaic, frame: Frame) -> Mosaic:
    import dataclasses

    return dataclasses.replace(mosaic, frames=(frame,), links=())
