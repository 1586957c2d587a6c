"""Metadata of panorama files: the GPano fields by which viewers know a sphere, as attributes and as an XMP packet.

Attributes carry OpenImageIO's names.  TIFF takes them from there; JPEG and PNG get the packet made here.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from importlib.metadata import version
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from fullsphere.model.errors import UsageError

Value = str | int | float | bool
Attributes = Mapping[str, Value]

_GPANO = "http://ns.google.com/photos/1.0/panorama/"
_SPACES = {
    "GPano": _GPANO,
    "tiff": "http://ns.adobe.com/tiff/1.0/",
    "exif": "http://ns.adobe.com/exif/1.0/",
    "aux": "http://ns.adobe.com/exif/1.0/aux/",
    "xmp": "http://ns.adobe.com/xap/1.0/",
}


class _XmpName(NamedTuple):
    name: str
    kind: str  # how XMP spells the value: text, fraction or date


_XMP_NAMES = {
    "Make": _XmpName("tiff:Make", "text"),
    "Model": _XmpName("tiff:Model", "text"),
    "Software": _XmpName("xmp:CreatorTool", "text"),
    "Artist": _XmpName("tiff:Artist", "text"),
    "Copyright": _XmpName("tiff:Copyright", "text"),
    "DateTime": _XmpName("xmp:ModifyDate", "date"),
    "ExposureTime": _XmpName("exif:ExposureTime", "fraction"),
    "FNumber": _XmpName("exif:FNumber", "fraction"),
    "Exif:DateTimeOriginal": _XmpName("exif:DateTimeOriginal", "date"),
    "Exif:FocalLength": _XmpName("exif:FocalLength", "fraction"),
    "Exif:ExposureBiasValue": _XmpName("exif:ExposureBiasValue", "fraction"),
    "Exif:LensModel": _XmpName("aux:Lens", "text"),
    "Exif:PhotographicSensitivity": _XmpName("exif:PhotographicSensitivity", "text"),
}

CAPTURE_NAMES = tuple(name for name in _XMP_NAMES if name != "Software")
"""The attributes of a photograph that are read, and that a panorama carries on."""


def gpano(size: tuple[int, int]) -> dict[str, Value]:
    """The attributes that tell a viewer that an equirectangular picture (width, height) is the whole sphere.

    Raises
    ------
    UsageError
        If the width is not twice the height.
    """
    width, height = size
    if width != 2 * height:
        raise UsageError(f"a full sphere is twice as wide as high, not {width} x {height}")
    return {
        "GPano:ProjectionType": "equirectangular",
        "GPano:UsePanoramaViewer": True,
        "GPano:StitchingSoftware": f"fullsphere {version('fullsphere')}",
        "GPano:FullPanoWidthPixels": width,
        "GPano:FullPanoHeightPixels": height,
        "GPano:CroppedAreaImageWidthPixels": width,
        "GPano:CroppedAreaImageHeightPixels": height,
        "GPano:CroppedAreaLeftPixels": 0,
        "GPano:CroppedAreaTopPixels": 0,
    }


def xmp_packet(attributes: Attributes) -> bytes:
    """An XMP packet of the GPano fields and the capture attributes; names without a place in XMP are left out."""
    fields = []
    for name, value in attributes.items():
        if name.startswith("GPano:"):
            fields.append((name, str(value)))
        elif name in _XMP_NAMES:
            fields.append((_XMP_NAMES[name].name, _spelled(value, _XMP_NAMES[name].kind)))
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


def _spelled(value: Value, kind: str) -> str:
    if kind == "fraction" and isinstance(value, int | float):
        fraction = Fraction(value).limit_denominator(10_000)
        return f"{fraction.numerator}/{fraction.denominator}"
    if kind == "date":  # EXIF writes 2015:03:16 17:04:35, XMP 2015-03-16T17:04:35
        day, _, time = str(value).partition(" ")
        return f"{day.replace(':', '-')}T{time}" if time else day
    return str(value)
