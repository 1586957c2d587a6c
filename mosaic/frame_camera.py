"""A calibrated camera for frames that are its pictures at another size."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from fullsphere.model.camera import Camera
from fullsphere.model.errors import InputError
from fullsphere.model.images import picture_size


def frame_camera(camera: Camera, paths: Sequence[Path]) -> Camera:
    """The camera scaled to its frames, where all of them were resized alike; otherwise the camera as it is.

    Scaled it is only if no file has the camera's own size, upright or on its side, and the size that most files have
    is in its proportions to a pixel: a preview of a whole set is registered with the calibration of the full size.
    Only headers are read; files that cannot be are passed over.

    Parameters
    ----------
    camera
        The calibrated camera.
    paths
        The frames' files.
    """
    sizes: Counter[tuple[int, int]] = Counter()
    for path in paths:
        with contextlib.suppress(InputError):
            sizes[picture_size(path)] += 1
    if not sizes or camera.size in sizes or camera.size[::-1] in sizes:
        return camera
    usual, _ = sizes.most_common(1)[0]
    scaled = camera.scaled(usual[0] / camera.size[0])
    return scaled if scaled.size == usual else camera
