"""Every radial lens projection r(theta) of the program, and their table.

The formulas stand in `lenses_classical.py`, `lenses_polynomial.py` and `lenses_spherical.py`, what they have in common
in `radial.py`; everybody else imports from here.
"""

from __future__ import annotations

from fullsphere.model.lenses_classical import (
    BaksteinPajdla,
    Equidistant,
    Equisolid,
    Orthographic,
    Perspective,
    ScaledStereographic,
    Stereographic,
    Thoby,
)
from fullsphere.model.lenses_polynomial import Brown, KannalaBrandt, Scaramuzza
from fullsphere.model.lenses_spherical import DoubleSphere, EnhancedUnifiedCamera, UnifiedCamera
from fullsphere.model.radial import FloatArray, Lens, Parameter, angle_of_radius

__all__ = [
    "LENSES",
    "BaksteinPajdla",
    "Brown",
    "DoubleSphere",
    "EnhancedUnifiedCamera",
    "Equidistant",
    "Equisolid",
    "FloatArray",
    "KannalaBrandt",
    "Lens",
    "Orthographic",
    "Parameter",
    "Perspective",
    "ScaledStereographic",
    "Scaramuzza",
    "Stereographic",
    "Thoby",
    "UnifiedCamera",
    "angle_of_radius",
]

LENSES: dict[str, type[Lens]] = {
    lens.projection: lens
    for lens in (
        Perspective,
        Stereographic,
        Equidistant,
        Equisolid,
        Orthographic,
        Thoby,
        ScaledStereographic,
        BaksteinPajdla,
        KannalaBrandt,
        Brown,
        Scaramuzza,
        UnifiedCamera,
        EnhancedUnifiedCamera,
        DoubleSphere,
    )
}
"""Every lens by its name in files and on the command line."""
