"""Figures of a solved mosaic: frames on the sphere, the links between them, and where residuals point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fullsphere.cli.figures import BLUE, COLOURS, DENSE, FAINT, INK, RED, Drawing, blank, styled
from fullsphere.cli.plots_picture import magnification, picture_axes, round_number
from fullsphere.model.camera import Camera
from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Frame, Mosaic
from fullsphere.mosaic.residuals import Residuals, Sights, ThetaBin, by_link

_ALL_SHOWN = 40  # frames: names and outlines of more would hide each other and the picture
_SHOWN = 18  # of those that are more
_CELLS = 16  # arrows along the longer side of a picture
_LEAST = 6  # matches for an arrow, or for a median to be believed
_ARROW = 0.04  # of the picture's longer side: how long a typical arrow is drawn
_ALONG = 60  # points along each side of a footprint
_JUMP_DEG = 180  # between neighbours of an outline: over the picture's edge
_NARROW_DEG = 150, 80  # longitudes and latitudes: frames that look nowhere else are shown larger
_MARGIN = 0.12  # about them, of the larger of both


class View(NamedTuple):
    """The part of the sphere that is shown, degrees: from left to right, from bottom to top."""

    longitudes: tuple[float, float]
    latitudes: tuple[float, float]

    @property
    def whole(self) -> bool:
        """Whether that is the sphere."""
        return self.longitudes[1] - self.longitudes[0] >= 360


WHOLE = View((-180.0, 180.0), (-90.0, 90.0))


def view_of(mosaic: Mosaic) -> View:
    """The part of the sphere that the frames look at, or all of it where they look at much of it."""
    outlines = [_degrees(_rim(frame, mosaic.cameras[frame.camera])) for frame in mosaic.registered]
    if not outlines:
        return WHOLE
    lon, lat = (np.concatenate(angles) for angles in zip(*outlines, strict=True))
    ends = float(lon.min()), float(lon.max()), float(lat.min()), float(lat.max())
    margin = _MARGIN * max(ends[1] - ends[0], ends[3] - ends[2])
    left, right, bottom, top = ends[0] - margin, ends[1] + margin, ends[2] - margin, ends[3] + margin
    if right - left > _NARROW_DEG[0] or max(-bottom, top) > _NARROW_DEG[1] or left < -180 or right > 180:
        return WHOLE
    return View((left, right), (bottom, top))


def contact_sheet(mosaic: Mosaic, view: View, sheet: NDArray[np.uint8] | None) -> Drawing:
    """The frames on the sphere, each with its outline; `sheet` (H, W, 3) is what they show together, if known."""
    step = _step(mosaic.registered)
    with styled():
        figure, axes = _sphere_axes(view)
        if sheet is not None:
            axes.imshow(sheet, extent=(*view.longitudes, *view.latitudes), interpolation="antialiased", zorder=0)
        for k, frame in enumerate(mosaic.registered[::step]):
            colour = COLOURS[k % len(COLOURS)]
            lon, lat = _broken(*_degrees(_rim(frame, mosaic.cameras[frame.camera])))
            axes.plot(lon, lat, color="white", linewidth=2.4, alpha=0.7, zorder=2)
            axes.plot(lon, lat, color=colour, linewidth=1.3, zorder=3)
        _name_frames(axes, mosaic.registered, view)
    return Drawing(
        "contact-sheet",
        "Where the frames look",
        ("The whole sphere, yaw 0 in the middle." if view.whole else "The part of the sphere that the frames show.")
        + " Each line is the edge of a frame's field of view, a dot is where its axis points. What lies inside two "
        "lines or more is seen twice, and holds the frames together."
        + _thinned(step, len(mosaic.registered), "outlined and named"),
        figure,
    )


def link_graph(mosaic: Mosaic, view: View, found: Residuals) -> Drawing:
    """Frames where they look, joined by lines where they share matches."""
    shown = [
        (math.nan if median is None else median, link)
        for median, link in zip(by_link(mosaic, found, _LEAST), mosaic.links, strict=True)
        if mosaic.frames[link.i].registered and mosaic.frames[link.j].registered
    ]
    shown.sort(key=lambda one: -math.inf if math.isnan(one[0]) else one[0])  # the worst on top
    worst = max((median for median, _ in shown if not math.isnan(median)), default=0.0)
    most = max((len(link.pixels_i) for _, link in shown), default=0) or 1
    with styled():
        figure, axes = _sphere_axes(view)
        map_ = ScalarMappable(Normalize(0.0, worst or 1.0), "viridis_r")
        for median, link in shown:
            lon, lat = _between(*(_axis(mosaic.frames[k]) for k in (link.i, link.j)))
            axes.plot(
                lon,
                lat,
                color=FAINT if math.isnan(median) else map_.to_rgba(np.array([median]))[0],
                linewidth=0.6 + 4 * math.sqrt(len(link.pixels_i) / most),
                linestyle="--" if link.verdict == "parallax" else "-",
                zorder=2,
                rasterized=len(shown) > DENSE,
            )
        _name_frames(axes, mosaic.registered, view)
        if shown:
            figure.colorbar(map_, ax=axes, location="bottom", shrink=0.6, aspect=40, label="median residual (px)")
    parallax = any(link.verdict == "parallax" for _, link in shown)
    return Drawing(
        "links",
        "What holds the frames together",
        "A line for each pair of frames that see the same things, thicker with more matches, darker where they agree "
        "less."
        + (" Broken lines: the camera moved between the two, or they show near things." if parallax else "")
        + _thinned(_step(mosaic.registered), len(mosaic.registered), "named"),
        figure,
    )


def arrows(camera: Camera, seen: Sights, name: str) -> Drawing:
    """Median residuals over the picture, magnified."""
    width, height = camera.size
    cell = max(camera.size) / _CELLS
    own = seen.where(np.asarray(np.isfinite(seen.arrow_px).all(1)))
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
        f"Grey: all matches of all frames. In each cell of the picture with {_LEAST} matches or more an arrow: from "
        "where things were seen towards where the other frames and the orientations put them, the median of the cell. "
        "Arrows that run alike are a lens that does not fit, or near things; noise runs every way.",
        figure,
    )


def against_theta(bins: Sequence[ThetaBin], held: bool) -> Drawing:
    """Residuals by the angle off axis."""
    with styled():
        figure, axes = blank(6.4, 3.8)
        theta = np.array([one.theta_deg for one in bins])
        lower, median, upper = (np.array([getattr(one, f"{part}_px") for one in bins]) for part in _QUARTILES)
        if len(bins):
            sure = np.array([one.matches >= 2 * _LEAST for one in bins])
            drawn = [np.where(sure, values, np.nan) for values in (lower, median, upper)]
            axes.fill_between(theta, drawn[0], drawn[2], color=BLUE, alpha=0.2, linewidth=0, label="middle half")
            axes.plot(theta, drawn[1], color=BLUE, marker="o", label="median")
            if not sure.all():
                axes.plot(*(v[~sure] for v in (theta, median)), "o", color=FAINT, mfc="white", label="few matches")
            for one, known in zip(bins, sure, strict=True):
                axes.annotate(
                    str(one.matches),
                    (one.theta_deg, one.upper_px if known else one.median_px),
                    (0, 4),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color=INK,
                )
            axes.legend(loc="upper left")
        axes.set(xlabel="angle off axis (degrees)", ylabel="residual (px)", xlim=(0, None))
        axes.set_ylim(0, 1.35 * float(upper.max()) or 1 if len(bins) else 1)
    which = "Matches that no fit saw" if held else "Matches of the fit (none were held back)"
    return Drawing(
        "theta",
        "Residuals by angle off axis",
        f"{which}, distance on the sphere in pixels, at both places where each was seen; small numbers: how many. A "
        "rise towards the rim is a lens that does not fit there.",
        figure,
    )


_QUARTILES = ("lower", "median", "upper")


def _step(frames: Sequence[Frame]) -> int:
    """One frame in so many is outlined and named."""
    return 1 if len(frames) <= _ALL_SHOWN else -(-len(frames) // _SHOWN)


def _thinned(step: int, count: int, how: str) -> str:
    return "" if step == 1 else f" One in {step} of the {count} frames is {how}."


def _sphere_axes(view: View) -> tuple[Figure, Axes]:
    figure, axes = blank(9.6, 5.4)
    axes.set(xlim=view.longitudes, ylim=view.latitudes, aspect="equal")
    axes.set(xlabel="yaw (degrees)", ylabel="pitch (degrees)")
    if view.whole:
        axes.set_xticks(range(-180, 181, 45))
        axes.set_yticks(range(-90, 91, 30))
    return figure, axes


def _name_frames(axes: Axes, frames: Sequence[Frame], view: View) -> None:
    step = _step(frames)
    left, right = view.longitudes
    for k, frame in enumerate(frames):
        lon, lat = _degrees(_axis(frame)[None])
        named = k % step == 0
        size = 5 if named else 2
        axes.plot(lon, lat, marker="o", markersize=size, color=RED, markeredgecolor="white", mew=size / 8, zorder=5)
        if named:
            place = (float(lon[0]) - left) / (right - left)
            axes.annotate(
                frame.id,
                (float(lon[0]), float(lat[0])),
                (0, 7),
                textcoords="offset points",
                ha="left" if place < 0.05 else "right" if place > 0.95 else "center",
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


def _rim(frame: Frame, camera: Camera) -> FloatArray:
    """Rays (n, 3) in the world along the edge of what a frame sees."""
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
    return np.asarray(rays[np.isfinite(rays).all(-1)])


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
    """A line that ends at one edge of the sphere's picture and goes on from the other."""
    jumps = np.flatnonzero(np.abs(np.diff(lon)) > _JUMP_DEG)
    edge = np.copysign(180.0, lon[jumps])
    beyond = lon[jumps + 1] + 2 * edge
    share = (edge - lon[jumps]) / np.where(beyond == lon[jumps], 1, beyond - lon[jumps])
    level = lat[jumps] + share * (lat[jumps + 1] - lat[jumps])
    between = np.repeat(jumps + 1, 3)
    gap = np.full_like(edge, np.nan)
    return (
        np.insert(lon, between, np.stack([edge, gap, -edge], -1).ravel()),
        np.insert(lat, between, np.stack([level, gap, level], -1).ravel()),
    )
