"""Rays <-> pixels for one picture: lenses, cameras, calibration, resampling.

The names of `__all__` can be imported from here; each loads its module when it is first used.
"""

from typing import TYPE_CHECKING

from fullsphere.model.lazy import offer

if TYPE_CHECKING:
    from fullsphere.model.calibration.calibrate import Calibration, calibrate, curve_of
    from fullsphere.model.calibration.points import View, read_points
    from fullsphere.model.calibration.record import save_calibration
    from fullsphere.model.camera import Camera, Projection
    from fullsphere.model.lens import (
        LENSES,
        BaksteinPajdla,
        Brown,
        DoubleSphere,
        EnhancedUnifiedCamera,
        Equidistant,
        Equisolid,
        KannalaBrandt,
        Lens,
        Orthographic,
        Perspective,
        ScaledStereographic,
        Scaramuzza,
        Stereographic,
        Thoby,
        UnifiedCamera,
    )
    from fullsphere.model.remap import remap
    from fullsphere.model.store import load_camera, save_camera
    from fullsphere.model.surface import Equirectangular
    from fullsphere.model.table import RayTable, tabulate

__all__ = [
    "LENSES",
    "BaksteinPajdla",
    "Brown",
    "Calibration",
    "Camera",
    "DoubleSphere",
    "EnhancedUnifiedCamera",
    "Equidistant",
    "Equirectangular",
    "Equisolid",
    "KannalaBrandt",
    "Lens",
    "Orthographic",
    "Perspective",
    "Projection",
    "RayTable",
    "ScaledStereographic",
    "Scaramuzza",
    "Stereographic",
    "Thoby",
    "UnifiedCamera",
    "View",
    "calibrate",
    "curve_of",
    "load_camera",
    "read_points",
    "remap",
    "save_calibration",
    "save_camera",
    "tabulate",
]

offer(
    __name__,
    {
        "calibration.calibrate": ("Calibration", "calibrate", "curve_of"),
        "calibration.points": ("View", "read_points"),
        "calibration.record": ("save_calibration",),
        "camera": ("Camera", "Projection"),
        "lens": (
            "LENSES",
            "BaksteinPajdla",
            "Brown",
            "DoubleSphere",
            "EnhancedUnifiedCamera",
            "Equidistant",
            "Equisolid",
            "KannalaBrandt",
            "Lens",
            "Orthographic",
            "Perspective",
            "ScaledStereographic",
            "Scaramuzza",
            "Stereographic",
            "Thoby",
            "UnifiedCamera",
        ),
        "remap": ("remap",),
        "store": ("load_camera", "save_camera"),
        "surface": ("Equirectangular",),
        "table": ("RayTable", "tabulate"),
    },
)
