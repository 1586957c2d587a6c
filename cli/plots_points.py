"""Figures of what is left after the fit: error by point and by angle, its distribution, its systematic part."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from fullsphere.cli.figures import BLUE, DENSE, FAINT, INK, RED, SKY, Drawing, blank, styled
from fullsphere.model.calibration.trends import Trend
from fullsphere.model.calibration.verification import ChiSquare
from fullsphere.model.lens import FloatArray

_LAST = 16  # normalised squared error at the right edge: chance sends 3 of 10 000 points beyond
_MOST_VIEWS_NAMED = 40  # boundaries between more views would hide the points


def error_by_point(error_px: FloatArray, used: NDArray[np.bool_], view: NDArray[np.intp], rms_px: float) -> Drawing:
    """Length of the residual (n,) of each point in the order of the views (n,) (Figures 9b and 11a of the paper)."""
    with styled():
        figure, axes = blank()
        _scatter(axes, np.arange(1.0, len(error_px) + 1), error_px, used, rms_px)
        first = np.flatnonzero(np.diff(view)) + 1.5
        if len(first) < _MOST_VIEWS_NAMED:
            for boundary in first:
                axes.axvline(boundary, color=FAINT, linewidth=0.5, zorder=0)
        axes.set(xlabel="point, view after view", ylabel="reprojection error (px)", xlim=(0, len(error_px) + 1))
    return Drawing(
        "error-by-point",
        "Error of each point",
        "Distance between measured and reprojected point; thin lines part the views. A view that stands out was "
        "blurred, moved, or has a bent target. (Figures 9b and 11a of the paper.)",
        figure,
    )


def error_by_theta(error_px: FloatArray, used: NDArray[np.bool_], theta: FloatArray, rms_px: float) -> Drawing:
    """Length of the residual (n,) against the angle from the axis (n,), radians."""
    with styled():
        figure, axes = blank()
        _scatter(axes, np.degrees(theta), error_px, used, rms_px)
        axes.set(xlabel="angle from the axis θ (degrees)", ylabel="reprojection error (px)")
        axes.set_xlim(0, 1.02 * math.degrees(float(np.nanmax(theta))))
    return Drawing(
        "error-by-theta",
        "Error against the angle from the axis",
        "The same distances by the angle at which the point was seen. Errors that grow towards the rim are blur, or a "
        "lens whose formula ends too early.",
        figure,
    )


def chi_square(test: ChiSquare) -> Drawing:
    """Histogram of normalised squared errors and the density that noise would give (Figure 11b of the paper)."""
    edges = np.linspace(0, _LAST, 2 * _LAST + 1)
    counts, _ = np.histogram(np.minimum(test.values, _LAST), edges)
    beyond = int(np.count_nonzero(test.values > _LAST))
    with styled():
        figure, axes = blank()
        axes.stairs(
            counts, edges, fill=True, facecolor=SKY, edgecolor=BLUE, linewidth=1, label=f"{len(test.values)} points"
        )
        s = np.linspace(0, _LAST, 400)
        noise = len(test.values) * (edges[1] - edges[0]) * 0.5 * np.exp(-s / 2)
        axes.plot(s, noise, color=RED, linewidth=2.2, label="pure noise: χ² with 2 degrees of freedom")
        axes.set(xlabel="squared error over variance, (du² + dv²)/σ²", ylabel="points", xlim=(0, _LAST), ylim=(0, None))
        axes.legend(loc="upper right", title=_stated(test.p_value))
    tail = f" {beyond} points lie beyond the right edge and stand in the last bar." if beyond else ""
    return Drawing(
        "chi-square",
        "Whether the errors are noise",
        "Squared errors of the points that a fit to the other half never saw, over their variance, and what normally "
        f"distributed noise of one size would give (line).{tail} A small p says that they are not such noise; a long "
        "tail is outliers, or blur in some views. A large p does not say that the curve is right. (Figure 11b of the "
        "paper.)",
        figure,
    )


def trend(radial: Trend, tangential: Trend) -> Drawing:
    """Mean radial and tangential residual, with errors, against the same angle."""
    against = radial.against
    about = {"theta": "angle from the axis θ (degrees)", "phi": "angle round the axis φ (degrees)"}[against]
    with styled():
        figure, axes = blank()
        axes.axhline(0, color=INK, linewidth=0.8)
        for part, shift, colour, marker, dash in ((radial, -0.1, BLUE, "o", "-"), (tangential, 0.1, RED, "s", "--")):
            bins = part.bins
            width = bins.edges_deg[:, 1] - bins.edges_deg[:, 0]
            axes.errorbar(
                bins.centre_deg + shift * width,  # side by side, or their bars hide each other
                bins.mean_px,
                bins.error_px,
                color=colour,
                marker=marker,
                linestyle=dash,
                linewidth=1.3,
                elinewidth=1,
                capsize=2.5,
                label=f"{part.part} ({_stated(part.p_value)})",
            )
        axes.set(xlabel=about, ylabel="mean residual (px)")
        if against == "phi":
            axes.set_xticks(range(-180, 181, 45))
        figure.legend(loc="outside lower center", ncols=2)
    meaning = {
        "theta": "A radial wave means that the formula of the lens does not follow its curve.",
        "phi": "A wave means that the lens is not round about its axis, or that the target is bent.",
    }[against]
    return Drawing(
        f"trend-{against}",
        f"Systematic error against {'the angle from the axis' if against == 'theta' else 'the angle round the axis'}",
        "Mean residual outwards (radial) and along the circle (tangential); bars are what chance alone gives, one "
        f"standard deviation. {meaning}",
        figure,
    )


def probability(p: float) -> str:
    """A p-value for people: two digits, and never a row of noughts."""
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def _stated(p: float) -> str:
    shown = probability(p)
    return f"p {shown}" if shown.startswith("<") else f"p = {shown}"


def _scatter(axes: Axes, x: FloatArray, error_px: FloatArray, used: NDArray[np.bool_], rms_px: float) -> None:
    dense = len(x) > DENSE
    axes.plot(
        x[used], error_px[used], linestyle="none", marker=".", markersize=2.5 if dense else 5, color=BLUE,
        rasterized=dense, label=f"{np.count_nonzero(used)} points",
    )  # fmt: skip
    top = 1.25 * max(float(np.max(error_px[used], initial=rms_px)), 4 * rms_px)
    for chosen, marker, where in ((error_px <= top, "x", ""), (error_px > top, "^", " beyond the top")):
        here = ~used & chosen  # without those that the lens does not image at all
        if here.any():
            axes.plot(
                x[here], np.minimum(error_px[here], 0.98 * top), linestyle="none", marker=marker, color=RED,
                label=f"{np.count_nonzero(here)} rejected{where}",
            )  # fmt: skip
    axes.axhline(rms_px, color=INK, linewidth=1, linestyle="--", label=f"rms {rms_px:.3f} px")
    axes.set_ylim(0, top)
    axes.figure.legend(loc="outside lower center", ncols=2)
