"""Figures of a solved mosaic: frames on the sphere, the links between them, and where residuals point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fullsphere.cli.figures import BLUE, COLOURS, FAINT, INK, RED, Drawing, blank, styled
from fullsphere.cli.plots_picture import magnification, picture_axes, round_number
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.residuals import Residuals, ThetaBin

_NAMED = 40  # frames: more names would hide each other
_CELLS = 16  # arrows along the longer side of a picture
_LEAST = 4  # matches for an arrow
_ARROW = 0.04  # of the picture's longer side: how long a typical arrow is drawn
_ALONG = 60  # points along each side of a footprint
_JUMP_DEG = 180  # between neighbours of an outline: over the picture's edge


def contact_sheet(mosaic: Mosaic, sheet: NDArray[np.uint8] | None) -> Drawing:
    """The frames on the sphere, each with its outline; `sheet` (H, W, 3) is what they show together, if known."""
    with styled():
        figure, axes = _sphere_axes()
        if sheet is not None:
            axes.imshow(sheet, extent=(-180, 180, -90, 90), interpolation="antialiased", zorder=0)
        for k, frame in enumerate(mosaic.registered):
            colour = COLOURS[k % len(COLOURS)]
            lon, lat = _outline(frame, mosaic.cameras[frame.camera])
            axes.plot(lon, lat, color="white", linewidth=2.4, alpha=0.7, zorder=2)
            axes.plot(lon, lat, color=colour, linewidth=1.3, zorder=3)
        _name_frames(axes, mosaic.registered)
    return Drawing(
        "contact-sheet",
        "Where the frames look",
        "The whole sphere, yaw 0 in the middle. Each line is the edge of a frame's field of view, a dot with "
        "the frame's name is where its axis points. What lies inside two lines or more is seen twice, and holds the "
        "frames together.",
        figure,
    )


def link_graph(mosaic: Mosaic, found: Residuals) -> Drawing:
    """Frames where they look, joined by lines where they share matches."""
    medians, counts = [], []
    for link in mosaic.links:
        own = found.where((found.i == link.i) & np.asarray(found.j == link.j))
        own = own.where(own.held) if own.held.sum() >= _LEAST else own
        medians.append(float(np.median(own.distance_px)) if own.distance_px.size else math.nan)
        counts.append(len(link.pixels_i))
    with styled():
        figure, axes = _sphere_axes()
        top = float(np.nanmax(medians)) if np.isfinite(medians).any() else 1.0
        norm = Normalize(0.0, top or 1.0)
        map_ = ScalarMappable(norm, "viridis_r")
        most = max(counts, default=1)
        parallax = False
        order = np.argsort([-m if math.isfinite(m) else 0 for m in medians])[::-1]
        for at in order.tolist():
            link = mosaic.links[at]
            ends = [mosaic.frames[k] for k in (link.i, link.j)]
            if not all(frame.registered for frame in ends):
                continue
            lon, lat = _between(*(_axis(frame) for frame in ends))
            colour = map_.to_rgba(medians[at]) if math.isfinite(medians[at]) else FAINT
            broken = link.verdict == "parallax"
            parallax |= broken
            width = 0.6 + 4 * math.sqrt(counts[at] / most)
            axes.plot(lon, lat, color=colour, linewidth=width, linestyle="--" if broken else "-", zorder=2)
        _name_frames(axes, mosaic.registered)
        if mosaic.links:
            figure.colorbar(map_, ax=axes, location="bottom", shrink=0.6, aspect=40, label="median residual (px)")
    return Drawing(
        "links",
        "What holds the frames together",
        "A line for each pair of frames that see the same things, thicker with more matches, darker where they agree "
        "less." + (" Broken lines: the camera moved between the two, or they show near things." if parallax else ""),
        figure,
    )


def arrows(camera: Camera, found: Residuals, name: str) -> Drawing:
    """Mean residuals over the picture, magnified."""
    width, height = camera.size
    cell = max(camera.size) / _CELLS
    own = found.where(np.asarray(np.isfinite(found.arrow_px).all(1)))
    places, means = [], []
    keys = np.floor(own.pixels / cell).astype(int)
    for key in np.unique(keys, axis=0) if len(keys) else []:
        chosen = np.array((keys == key).all(1))
        if chosen.sum() >= _LEAST:
            places.append(own.pixels[chosen].mean(0))
            means.append(np.median(own.arrow_px[chosen], axis=0))
    at, mean = np.reshape(places, (-1, 2)), np.reshape(means, (-1, 2))
    typical = float(np.median(np.linalg.norm(mean, axis=1))) if len(mean) else 1.0
    times = magnification(typical, _ARROW * max(camera.size))
    with styled():
        figure, axes = picture_axes(camera)
        if len(own.pixels):
            axes.plot(*own.pixels.T, linestyle="none", marker=".", markersize=1, color=FAINT, rasterized=True)
        if len(at):
            axes.quiver(*at.T, *(times * mean).T, angles="xy", scale_units="xy", scale=1, color=BLUE, width=0.003)
        length = round_number(2 * typical)
        u, v = 0.03 * width, 0.965 * height
        axes.plot([u, u + times * length], [v, v], color=BLUE, linewidth=3, solid_capstyle="butt")
        axes.text(u, v - 0.02 * height, f"{length:g} px", fontsize=10.5)
    return Drawing(
        name,
        f"Residuals over the picture, magnified {times:g} times",
        f"Grey: all matches. In each cell with {_LEAST} matches or more an arrow: from where things were "
        "seen towards where the other frames and the orientations put them, the median of the cell. Arrows that run "
        "alike are a lens that does not fit, or near things; noise runs every way.",
        figure,
    )


def against_theta(bins: Sequence[ThetaBin], held: bool) -> Drawing:
    """Residuals by the angle off axis."""
    with styled():
        figure, axes = blank(6.4, 3.8)
        theta = np.array([one.theta_deg for one in bins])
        lower, median, upper = (np.array([getattr(one, f"{part}_px") for one in bins]) for part in _QUARTILES)
        if len(bins):
            axes.fill_between(theta, lower, upper, color=BLUE, alpha=0.2, linewidth=0, label="middle half")
            axes.plot(theta, median, color=BLUE, marker="o", label="median")
            for one in bins:
                axes.annotate(
                    str(one.matches),
                    (one.theta_deg, one.upper_px),
                    (0, 4),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color=FAINT,
                )
            axes.legend(loc="upper left")
        axes.set(xlabel="angle off axis (degrees)", ylabel="residual (px)", xlim=(0, None))
        axes.set_ylim(0, 1.25 * float(upper.max()) if len(bins) else 1)
    which = "Matches that no fit saw" if held else "Matches of the fit (none were held back)"
    return Drawing(
        "theta",
        "Residuals by angle off axis",
        f"{which}, distance on the sphere in pixels; small numbers: how many. A rise towards the rim is a lens that "
        "does not fit there.",
        figure,
    )


_QUARTILES = ("lower", "median", "upper")


def _sphere_axes() -> tuple[Figure, Axes]:
    figure, axes = blank(9.6, 5.4)
    axes.set(xlim=(-180, 180), ylim=(-90, 90), aspect="equal", xlabel="yaw (degrees)", ylabel="pitch (degrees)")
    axes.set_xticks(range(-180, 181, 45))
    axes.set_yticks(range(-90, 91, 30))
    return figure, axes


def _name_frames(axes: Axes, frames: Sequence[Frame]) -> None:
    step = -(-len(frames) // _NAMED)
    for k, frame in enumerate(frames):
        lon, lat = _degrees(_axis(frame)[None])
        axes.plot(lon, lat, marker="o", markersize=5, color=RED, markeredgecolor="white", zorder=5)
        if k % step == 0:
            axes.annotate(
                frame.id,
                (float(lon[0]), float(lat[0])),
                (0, 7),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color=INK,
                zorder=6,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1},
            )


def _axis(frame: Frame) -> FloatArray:
    """Where a frame looks, in the world."""
    assert frame.camera_from_world is not None
    return np.asarray(frame.camera_from_world[2])


def _degrees(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitude and latitude of rays (n, 3)."""
    lon = np.rad2deg(np.arctan2(rays[:, 0], rays[:, 2]))
    return lon, np.rad2deg(np.arcsin(np.clip(-rays[:, 1], -1, 1)))


