"""Rays <-> pixels for one picture: lenses, cameras, calibration, resampling.

The names of `__all__` can be imported from here; each loads its module when it is first used.
"""

from typing import TYPE_CHECKING

from fullsphere.model.lazy import offer

if TYPE_CHECKING:
    from fullsphere.model.calibration.assess import Assessment, assess
    from fullsphere.model.calibration.boards import AprilGrid, CharucoBoard, Chessboard, CirclesGrid
    from fullsphere.model.calibration.calibrate import Calibration, calibrate, curve_of, locate
    from fullsphere.model.calibration.difference import Difference, difference
    from fullsphere.model.calibration.photos import Photo, PhotoViews, views_of_photos
    from fullsphere.model.calibration.points import View, read_points
    from fullsphere.model.calibration.ray_errors import ray_sigma
    from fullsphere.model.calibration.record import save_calibration
    from fullsphere.model.calibration.select import Selection, select
    from fullsphere.model.calibration.target_file import load_target, parse_target, save_target
    from fullsphere.model.calibration.targets import Target
    from fullsphere.model.camera import Camera, FastProjection, Projection
    from fullsphere.model.cube_map import CubeMap
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
    from fullsphere.model.projection_text import Placed, parse_projection
    from fullsphere.model.remap import Band, Remapper, remap
    from fullsphere.model.store import load_camera, save_camera
    from fullsphere.model.surface import Cylindrical, Equirectangular, Mercator, Mosaic360
    from fullsphere.model.table import RayTable, tabulate

__all__ = [
    "LENSES",
    "AprilGrid",
    "Assessment",
    "BaksteinPajdla",
    "Band",
    "Brown",
    "Calibration",
    "Camera",
    "CharucoBoard",
    "Chessboard",
    "CirclesGrid",
    "CubeMap",
    "Cylindrical",
    "Difference",
    "DoubleSphere",
    "EnhancedUnifiedCamera",
    "Equidistant",
    "Equirectangular",
    "Equisolid",
    "FastProjection",
    "KannalaBrandt",
    "Lens",
    "Mercator",
    "Mosaic360",
    "Orthographic",
    "Perspective",
    "Photo",
    "PhotoViews",
    "Placed",
    "Projection",
    "RayTable",
    "Remapper",
    "ScaledStereographic",
    "Scaramuzza",
    "Selection",
    "Stereographic",
    "Target",
    "Thoby",
    "UnifiedCamera",
    "View",
    "assess",
    "calibrate",
    "curve_of",
    "difference",
    "load_camera",
    "load_target",
    "locate",
    "parse_projection",
    "parse_target",
    "ray_sigma",
    "read_points",
    "remap",
    "save_calibration",
    "save_camera",
    "save_target",
    "select",
    "tabulate",
    "views_of_photos",
]

offer(
    __name__,
    {
        "calibration.assess": (
            "Assessment",
            "assess",
        ),
        "calibration.boards": (
            "AprilGrid",
            "CharucoBoard",
            "Chessboard",
            "CirclesGrid",
        ),
        "calibration.difference": (
            "Difference",
            "difference",
        ),
        "calibration.photos": (
            "Photo",
            "PhotoViews",
            "views_of_photos",
        ),
        "calibration.ray_errors": ("ray_sigma",),
        "calibration.select": (
            "Selection",
            "select",
        ),
        "calibration.target_file": (
            "load_target",
            "parse_target",
            "save_target",
        ),
        "calibration.targets": ("Target",),
        "calibration.calibrate": ("Calibration", "calibrate", "curve_of", "locate"),
        "calibration.points": ("View", "read_points"),
        "calibration.record": ("save_calibration",),
        "camera": ("Camera", "FastProjection", "Projection"),
        "cube_map": ("CubeMap",),
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
        "projection_text": ("Placed", "parse_projection"),
        "remap": ("Band", "Remapper", "remap"),
        "store": ("load_camera", "save_camera"),
        "surface": ("Cylindrical", "Equirectangular", "Mercator", "Mosaic360"),
        "table": ("RayTable", "tabulate"),
    },
)
