"""The page about a solved mosaic: frames on the sphere, what holds them together, and how well they fit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fullsphere.cli.mosaic_words import number, quality_lines
from fullsphere.cli.page import Finding, Page, Section, Table
from fullsphere.cli.wording import camera_lines

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.cli.figures import Drawing
    from fullsphere.cli.plots_mosaic import View
    from fullsphere.model.surface import Equirectangular
    from fullsphere.model.table import RayTable
    from fullsphere.mosaic.project import Frame, Mosaic
    from fullsphere.mosaic.residuals import FrameResiduals

_HEADINGS = ("frame", "yaw", "pitch", "roll", "sigma", "exposure", "links", "matches", "median", "held out")


def page_of_mosaic(name: str, mosaic: Mosaic) -> Page:
    """The page about a mosaic; frames whose pictures cannot be opened are shown by their outlines."""
    from fullsphere.cli import plots_mosaic as plots
    from fullsphere.mosaic.residuals import against_theta, by_frame, residuals, sights

    found, view = residuals(mosaic), plots.view_of(mosaic)
    sheet, missing = contact_picture(mosaic, view)
    registered, left_out = mosaic.registered, [frame for frame in mosaic.frames if not frame.registered]
    sphere = [plots.contact_sheet(mosaic, view, sheet)] if registered else []
    if mosaic.links:
        sphere.append(plots.link_graph(mosaic, view, found))
    drawings: list[Drawing] = []
    if found.i.size:
        seen = sights(mosaic, found)
        drawings.append(plots.against_theta(against_theta(seen), held=bool(found.held.any())))
        for k, camera in enumerate(mosaic.cameras):
            own = seen.where(_camera_of(mosaic)[seen.frame] == k)
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
    "Angles in degrees, exposure in EV. Medians in pixels: the error of one keypoint among the fit's matches, and held "
    "out, the distance between both keypoints of matches that no fit saw, which is the larger even where all is well."
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
    angles = [f"{round(angle, 2) + 0.0:.2f}" for angle in yaw_pitch_roll_deg(frame.camera_from_world)]
    sigma = "" if frame.sigma_deg is None else f"{frame.sigma_deg:.4f}"
    medians = number(found.median_px), number(found.held_median_px)
    return (frame.id, *angles, sigma, f"{frame.exposure_ev:+.2f}", str(found.links), str(found.matches), *medians)


def _camera_of(mosaic: Mosaic) -> NDArray[np.intp]:
    import numpy as np

    return np.array([frame.camera for frame in mosaic.frames])


_SHEET_PX = 1600, 1024  # width of the contact sheet: of a few frames, and of many
_FEW = 40
_TABLE_PX = 1e-3  # plenty for a picture to look at
_INWARDS = 4  # power of how far from its border a frame sees a thing: near the middle it counts most


def contact_picture(mosaic: Mosaic, view: View) -> tuple[NDArray[np.uint8] | None, list[str]]:
    """What the frames show together in that part of the sphere, and what became of those that cannot be opened.

    Returns
    -------
    picture
        (H, W, 3) sRGB codes, white where no frame sees anything; None where no frame could be opened.
    missing
        A sentence for each frame that could not.
    """
    import numpy as np

    from fullsphere.cli.figures import shown_light
    from fullsphere.model.errors import FullsphereError
    from fullsphere.model.surface import Equirectangular
    from fullsphere.model.table import tabulate

    if not mosaic.registered:
        return None, []
    across, up = view.longitudes[1] - view.longitudes[0], view.latitudes[1] - view.latitudes[0]
    width = _SHEET_PX[len(mosaic.registered) > _FEW]
    size = width, max(round(width * up / across), 1)
    longitudes, latitudes = ((math.radians(a), math.radians(b)) for a, b in view)
    surface = Equirectangular(size, longitudes, latitudes)
    tables = [tabulate(camera, _TABLE_PX) for camera in mosaic.cameras]
    light, weight, missing = np.zeros((*size[::-1], 3), np.float32), np.zeros(size[::-1], np.float32), []
    for frame in mosaic.registered:  # one at a time: any number of them
        try:
            own, much = _seen(mosaic, frame, tables[frame.camera], surface)
        except FullsphereError as error:
            missing.append(str(error))
            continue
        light += own * much[..., None]
        weight += much
    if not weight.any():
        return None, missing
    shown = light / np.maximum(weight, 1e-12)[..., None]
    return np.where(weight[..., None] > 0, shown_light(shown, weight > 0), np.uint8(255)), missing


def _seen(
    mosaic: Mosaic, frame: Frame, table: RayTable, surface: Equirectangular
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The scene's light in one frame (H, W, 3), and how much it counts there (H, W)."""
    import numpy as np

    from fullsphere.model.colour import linear_from_encoded
    from fullsphere.model.remap import remap
    from fullsphere.mosaic.frame_light import codes_of, gain_of

    camera = mosaic.cameras[frame.camera]
    assert frame.camera_from_world is not None
    world_from_camera = frame.camera_from_world.T
    codes, weight = remap(codes_of(frame), table, surface, world_from_camera, "linear")
    rays = surface.window_rays(slice(0, surface.size[0]), slice(0, surface.size[1]), np.float32)
    z, at = (
        rays @ frame.camera_from_world[2].astype(np.float32),
        table.project(rays, frame.camera_from_world, np.float32),
    )
    (width, height), radius = camera.size, camera.image_radius
    border = np.minimum(np.minimum(at, np.array([width - 1, height - 1], np.float32) - at).min(-1) / radius, 1)
    rim = 1 - np.arccos(np.clip(z, -1, 1)) / camera.half_fov
    inwards = np.clip(np.nan_to_num(np.minimum(border, rim)), 1e-2, 1) ** _INWARDS
    much = weight * (codes[..., 3] > 0 if codes.shape[-1] == 4 else 1) * inwards
    light = linear_from_encoded(codes[..., :3]) * gain_of(mosaic, frame).at(z)
    return light.astype(np.float32), much.astype(np.float32)
