"""What a viewer needs to know of a picture, by the projection that it is in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fullsphere.model.camera import Projection


def viewer_metadata(target: Projection) -> dict[str, Any]:
    """GPano attributes for the sphere or a window of it, whose pixels are square; none for other pictures."""
    from fullsphere.model.images import gpano
    from fullsphere.model.surface import Equirectangular

    if not isinstance(target, Equirectangular):
        return {}
    if target.whole:
        return gpano(target.size)
    (left, right), (bottom, top), (width, height) = target.longitudes, target.latitudes, target.size
    per_radian = width / (right - left)
    whole = (2 * round(math.pi * per_radian), round(math.pi * per_radian))
    x, y = round((left + math.pi) * per_radian), round((math.pi / 2 - top) * per_radian)
    square = abs(height / (top - bottom) / per_radian - 1) < 0.5 / max(width, height)
    inside = 0 <= x <= whole[0] - width and 0 <= y <= whole[1] - height
    return gpano(whole, (x, y, width, height)) if square and inside else {}
