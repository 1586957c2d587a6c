"""Metadata of panorama files: what a photograph hands on, and the GPano fields by which viewers know a sphere.

Attributes carry OpenImageIO's names.  TIFF and OpenEXR take them from there; JPEG and PNG get the XMP packet made here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.metadata import version
from xml.sax.saxutils import quoteattr

from fullsphere.model.errors import UsageError

Value = str | int | float | bool | tuple[float, ...]
Attributes = Mapping[str, Value]

_SPACES = {
    "GPano": "http://ns.google.com/photos/1.0/panorama/",
    "GSpherical": "http://ns.google.com/videos/1.0/spherical/",
    "xmp": "http://ns.adobe.com/xap/1.0/",
}
_SPHERICAL = ("GPano:", "GSpherical:")

_KINDS: dict[str, type] = {
    "Make": str,
    "Model": str,
    "Artist": str,
    "Copyright": str,
    "DateTime": str,
    "ExposureTime": float,
    "FNumber": float,
    "Exif:DateTimeOriginal": str,
    "Exif:FocalLength": float,
    "Exif:ExposureBiasValue": float,
    "Exif:LensModel": str,
    "Exif:PhotographicSensitivity": float,
    "GPS:LatitudeRef": str,
    "GPS:Latitude": tuple,
    "GPS:LongitudeRef": str,
    "GPS:Longitude": tuple,
    "GPS:AltitudeRef": float,
    "GPS:Altitude": float,
    "GPS:TimeStamp": tuple,
    "GPS:DateStamp": str,
    "GPS:ImgDirectionRef": str,
    "GPS:ImgDirection": float,
}

CAPTURE_NAMES = tuple(_KINDS)
"""The attributes of a photograph that are read, and that what is made of it carries on."""


def gpano(size: tuple[int, int], window: tuple[int, int, int, int] | None = None) -> dict[str, Value]:
    """The attributes that tell a viewer which part of the sphere an equirectangular picture shows.

    Parameters
    ----------
    size
        Width and height of the whole sphere in pixels, of which the picture shows all or a part.
    window
        The part: left, top, width, height in pixels of the whole sphere; None for all of it.  A crop of longitudes
        from l0 and latitudes down from b1 at p pixels a degree has left = (l0 + 180) p and top = (90 - b1) p.

    Raises
    ------
    UsageError
        If the width of the whole is not twice its height, or the window is empty or reaches out of it.
    """
    width, height = size
    if width != 2 * height:
        raise UsageError(f"a full sphere is twice as wide as high, not {width} x {height}")
    left, top, part_width, part_height = window or (0, 0, width, height)
    if not (0 <= left < left + part_width <= width and 0 <= top < top + part_height <= height):
        raise UsageError(
            f"{part_width} x {part_height} pixels at ({left}, {top}) are no part of a sphere of {width} x {height}"
        )
    return {
        "GPano:ProjectionType": "equirectangular",
        "GPano:UsePanoramaViewer": True,
        "GPano:StitchingSoftware": f"fullsphere {version('fullsphere')}",
        "GPano:FullPanoWidthPixels": width,
        "GPano:FullPanoHeightPixels": height,
        "GPano:CroppedAreaImageWidthPixels": part_width,
        "GPano:CroppedAreaImageHeightPixels": part_height,
        "GPano:CroppedAreaLeftPixels": left,
        "GPano:CroppedAreaTopPixels": top,
    }


def over_under() -> dict[str, Value]:
    """The attributes that tell a viewer that a picture is two whole spheres, the left eye's above the right eye's.

    For still pictures no field is agreed on; these are the ones of spherical video (Google, "Spherical Video RFC", V1).
    """
    return {
        "GSpherical:Spherical": "true",
        "GSpherical:Stitched": "true",
        "GSpherical:StitchingSoftware": f"fullsphere {version('fullsphere')}",
        "GSpherical:ProjectionType": "equirectangular",
        "GSpherical:StereoMode": "top-bottom",
    }


def carried(
    metadata: Attributes, icc_profile: bytes | None, channels: int, same_samples: bool = True
) -> tuple[dict[str, Value], bytes | None]:
    """What a picture made of another one carries on, as `attributes` and `icc_profile` of `open_panorama`.

    Parameters
    ----------
    metadata, icc_profile
        Of the source, a `Picture` or a `PictureFile`.
    channels
        Of the new picture.
    same_samples
        Whether its samples mean what the source's did: not if they were sRGB codes and are linear light now.

    Returns
    -------
    The capture metadata, with orientation 1 and this program's name; and the profile if it is one for such channels
    and samples, else None.
    """
    attributes = {**metadata, "Orientation": 1, "Software": f"fullsphere {version('fullsphere')}"}
    space = b"GRAY" if channels < 3 else b"RGB "
    fits = icc_profile is not None and same_samples and icc_profile[16:20] == space
    return attributes, icc_profile if fits else None


def noted_ev(metadata: Attributes) -> float | None:
    """How bright the exposure made a picture, log2(time ISO / 100 / f-number^2), by what the camera noted.

    None where it did not note all three.
    """
    time, aperture, speed = (metadata.get(name) for name in ("ExposureTime", "FNumber", "Exif:PhotographicSensitivity"))
    if not (isinstance(time, int | float) and isinstance(aperture, int | float) and isinstance(speed, int | float)):
        return None
    return math.log2(time * speed / 100 / aperture**2) if min(time, aperture, speed) > 0 else None


def sound(name: str, value: object) -> Value | None:
    """A capture attribute as a file holds it, which is untrusted; None if it is not what its name says.

    Texts lose control characters and what is beyond 500 characters; numbers are finite; places and times of GPS are
    three numbers.
    """
    kind = _KINDS[name]
    if isinstance(value, str):
        return "".join(c for c in value if c.isprintable()).strip()[:500] or None if kind is str else None
    if isinstance(value, int | float):
        return value if kind is float and math.isfinite(value) else None
    if isinstance(value, tuple) and kind is tuple and len(value) == 3:
        return value if all(isinstance(number, int | float) and math.isfinite(number) for number in value) else None
    return None


def xmp_packet(attributes: Attributes) -> bytes:
    """An XMP packet of the GPano and GSpherical fields and the program's name; b"" if there are none."""
    fields = [(name, str(value)) for name, value in attributes.items() if name.startswith(_SPHERICAL)]
    if "Software" in attributes:
        fields.append(("xmp:CreatorTool", str(attributes["Software"])))
    if not fields:
        return b""
    used = {name.partition(":")[0] for name, _ in fields}
    spaces = "".join(f"\n  xmlns:{prefix}={quoteattr(uri)}" for prefix, uri in _SPACES.items() if prefix in used)
    body = "".join(f"\n  {name}={quoteattr(value)}" for name, value in fields)
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        f' <rdf:Description rdf:about=""{spaces}{body}/>\n'
        '</rdf:RDF>\n</x:xmpmeta>\n<?xpacket end="w"?>'
    ).encode()
