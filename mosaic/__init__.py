"""Many pictures -> one sphere: registration, photometry, composition, and worlds with known truth to try them on.

The names of `__all__` can be imported from here; each loads its module when it is first used.
"""

from typing import TYPE_CHECKING

from fullsphere.model.lazy import offer

if TYPE_CHECKING:
    from fullsphere.mosaic.compose import compose
    from fullsphere.mosaic.frames import open_frames
    from fullsphere.mosaic.omnistereo import omnistereo
    from fullsphere.mosaic.project import Frame, Link, Mosaic
    from fullsphere.mosaic.pto import read_pto
    from fullsphere.mosaic.pto_write import write_pto
    from fullsphere.mosaic.register import register
    from fullsphere.mosaic.stitch import solve
    from fullsphere.mosaic.store import load_mosaic, save_mosaic
    from fullsphere.mosaic.turn_angles import find_turn

__all__ = [
    "Frame",
    "Link",
    "Mosaic",
    "compose",
    "find_turn",
    "load_mosaic",
    "omnistereo",
    "open_frames",
    "read_pto",
    "register",
    "save_mosaic",
    "solve",
    "write_pto",
]

offer(
    __name__,
    {
        "compose": ("compose",),
        "frames": ("open_frames",),
        "omnistereo": ("omnistereo",),
        "project": ("Frame", "Link", "Mosaic"),
        "pto": ("read_pto",),
        "pto_write": ("write_pto",),
        "register": ("register",),
        "stitch": ("solve",),
        "store": ("load_mosaic", "save_mosaic"),
        "turn_angles": ("find_turn",),
    },
)
