"""What the picture of a printed disc is: not an ellipse round the image of its centre, but an egg beside it.

The centre of gravity of a disc's image is not the image of the disc's centre, neither in perspective (Heikkila 2000)
nor through a fisheye: the nearer half is larger.  Once camera and pose are known, the difference is known too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.calibration.boards import CirclesGrid
from fullsphere.model.camera import Projection
from fullsphere.model.lens import FloatArray

_VERTICES = 256  # the polygon is smaller than the disc, and the offset too short, by one part in 10000


def centre_offset(
    camera: Projection,
    camera_from_target: FloatArray,
    translation: FloatArray,
    board: CirclesGrid,
    marks: NDArray[np.intp],
) -> FloatArray:
    """How far the centres of gravity of the discs' images lie from the images of the discs' centres.

    Subtract it from measured centres of gravity, then solve again; it changes little with the pose, so once is enough
    unless the first calibration was far off.

    Parameters
    ----------
    camera
        The camera, as far as it is known.
    camera_from_target, translation
        Rotation (3, 3) and shift (3,) in mm of the view: ray = camera_from_target @ point + translation.
    board
        The grid.
    marks
        Numbers (n,) of the discs.

    Returns
    -------
    (n, 2) pixels; NaN where a disc is not wholly in the field of view.
    """
    centres = board.marks_on_paper()[marks]
    turn = 2 * np.pi * np.arange(_VERTICES) / _VERTICES
    rim = board.diameter_mm / 2 * np.stack([np.cos(turn), np.sin(turn)], -1)
    pixels = [
        camera.project(board.placement.lift(points) @ camera_from_target.T + translation)
        for points in (centres[:, None] + rim, centres)
    ]
    return _centre_of_gravity(pixels[0] - pixels[1][:, None])


def _centre_of_gravity(polygons: FloatArray) -> FloatArray:
    """Of polygons (n, k, 2), by the signed triangles from the origin to each side."""
    following = np.roll(polygons, -1, axis=1)
    area = polygons[..., 0] * following[..., 1] - polygons[..., 1] * following[..., 0]
    moments = (area[..., None] * (polygons + following)).sum(1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(moments / (3 * area.sum(1)[:, None]), float)
