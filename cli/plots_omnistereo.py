"""Figures of a turn: the steps of the arm, the light of its frames, the mosaic, its anaglyph, and range."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fullsphere.cli.figures import BLUE, FAINT, GREEN, RED, Drawing, styled
from fullsphere.mosaic.arm import ArmTurn

_NEARNESS = 0.5  # one over the range, in arms: brighter are only things that touch the arm


def steps(turn: ArmTurn) -> Drawing:
    """How far the arm turned from frame to frame."""
    with styled():
        figure = Figure(figsize=(9, 3.2), layout="constrained")
        axes = figure.add_subplot()
        gaps, at = np.degrees(turn.gaps), np.degrees(turn.angles)
        axes.axhline(360 / len(gaps), color=FAINT, linewidth=1, label="even steps")
        axes.plot(at, gaps, color=BLUE, marker=".", markersize=4, linewidth=0.8, label="steps")
        axes.set(xlabel="turn angle (degrees)", ylabel="to the next frame (degrees)", xlim=(0, 360))
        axes.set_ylim(0, 1.15 * float(gaps.max()))
        axes.legend()
    return Drawing(
        "steps",
        "Steps of the arm",
        "From each frame to the next. Where a step is wide a column lies further from any frame: near things are less "
        "sharp there, and beyond the margin of the lens nothing is seen.",
        figure,
    )


def light(turn: ArmTurn, gains: NDArray[np.float32]) -> Drawing:
    """How bright each frame recorded the scene."""
    with styled():
        figure = Figure(figsize=(9, 2.8), layout="constrained")
        axes = figure.add_subplot()
        for channel, (colour, name) in enumerate(((RED, "red"), (GREEN, "green"), (BLUE, "blue"))):
            axes.plot(np.degrees(turn.angles), -np.log2(gains[:, channel]), color=colour, linewidth=1, label=name)
        axes.set(xlabel="turn angle (degrees)", ylabel="EV over the mean", xlim=(0, 360))
        axes.legend(ncols=3)
    return Drawing(
        "light",
        "Light of the frames",
        "How much brighter than the mean each frame recorded the scene; it is evened out in the mosaic.",
        figure,
    )


def mosaic(codes: NDArray[np.uint8]) -> Drawing:
    """The 360 x 360 mosaic, made small."""
    with styled():
        figure = Figure(figsize=(6.4, 6.4), layout="constrained")
        axes = figure.add_subplot()
        axes.imshow(codes, extent=(0, 360, -180, 180), interpolation="antialiased")
        for psi in (-90, 90):
            axes.axhline(psi, color="white", linewidth=0.8, linestyle="--")
        axes.set(xlabel="turn angle (degrees)", ylabel="psi, along the circle of rays (degrees)")
        axes.set_xticks(range(0, 361, 90), [str(a) for a in range(0, 361, 90)])
        axes.set_yticks(range(-180, 181, 90), [str(a) for a in range(-180, 181, 90)])
        axes.grid(visible=False)
    return Drawing(
        "mosaic",
        "The mosaic",
        "A column is the circle of rays at right angles to the camera's axis at one turn angle. Between the dashed "
        "lines is what the left eye sees, beyond them what the right eye sees.",
        figure,
    )


def anaglyph(codes: NDArray[np.uint8]) -> Drawing:
    """Both eyes, for red-cyan glasses."""
    with styled():
        figure, axes = _sphere()
        axes.imshow(codes, extent=(-180, 180, -90, 90), interpolation="antialiased")
    return Drawing(
        "anaglyph",
        "Both eyes",
        "Red is what the left eye sees, cyan the right one. Things coincide in height; the nearer, the further apart.",
        figure,
    )


def nearness(rho: NDArray[np.float32]) -> Drawing:
    """Range as the left eye sees it."""
    with styled():
        figure, axes = _sphere()
        with np.errstate(divide="ignore"):
            near = np.ma.masked_invalid(1 / rho)
        most = min(float(np.percentile(near.compressed(), 99.5)), _NEARNESS) if near.count() else _NEARNESS
        image = axes.imshow(near, extent=(-180, 180, -90, 90), vmin=0, vmax=max(most, 1e-3), cmap="magma")
        axes.set(facecolor="#dddddd")
        bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.6, aspect=40, label="range (arm lengths)")
        ticks = [r for r in (2.5, 3, 4, 5, 7, 10, 20, 50) if 1 / r <= most]
        bar.set_ticks([0, *(1 / r for r in reversed(ticks))], labels=["far", *(f"{r:g}" for r in reversed(ticks))])
    return Drawing(
        "range",
        "Range from the turning axis",
        "Found from the two eyes along rows; grey where the eyes do not agree: beside near things, which hide there "
        "from one eye what the other sees, at the poles, and where there is no texture.",
        figure,
    )


def _sphere() -> tuple[Figure, Axes]:
    """Axes of an equirectangular map."""
    figure = Figure(figsize=(9, 5.2), layout="constrained")
    axes = figure.add_subplot()
    degrees = math.degrees(math.pi)
    axes.set(xlabel="longitude (degrees)", ylabel="latitude (degrees)", xlim=(-degrees, degrees), ylim=(-90, 90))
    axes.set_xticks(range(-180, 181, 60), [str(a) for a in range(-180, 181, 60)])
    axes.set_yticks(range(-90, 91, 45), [str(a) for a in range(-90, 91, 45)])
    axes.grid(visible=False)
    return figure, axes