def _outline(frame: Frame, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """The edge of what a frame sees, broken where it goes over the edge of the sphere's picture."""
    assert frame.camera_from_world is not None
    (width, height), (u0, v0) = camera.size, camera.centre
    phi = np.linspace(0, 2 * math.pi, 4 * _ALONG + 1)
    u = u0 + camera.image_radius * np.cos(phi)
    v = v0 + camera.aspect * camera.image_radius * np.sin(phi)
    # as far out as the picture goes in that direction
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.minimum.reduce(
            [
                np.ones_like(phi),
                *(
                    np.where(side * (x - x0) > 0, side * (edge - x0) / (side * (x - x0)), 1.0)
                    for x, x0, last in ((u, u0, width - 0.5), (v, v0, height - 0.5))
                    for side, edge in ((1, last), (-1, -0.5))
                ),
            ]
        )
    reach *= 1 - 1e-9
    rays = camera.unproject(np.stack([u0 + reach * (u - u0), v0 + reach * (v - v0)], -1)) @ frame.camera_from_world
    lon, lat = _degrees(rays)
    return _broken(lon, lat)


def _between(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The great circle from one direction to another."""
    share = np.linspace(0, 1, _ALONG)[:, None]
    angle = math.acos(float(np.clip(a @ b, -1, 1)))
    if math.sin(angle) < 1e-6:
        b = b + 1e-3 * np.roll(a, 1)  # opposite or alike: any way will do
        b = b / np.linalg.norm(b)
        angle = math.acos(float(np.clip(a @ b, -1, 1)))
    rays = (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / max(math.sin(angle), 1e-9)
    return _broken(*_degrees(rays))


def _broken(lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    jumps = np.flatnonzero(np.abs(np.diff(lon)) > _JUMP_DEG) + 1
    return np.insert(lon, jumps, np.nan), np.insert(lat, jumps, np.nan)
