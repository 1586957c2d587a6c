"""Words that several commands use for the same things."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fullsphere.model.camera import Camera


def camera_lines(camera: Camera) -> list[str]:
    """Lens, values, centre and field of view."""
    values = ", ".join(f"{p.key} {v:.7g}" for p, v in zip(camera.lens.parameters, camera.lens.values, strict=True))
    return [
        f"{camera.lens.projection} lens ({values}), for pictures of {camera.size[0]} x {camera.size[1]} pixels",
        f"centre ({camera.centre[0]:.2f}, {camera.centre[1]:.2f}) px, aspect {camera.aspect:.5f}, field of view "
        f"{2 * math.degrees(camera.half_fov):.1f} degrees, {camera.image_radius:.1f} px at its edge",
    ]


def printable(value: Any) -> str:
    """A value from a file as one line that a terminal can show: it may hold control characters."""
    return "".join(c if c.isprintable() else "?" for c in str(value))
