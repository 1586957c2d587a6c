"""The orientation that a camera notes in its files, as quarter turns and as rotations.

Frames are used as the sensor saw them: how the camera was held is part of a frame's rotation.  The tag only tells, to a
quarter turn, which side of the picture is up.
"""

from __future__ import annotations

import numpy as np

from fullsphere.model.lens import FloatArray

# EXIF (CIPA DC-008, tag 274).  2, 4, 5 and 7 also mirror for show, sideways after the turn: up stays where it is.
_QUARTER_TURNS = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 1, 7: 3, 8: 3}

_COSINES, _SINES = (1, 0, -1, 0), (0, 1, 0, -1)


def quarter_turns(orientation: int) -> int:
    """Clockwise quarter turns, 0 to 3, after which a picture of this EXIF orientation (1 to 8) is upright."""
    return _QUARTER_TURNS.get(orientation, 0)


def turned_from_stored(turns: int) -> FloatArray:
    """Rotation (3, 3) of the rays of a camera into those of the picture turned clockwise by so many quarter turns.

    It is Rz: what was to the right (x) is below (y) after one.
    """
    c, s = _COSINES[turns % 4], _SINES[turns % 4]
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], float)
