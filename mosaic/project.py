"""The values of a mosaic: frames, the links between them, and the solved project."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.icc import Profile
from fullsphere.model.lens import FloatArray

Picture = NDArray[Any]
"""Pixels (height, width, channels) as stored: uint8, uint16 or float32."""


class Bracket(NamedTuple):
    """One of the pictures of several exposures that a frame is merged of.

    `image` is where it came from, `sha256` that of its file, and `exposure_ev` how much brighter it recorded the scene
    than the frame has it.
    """

    image: str
    sha256: str
    exposure_ev: float


@dataclasses.dataclass(frozen=True)
class Frame:
    """One picture of the set, and what is known of it.

    Attributes
    ----------
    id
        Name shown to people, unique within the set.
    image
        Where the picture came from, as given.
    size
        Width and height in pixels.
    load
        Opens the picture; called again whenever its pixels are needed.
    sha256
        Of the file, hexadecimal; empty for pictures that are no file.
    reason
        Why the frame is left out; empty while it is not.
    camera_from_world
        Rotation (3, 3) once registered.
    sigma_deg
        One standard deviation of the angle that the frame is turned from the truth, degrees; in the world in which the
        errors of all frames are zero on average.
    exposure_ev
        How much brighter this frame recorded the scene than the reference, in powers of two.
    told_ev
        Exposure by what the camera noted of it, in EV from any one value; None if it did not.
    white_balance
        Beside that, how much stronger it recorded red, green and blue: factors, that of green 1.
    camera
        Index of the camera that took it, among the mosaic's.
    shot
        Frames of one shot were taken at once by the cameras of a rig, and share its pose; empty for a shot of its own.
    crop_px
        Left, top, width and height of the picture within its file, where two circles share one; None for the whole.
    prior
        camera_from_world (3, 3) as it was told beforehand, by a file or the camera; None if it was not.
    gravity
        Unit vector (3,) to the ground in the camera frame as it was told beforehand; None if it was not.
    quarter_turns
        How many quarter turns clockwise bring the picture, as `load` gives it, upright.
    turned
        How many quarter turns clockwise `load` gives the file's own pixels.
    profile
        Gives the colour space of the picture's codes; None for sRGB.
    mask
        Gives the parts of the picture (h, w) to use, where it is not zero; None for all.
    mask_image
        Where the mask came from; empty for none.
    brackets
        What the picture is merged of, `image` among them; empty for a picture that is a file's own.
    response_ev
        The tone curve that the brackets' camera wrote instead of that of their profile (`camera_response`); empty for
        none.
    """

    id: str
    image: str
    size: tuple[int, int]
    load: Callable[[], Picture] = dataclasses.field(repr=False, compare=False)
    sha256: str = ""
    reason: str = ""
    camera_from_world: FloatArray | None = None
    sigma_deg: float | None = None
    exposure_ev: float = 0.0
    told_ev: float | None = None
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    camera: int = 0
    shot: str = ""
    crop_px: tuple[int, int, int, int] | None = None
    prior: FloatArray | None = dataclasses.field(default=None, repr=False)
    gravity: FloatArray | None = dataclasses.field(default=None, repr=False)
    quarter_turns: int = 0
    turned: int = 0
    profile: Callable[[], Profile] | None = dataclasses.field(default=None, repr=False, compare=False)
    mask: Callable[[], NDArray[np.uint8]] | None = dataclasses.field(default=None, repr=False, compare=False)
    mask_image: str = ""
    brackets: tuple[Bracket, ...] = ()
    response_ev: tuple[float, ...] = ()

    @property
    def images(self) -> tuple[str, ...]:
        """All that the picture comes from."""
        return tuple(bracket.image for bracket in self.brackets) or (self.image,)

    @property
    def registered(self) -> bool:
        """Whether the frame has a place on the sphere."""
        return self.camera_from_world is not None and not self.reason

    def left_out(self, reason: str) -> Frame:
        """The frame marked as left out, with the reason in plain words."""
        return dataclasses.replace(self, reason=reason, camera_from_world=None, sigma_deg=None)


@dataclasses.dataclass(frozen=True)
class Link:
    """Two frames i < j that see the same things, and the matched pixels (n, 2) in each.

    `j_from_i` (3, 3) turns rays of camera i into rays of camera j.  `held_i` and `held_j` (m, 2) are matches that no
    fit ever sees, for an honest residual.  `verdict` says how the two frames stand to each other: "rotation"
    or "parallax" (the camera moved between them, or they show near things).
    """

    i: int
    j: int
    pixels_i: FloatArray = dataclasses.field(repr=False)
    pixels_j: FloatArray = dataclasses.field(repr=False)
    j_from_i: FloatArray = dataclasses.field(repr=False)
    held_i: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 2)), repr=False)
    held_j: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 2)), repr=False)
    verdict: str = "rotation"

    def kept(self, keep: NDArray[np.bool_]) -> Link:
        """The link with only the matches marked in `keep` (n,)."""
        return dataclasses.replace(self, pixels_i=self.pixels_i[keep], pixels_j=self.pixels_j[keep])


@dataclasses.dataclass(frozen=True)
class Mosaic:
    """A solved project: a panorama is a pure function of it.

    Attributes
    ----------
    cameras
        The cameras that took the frames.
    frames
        In the order given, those left out included.
    links
        Between registered frames, by index into `frames`.
    vignetting_ev
        (w1, w2) of each camera: its lens passes 2^(w1 s + w2 s^2) of the light, s = (theta/half_fov)^2; empty for none.
    shade_ev
        What the edge of each camera's lens takes beside: EV at the knots of `edge_shade`; empty for none.
    level
        How up was found: "vertical-lines", "gravity", "camera-x-axes" or "by-hand"; "hugin" where up is what it was in
        a Hugin project, "none" where the world is the first frame's.
    self_calibrated
        Whether the camera was estimated from the frames themselves.
    quality
        Figures for people and programs, by name.
    camera_from_rig
        For each camera its rotation (3, 3) on a rig of several; empty where there is one camera.
    camera_covariances
        Of each camera's values (P, P), in the order of its `parameter_names`, where they were estimated.
    diagnosis
        What was found out about the set, in plain words, the most important first.
    """

    cameras: tuple[Camera, ...]
    frames: tuple[Frame, ...]
    links: tuple[Link, ...]
    vignetting_ev: tuple[tuple[float, float], ...] = ()
    shade_ev: tuple[tuple[float, ...], ...] = ()
    level: str = "none"
    self_calibrated: bool = False
    quality: dict[str, float] = dataclasses.field(default_factory=dict)
    camera_from_rig: tuple[FloatArray, ...] = ()
    camera_covariances: tuple[FloatArray, ...] = dataclasses.field(default=(), repr=False)
    diagnosis: tuple[str, ...] = ()

    @property
    def camera(self) -> Camera:
        """The camera that took every frame, where there is one."""
        return self.cameras[0]

    def vignetting_of(self, camera: int) -> tuple[float, float]:
        """(w1, w2) of the camera with this index; see `vignetting_ev`."""
        return self.vignetting_ev[camera] if self.vignetting_ev else (0.0, 0.0)

    def shade_of(self, camera: int) -> tuple[float, ...]:
        """EV at the knots of the camera with this index; see `shade_ev`."""
        return self.shade_ev[camera] if self.shade_ev else ()

    @property
    def registered(self) -> tuple[Frame, ...]:
        """The frames that have a place on the sphere."""
        return tuple(f for f in self.frames if f.registered)
