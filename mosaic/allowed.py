"""Where keypoints of a frame may lie."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.camera import Camera
from fullsphere.model.circle import ImageCircle
from fullsphere.mosaic.project import Frame, Picture

_RIM = 0.985  # of the image circle's radius: beyond it the rim itself would give keypoints


def allowed_pixels(
    frame: Frame, picture: Picture, camera: Camera | None = None, circle: ImageCircle | None = None
) -> NDArray[np.uint8]:
    """Mask (h, w) that is not zero inside the image circle, the frame's own mask, and where it is not transparent.

    Parameters
    ----------
    frame
        Whose mask counts.
    picture
        Its pixels.
    camera, circle
        Either tells the image circle.
    """
    height, width = picture.shape[:2]
    allowed = np.full((height, width), 255, np.uint8)
    aspect = 1.0
    if camera is not None:
        circle, aspect = ImageCircle(camera.centre, camera.image_radius), camera.aspect
    if circle is not None:
        inner = circle._replace(radius=_RIM * circle.radius)
        allowed[~inner.covers((width, height), aspect)] = 0
    if picture.shape[2] == 4:
        allowed[picture[..., 3] == 0] = 0
    if frame.mask is not None:
        allowed[frame.mask() == 0] = 0
    return allowed
