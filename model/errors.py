"""The exceptions of fullsphere: one base, and one leaf for each kind of situation a caller can act on.

Every message says what is wrong, where (the file or the argument), and what to try.
"""


class FullsphereError(Exception):
    """Base of every error that fullsphere raises on purpose."""


class UsageError(FullsphereError, ValueError):
    """An argument or option makes no sense as given."""


class InputError(FullsphereError):
    """A file cannot be used: missing, damaged, of the wrong kind, or holding values out of range."""


class CameraError(FullsphereError, ValueError):
    """The values given do not describe a lens or a camera (not finite, out of bounds, not monotone)."""


class GeometryError(FullsphereError):
    """The measurements do not determine the geometry: no overlap, too few points, no convergence."""


class OutputError(FullsphereError):
    """A result could not be written; whatever stood at the output path before is untouched."""


class ResourceError(FullsphereError):
    """The work needs more memory, disk or accuracy than there is."""
