"""What a budget of memory leaves for the frames of a turn and for its mosaic."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from fullsphere.model.camera import Camera
from fullsphere.model.errors import ResourceError
from fullsphere.mosaic.assembly import COLUMNS
from fullsphere.mosaic.turn_views import keypoints_for

_PROGRAM_BYTES = 300 * 10**6  # Python, the libraries and the compiled kernels, without any picture
_FEATURES_BYTES = 105 * 10**6  # while keypoints are looked for in a frame, whatever its size
_READ_AHEAD = 4  # frames at once at most
_COPIES = 4  # of a frame of four samples: decoded, in its colour space, with its border
_PER_KEYPOINT = 600  # with its matches
_PER_COLUMN_PX = 100  # of the mosaic: rays, positions, codes, light
_BANDS, _BAND = 4, 256  # of rows that are written: four samples, and what an encoder makes of them
_PER_RANGE_PX, _RANGE_WIDTH = 70, 2048  # while eyes are matched, half as high as wide


def left_for_pictures(memory: int, camera: Camera, frames: int, width: int, dtype: DTypeLike, threads: int) -> int:
    """The bytes that are left of `memory` for rings of frames and for the mosaic.

    Parameters
    ----------
    memory
        Bytes that the run may take.
    camera, frames
        That took the frames, and how many there are.
    width, dtype
        Of the mosaic.
    threads
        That work side by side.

    Raises
    ------
    ResourceError
        If there is not even enough to make it with all of them on the disk; says the least that is needed.
    """
    opened = camera.size[0] * camera.size[1] * 4 * np.dtype(dtype).itemsize * _COPIES
    reading = min(threads, _READ_AHEAD) * (_FEATURES_BYTES + opened)
    assembling = threads * (opened + COLUMNS * width * _PER_COLUMN_PX)
    writing = _BANDS * _BAND * width * 4 * np.dtype(dtype).itemsize
    matching = min(width, _RANGE_WIDTH) ** 2 // 2 * _PER_RANGE_PX
    keypoints = frames * keypoints_for(frames) * _PER_KEYPOINT
    least = _PROGRAM_BYTES + keypoints + max(reading, assembling, writing, matching)
    if memory < least:
        across, down = camera.size
        raise ResourceError(
            f"--memory {_in_mb(memory)} is too little for {frames} frames of {across} x {down} pixels and a mosaic "
            f"{width} wide; give it at least {_in_mb(least)}, or choose a smaller --size or fewer --threads"
        )
    return memory - least


def _in_mb(count: int) -> str:
    return f"{-(-count // 10**6)}MB"
