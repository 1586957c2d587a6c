"""Figures over the picture's area: reprojection errors, coverage, uncertainty and difference of directions."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from fullsphere.cli.figures import BLUE, DENSE, FAINT, INK, RED, Drawing, blank, styled
from fullsphere.model.calibration.calibrate import Calibration
from fullsphere.model.calibration.coverage import Coverage
from fullsphere.model.calibration.difference import Difference
from fullsphere.model.calibration.ray_errors import RaySigma
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray

_ROUND = (1, 2, 5)  # magnifications and scale bars are one of these times a power of ten
_ARROW = 0.03  # of the picture's longer side: how long a typical error is drawn
_CROWDED = 1.8  # of the distance between points: the same where points stand close
_DEEPEST = 1e-3  # of the largest value of a map: the smallest that has a colour of its own
_SPREAD = 3  # the largest value of a map over its median from which a logarithmic scale is used
_CELLS = 24  # along the longer side of the picture
_ARROWS = 15  # the same, for differences
_PHI = np.linspace(0, 2 * math.pi, 721)


def reprojection(calibration: Calibration) -> Drawing:
    """Where every point was seen and, magnified, how far the camera misses it (Figures 9a and 10 of the paper)."""
    camera = calibration.camera
    pixels = np.concatenate([view.pixels for view in calibration.views])
    residuals, used = np.concatenate(calibration.residuals_px), np.concatenate(calibration.used)
    seen = np.isfinite(residuals).all(1)  # a rejected point may lie where the lens images nothing
    room = math.sqrt(math.prod(camera.size) / len(pixels))
    magnified = magnification(calibration.rms_px, min(_ARROW * max(camera.size), _CROWDED * room))
    dense = len(pixels) > DENSE
    with styled():
        figure, axes = picture_axes(camera)
        lines = np.stack([pixels, pixels + magnified * residuals], axis=1)
        axes.plot(
            *pixels[used].T,
            linestyle="none",
            marker=".",
            markersize=0.8 if dense else 3.5,
            color=FAINT if dense else INK,
            rasterized=dense,
            label=f"{np.count_nonzero(used)} points",
        )
        width = 0.5 if dense else 1.0
        axes.add_collection(
            LineCollection(list(lines[used]), colors=BLUE, linewidths=width, rasterized=dense, label="their errors")
        )
        if not used.all():
            axes.add_collection(
                LineCollection(list(lines[~used & seen]), colors=RED, linewidths=width, rasterized=dense)
            )
            rejected = f"{np.count_nonzero(~used)} rejected"
            axes.plot(*pixels[~used].T, linestyle="none", marker="x", markersize=5, color=RED, label=rejected)
        length = round_number(3 * calibration.rms_px)
        _scale_bar(axes, camera, magnified * length, f"{length:g} px of error")
        figure.legend(loc="outside lower center", ncols=3)
    return Drawing(
        "reprojection",
        f"Reprojection errors, magnified {magnified:g} times",
        "From each measured point (dot) a line towards the place where the camera puts it. Neighbouring lines that run "
        "the same way are a systematic error; noise runs every way. Outlines: the picture and the field of view; "
        "cross: the axis. (Figures 9a and 10 of the paper.)",
        figure,
    )


def coverage(calibration: Calibration, gap: Coverage) -> Drawing:
    """How many points fell into each part of the picture, and the middle of the largest gap."""
    camera = calibration.camera
    width, height = camera.size
    pixels = np.concatenate([view.pixels for view in calibration.views])[np.concatenate(calibration.used)]
    cell = max(camera.size) / _CELLS
    edges_u = np.arange(0, width + cell, cell) - 0.5
    edges_v = np.arange(0, height + cell, cell) - 0.5
    counts = np.histogram2d(pixels[:, 1], pixels[:, 0], (edges_v, edges_u))[0]
    with styled():
        figure, axes = picture_axes(camera)
        mesh = axes.pcolormesh(
            edges_u, edges_v, np.ma.masked_equal(counts, 0), cmap="viridis_r", vmin=0, zorder=0.5, rasterized=True
        )
        bar = figure.colorbar(mesh, ax=axes, location="bottom", shrink=0.8, aspect=30, label="points in a cell")
        bar.ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        theta, phi = math.radians(gap.gap_theta_deg), math.radians(gap.gap_phi_deg)
        loneliest = camera.project([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
        axes.plot(*loneliest, marker="*", markersize=13, color=RED, markeredgecolor="white")
    return Drawing(
        "coverage",
        "Where the points are",
        f"Number of points in cells of {cell:.0f} px; white: none. Star: the direction farthest from any point, "
        f"{gap.gap_deg:.1f} degrees from the nearest. What is known of empty parts rests on the lens being round.",
        figure,
    )


def ray_sigma(camera: Camera, sigma: RaySigma) -> Drawing:
    """Map of the uncertainty of the direction in which a pixel looks."""
    with styled():
        figure, axes = picture_axes(camera)
        degrees = np.degrees(sigma.relative_rad)
        draw_map(figure, axes, sigma.u_px, sigma.v_px, degrees, "one standard deviation (degrees)")
    return Drawing(
        "ray-sigma",
        "How certain directions are",
        "One standard deviation of the direction in which a pixel looks, against the other directions: how the camera "
        "as a whole is turned inside its housing shows in no picture, and is taken out.",
        figure,
    )


def difference_map(camera: Camera, difference: Difference) -> Drawing:
    """Map of the angle between the rays that two cameras give the same pixel, after the best common rotation."""
    with styled():
        figure, axes = picture_axes(camera)
        degrees = np.degrees(difference.angle_rad)
        draw_map(figure, axes, difference.u_px, difference.v_px, degrees, "angle between the rays (degrees)")
        step = max(1, len(difference.u_px) // _ARROWS)
        u, v = np.meshgrid(difference.u_px[step // 2 :: step], difference.v_px[step // 2 :: step])
        shift = difference.shift_px[step // 2 :: step, step // 2 :: step]
        magnified = magnification(difference.rms_px, 2.5 * _ARROW * max(camera.size))
        axes.quiver(
            u, v, *np.moveaxis(magnified * shift, -1, 0), angles="xy", scale_units="xy", scale=1, color="white",
            width=0.004, edgecolor=INK, linewidth=0.4,
        )  # fmt: skip
    return Drawing(
        "difference",
        "How the two cameras differ",
        "Angle between the rays that the two cameras give the same pixel, after the rotation that brings them nearest; "
        f"arrows, magnified {magnified:g} times: where the first camera shows what the second sees at their foot.",
        figure,
    )


def draw_map(figure: Figure, axes: Axes, u: FloatArray, v: FloatArray, values: FloatArray, label: str) -> None:
    """Colour the picture by positive values (rows, columns) at pixels u (columns,) and v (rows,); NaN stays white."""
    known = values[np.isfinite(values)]
    top, middle = (float(known.max()), float(np.median(known))) if known.size else (1.0, 1.0)
    if top > _SPREAD * middle > 0:
        norm: Normalize = LogNorm(max(float(known.min()), _DEEPEST * top), top, clip=True)
    else:
        norm = Normalize(0.0, top or 1.0)
    shown = np.ma.masked_invalid(values)
    mesh = axes.pcolormesh(u, v, shown, shading="nearest", norm=norm, zorder=0.5, rasterized=True)
    bar = figure.colorbar(mesh, ax=axes, location="bottom", shrink=0.8, aspect=30, label=label)
    bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if isinstance(norm, LogNorm):
        bar.ax.xaxis.set_major_locator(LogLocator(subs=_ROUND))
        bar.ax.xaxis.set_minor_locator(NullLocator())


def picture_axes(camera: Camera) -> tuple[Figure, Axes]:
    """Axes in the picture's pixels, v downwards, with the outlines of the picture and of the field of view."""
    width, height = camera.size
    figure, axes = blank(6.4, min(8.0, max(3.6, 5.4 * height / width + 1.5)))
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="u (px)", ylabel="v (px)")
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(True)
    u0, v0 = camera.centre
    rim = camera.image_radius
    axes.plot(u0 + rim * np.cos(_PHI), v0 + camera.aspect * rim * np.sin(_PHI), color=FAINT, linewidth=1)
    axes.plot(u0, v0, marker="+", markersize=10, color=RED, markeredgewidth=1.5)
    return figure, axes


def magnification(error_px: float, length_px: float) -> float:
    """The round factor that draws a typical error about that long; 1 where errors are larger."""
    return max(1.0, round_number(length_px / max(error_px, 1e-9)))


def round_number(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above `value` (1e-9 for anything smaller)."""
    value = max(value, 1e-9)
    power = 10.0 ** math.floor(math.log10(value))
    return float(max(step * power for step in _ROUND if step * power <= value * (1 + 1e-9)))


def _scale_bar(axes: Axes, camera: Camera, length: float, text: str) -> None:
    width, height = camera.size
    u, v = 0.03 * width, 0.965 * height
    axes.plot([u, u + length], [v, v], color=BLUE, linewidth=3, solid_capstyle="butt")
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    axes.text(u, v - 0.02 * height, text, fontsize=10.5, bbox=box)
