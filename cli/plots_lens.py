"""Figures of a lens's curve r(theta): beside the classical projections, against other lenses, and how certain it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes

from fullsphere.cli.figures import BLUE, COLOURS, DASHES, FAINT, INK, Drawing, blank, styled
from fullsphere.model.calibration.candidates import Misfit
from fullsphere.model.camera import Camera
from fullsphere.model.lens import (
    Equidistant,
    Equisolid,
    FloatArray,
    Lens,
    Orthographic,
    Perspective,
    Stereographic,
)

_CLASSICAL: tuple[Callable[[float], Lens], ...] = (Perspective, Stereographic, Equidistant, Equisolid, Orthographic)
_AS_FAR_AS = 1.35  # of the radius at the rim: how high the axis of the radii goes
_BIN_DEG = 3.0  # of the angle from the axis, over which residuals are averaged
_SETTING_THE_SCALE = 4  # lenses, best first, that have to fit into the figure
_FEWEST = 5  # points in a bin whose mean is shown


def projection_functions(camera: Camera) -> Drawing:
    """The lens beside the classical projections of the same scale on the axis (Figure 4 of the paper)."""
    lens, edge = camera.lens, camera.half_fov
    scale = float(lens.slope(0.0))
    shown = min(math.pi, max(math.radians(100), edge + math.radians(10)))
    top = _AS_FAR_AS * max(camera.image_radius, scale * edge)
    with styled():
        figure, axes = blank()
        for kind, colour, dash in zip(_CLASSICAL, COLOURS[1:], DASHES[1:], strict=True):
            other = kind(scale)
            theta = np.linspace(0, min(shown, other.theta_max * (1 - 1e-9)), 721)
            radius = other.radius(theta)
            axes.plot(
                np.degrees(theta[radius <= top]),
                radius[radius <= top],
                color=colour,
                linestyle=dash,
                linewidth=1.4,
                label=other.projection,
            )
        theta = np.linspace(0, edge, 721)
        axes.plot(np.degrees(theta), lens.radius(theta), color=BLUE, linewidth=3, label=f"this lens: {lens.projection}")
        axes.axvline(math.degrees(edge), color=FAINT, linewidth=1, linestyle=":")
        axes.set(xlabel="angle from the axis θ (degrees)", ylabel="distance from the centre r (px)")
        axes.set(xlim=(0, math.degrees(shown)), ylim=(0, top))
        axes.legend(loc="upper left")
    return Drawing(
        "projection-functions",
        "Projection functions",
        "The calibrated lens (thick) beside the classical projections that have the same scale on the axis, "
        f"{scale:.1f} px per radian. The dotted line is the edge of the field of view. (Figure 4 of the paper.)",
        figure,
    )


def fit_of_lenses(misfits: Sequence[Misfit], chosen: str, observed_deg: float) -> Drawing:
    """Mean of fitted minus measured radius against theta, for several lenses (Figure 6 of the paper)."""
    ranked = sorted(misfits, key=lambda misfit: (misfit.lens != chosen, misfit.rms_px))
    drawn = ranked[: len(COLOURS)]
    highest = 0.0
    with styled():
        figure, axes = blank(height_in=4.8)
        axes.axhline(0, color=INK, linewidth=0.8)
        for rank, (misfit, colour, dash) in enumerate(zip(drawn, COLOURS, DASHES, strict=False)):
            theta_deg, mean, error = binned(np.degrees(misfit.theta), misfit.radial_px, _BIN_DEG)
            label = f"{misfit.lens} ({misfit.rms_px:.3f} px)"
            if misfit.lens == chosen:
                axes.fill_between(theta_deg, mean - error, mean + error, color=colour, alpha=0.2, linewidth=0)
            width = 2.8 if misfit.lens == chosen else 1.5
            axes.plot(theta_deg, mean, color=colour, linestyle=dash, linewidth=width, label=label)
            if rank < _SETTING_THE_SCALE:
                highest = max(highest, float(np.max(np.abs(mean) + error, initial=0.0)))
        axes.set(xlabel="angle from the axis θ (degrees)", ylabel="fitted − measured radius (px)")
        axes.set(xlim=(0, observed_deg * 1.02), ylim=(-1.25 * highest, 1.25 * highest) if highest else None)
        figure.legend(loc="outside lower center", ncols=2)
    left = ", ".join(f"{misfit.lens} ({misfit.rms_px:.2f})" for misfit in ranked[len(COLOURS) :])
    return Drawing(
        "lens-fit",
        "Fit error of the candidate lenses",
        f"Mean error of the radius in steps of {_BIN_DEG:g} degrees; the band about the thick line is one standard "
        "error of the mean. A line that waves about zero by more than that is a lens of the wrong shape; one that "
        "leaves the picture is off by more than it shows."
        + (f" Worse, and not drawn (rms in px): {left}." if left else "")
        + " (Figure 6 of the paper.)",
        figure,
    )


def curve_sigma(theta_deg: FloatArray, sigma_px: FloatArray, observed_deg: tuple[float, float]) -> Drawing:
    """The standard deviation of r(theta), the range that was seen marked."""
    with styled():
        figure, axes = blank()
        axes.plot(theta_deg, sigma_px, color=BLUE, linewidth=2.4, label="sigma of r(θ)")
        _mark_range(axes, theta_deg, observed_deg)
        axes.set(xlabel="angle from the axis θ (degrees)", ylabel="one standard deviation (px)")
        axes.set(xlim=(0, float(theta_deg[-1])), ylim=(0, 1.15 * float(np.max(sigma_px))))
        axes.legend(loc="upper left")
    return Drawing(
        "curve-sigma",
        "How certain the curve is",
        f"One standard deviation of r(theta). Points were seen from {observed_deg[0]:.1f} to {observed_deg[1]:.1f} "
        "degrees (shaded); where the ground is hatched, the curve is extrapolated by the formula. It holds if the lens "
        "obeys its formula: what the formula cannot follow is in the figure of the fit error, not here.",
        figure,
    )


def _mark_range(axes: Axes, theta_deg: FloatArray, observed_deg: tuple[float, float]) -> None:
    lowest, highest = observed_deg
    edge = float(theta_deg[-1])
    axes.axvspan(lowest, min(highest, edge), color=BLUE, alpha=0.08, linewidth=0, label="points seen")
    label = "no points"
    for start, end in ((0.0, lowest), (highest, edge)):
        if end > start:
            axes.axvspan(start, end, facecolor="none", edgecolor=FAINT, hatch="///", linewidth=0, label=label)
            label = "_again"


def binned(x: FloatArray, y: FloatArray, width: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middle (mean x), mean and standard error of y (n,) in bins of x (n,), where a bin holds enough points."""
    index = np.floor(x / width).astype(int)
    rows = [
        (x[here].mean(), y[here].mean(), y[here].std(ddof=1) / math.sqrt(here.sum()))
        for here in (index == k for k in np.unique(index))
        if here.sum() >= _FEWEST
    ]
    middle, mean, error = np.array(rows).reshape(-1, 3).T
    return middle, mean, error
