"""Compares the projections of the paper: where each images a ray, and how far each can see.

    python 04_lens_curves.py

All are scaled to the same r at 60 degrees, so that the table shows the shapes.  A dash stands where the lens
sees no more: there r(theta) stops growing, or runs off to infinity.
"""

import math

import numpy as np

from fullsphere.model import (
    BaksteinPajdla,
    Camera,
    Equidistant,
    Equisolid,
    Lens,
    Orthographic,
    Perspective,
    ScaledStereographic,
    Stereographic,
)

AT_60_DEG_PX = 600.0
THETA_DEG = (15, 30, 45, 60, 75, 90, 95, 120, 150)


def main() -> None:
    shapes: list[Lens] = [
        Perspective(1.0),
        Stereographic(1.0),
        Equidistant(1.0),
        Equisolid(1.0),
        Orthographic(1.0),
        ScaledStereographic(1.0, 1.8),
        BaksteinPajdla(1.35, 2.11, 0.42, 1.13),
    ]
    lenses = [shape.scaled(AT_60_DEG_PX / float(shape.radius(math.radians(60)))) for shape in shapes]
    print("r in pixels at theta" + "".join(f"{angle:7d}" for angle in THETA_DEG) + "   sees up to (degrees off axis)")
    for lens in lenses:
        radius = lens.radius(np.radians(THETA_DEG))
        inside = np.radians(THETA_DEG) < lens.theta_max
        cells = [f"{r:7.1f}" if seen else f"{'-':>7}" for r, seen in zip(radius, inside, strict=True)]
        print(f"{lens.projection:20}{''.join(cells)}   {math.degrees(lens.theta_max):.1f}")

    wide = Camera(lenses[-1], (2000, 2000), (999.5, 999.5), half_fov=math.radians(95))
    behind = [math.sin(math.radians(95)), 0.0, math.cos(math.radians(95))]
    u, v = wide.project(behind)
    print(f"a ray 95 degrees off axis, z = {behind[2]:.3f}, meets the picture at ({u:.1f}, {v:.1f})")
    print(f"and back: {np.round(wide.unproject([u, v]), 12)}")


if __name__ == "__main__":
    main()
