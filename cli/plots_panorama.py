"""Figures of a composition: seams, disagreement, coverage, the poles, and exposures before and after."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fullsphere.cli.figures import BLUE, COLOURS, FAINT, ORANGE, RED, Drawing, blank, shown_light, styled
from fullsphere.model.camera import Camera
from fullsphere.model.lens import Stereographic
from fullsphere.model.remap import remap
from fullsphere.model.surface import Equirectangular
from fullsphere.mosaic.agreement import Agreement

_EXTENT = (-180.0, 180.0, -90.0, 90.0)
_POLE_PX = 400
_POLE_HALF_DEG = 50.0
_PALE = 0.25  # of a frame's colour in the map of seams


def seam_map(found: Agreement, owners: NDArray[np.int16], names: list[str]) -> Drawing:
    """Whose picture is shown where, over what all show together."""
    colours = np.array([[int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)] for c in COLOURS], np.float32)
    shown = shown_light(found.light, found.frames > 0) / 255 * (1 - _PALE) + _PALE * colours[owners % len(COLOURS)]
    edges = (owners != np.roll(owners, 1, 1)) | (owners != np.roll(owners, 1, 0))
    edges[0] = False
    shown[edges] = 1
    with styled():
        figure, axes = _sphere()
        axes.imshow(np.clip(shown, 0, 1), extent=_EXTENT, interpolation="antialiased")
        height, width = owners.shape
        for k in np.unique(owners).tolist():
            rows, columns = np.nonzero(owners == k)
            angle = columns / width * 2 * math.pi
            lon = math.degrees(math.atan2(np.sin(angle).mean(), np.cos(angle).mean())) % 360 - 180
            lat = 90 - 180 * float(rows.mean()) / height
            axes.text(lon, lat, names[k], ha="center", fontsize=8, bbox={"facecolor": "white", "alpha": 0.75, "pad": 1})
    return Drawing(
        "seams",
        "Who is shown where",
        "White lines are the seams, colours only tell the frames apart. Seams keep to where frames agree, so they go "
        "round things rather than through them.",
        figure,
    )


def difference_map(found: Agreement) -> Drawing:
    """Where frames disagree."""
    with styled():
        figure, axes = _sphere()
        shown = np.ma.masked_where(found.frames < 2, found.difference)
        image = axes.imshow(shown, extent=_EXTENT, vmin=0, vmax=0.4, cmap="magma", interpolation="antialiased")
        axes.set(facecolor="#dddddd")
        figure.colorbar(image, ax=axes, location="bottom", shrink=0.6, aspect=40, label="largest difference (of white)")
    return Drawing(
        "differences",
        "Where frames disagree",
        "The largest difference between any two frames that see a direction, in square roots of light (white is 1); "
        "grey where only one sees. Bright outlines are parallax or a lens that does not fit, bright areas are things "
        "that moved, or light that is not evened out.",
        figure,
    )


def coverage_map(found: Agreement) -> Drawing:
    """How many frames see each direction."""
    with styled():
        figure, axes = _sphere()
        most = max(int(found.frames.max()), 1)
        image = axes.imshow(found.frames, extent=_EXTENT, vmin=0, vmax=most, cmap="viridis", interpolation="nearest")
        axes.contour(
            np.linspace(-180, 180, found.frames.shape[1]),
            np.linspace(90, -90, found.frames.shape[0]),
            found.frames > 0,
            levels=[0.5],
            colors=[RED],
        )
        figure.colorbar(image, ax=axes, location="bottom", shrink=0.6, aspect=40, label="frames")
    return Drawing(
        "coverage",
        "How many frames see each direction",
        "Inside a red line nobody sees anything: the panorama is transparent there, or filled.",
        figure,
    )


def poles(found: Agreement) -> Drawing:
    """Zenith and nadir, as one sees them looking up and down."""
    half = math.radians(_POLE_HALF_DEG)
    lens = Stereographic(_POLE_PX / 2 / (2 * math.tan(half / 2)))
    camera = Camera(lens, (_POLE_PX, _POLE_PX), ((_POLE_PX - 1) / 2,) * 2, half_fov=half)
    sphere = Equirectangular((found.light.shape[1], found.light.shape[0]))
    picture = shown_light(found.light, found.frames > 0)
    picture[found.frames == 0] = 255
    with styled():
        figure = Figure(figsize=(9.6, 5.0), layout="constrained")
        for k, (title, up) in enumerate((("up", 1.0), ("down", -1.0))):
            camera_from_world = np.array([[1, 0, 0], [0, 0, up], [0, -up, 0]], float)
            view, seen = remap(picture, sphere, camera, camera_from_world)
            view[seen == 0] = 255
            axes = figure.add_subplot(1, 2, k + 1)
            axes.imshow(view)
            axes.set_title(f"looking {title}")
            axes.set_axis_off()
    return Drawing(
        "poles",
        "Zenith and nadir",
        f"To {_POLE_HALF_DEG:g} degrees around them, all frames mixed softly; white is seen by nobody.",
        figure,
    )


def exposures(found: Agreement) -> Drawing:
    """How much brighter one frame of each pair is, before and after."""
    with styled():
        figure, axes = blank(6.4, 3.8)
        before, after = (np.abs([getattr(p, name) for p in found.pairs]) for name in ("recorded_ev", "evened_ev"))
        order = np.argsort(before)[::-1]
        at = np.arange(len(order))
        axes.bar(at - 0.2, before[order], 0.4, color=ORANGE, label="as recorded")
        axes.bar(at + 0.2, after[order], 0.4, color=BLUE, label="evened out")
        axes.axhline(0, color=FAINT, linewidth=1)
        axes.set(xlabel="pairs of frames, the most different first", ylabel="difference of brightness (EV)")
        if len(order):
            axes.legend()
    return Drawing(
        "exposures",
        "Brightness before and after",
        "For each pair of frames that overlap, how much brighter one of them is in the median of what both see: as the "
        "camera recorded it, and with the exposures of the mosaic taken out.",
        figure,
    )


def _sphere() -> tuple[Figure, Axes]:
    """Axes for a picture of the whole sphere."""
    figure, axes = blank(9.6, 5.4)
    axes.grid(visible=False)
    axes.set(xlabel="yaw (degrees)", ylabel="pitch (degrees)")
    return figure, axes
