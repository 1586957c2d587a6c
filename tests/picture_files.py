"""Small picture files with the metadata that cameras note, for tests of what is read from them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fullsphere.model.exif_block import exif_block

SIZE = (48, 32)


def scene(seed: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """A picture (h, w, 3) like no other of another seed."""
    return np.random.default_rng(seed).integers(40, 220, (size[1], size[0], 3)).astype(np.uint8)


def disc(centre: tuple[float, float], radius: float, size: tuple[int, int], seed: int = 0) -> NDArray[np.uint8]:
    """A circular fisheye's picture (h, w, 3): a lit disc on black."""
    v, u = np.ogrid[: size[1], : size[0]]
    inside = np.hypot(u - centre[0], v - centre[1]) <= radius
    return np.where(inside[..., None], scene(seed, size), 0).astype(np.uint8)


def picture_file(path: Path, pixels: NDArray[Any], orientation: int | None = None, xmp: str = "") -> Path:
    """Write a picture (h, w, c) in the format of the ending; a JPEG with an EXIF orientation and an XMP packet."""
    channels = pixels.shape[2]
    ordered = pixels[..., [2, 1, 0, 3][:channels]] if channels >= 3 else pixels
    _, encoded = cv2.imencode(path.suffix, ordered)
    content = encoded.tobytes()
    if orientation is not None:
        content = _with_segment(content, b"Exif\0\0" + exif_block({"Orientation": orientation}))
    if xmp:
        packet = (
            '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
            '<rdf:Description rdf:about="" xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" '
            f'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {xmp}/></rdf:RDF></x:xmpmeta>'
        )
        content = _with_segment(content, b"http://ns.adobe.com/xap/1.0/\0" + packet.encode())
    path.write_bytes(content)
    return path


def _with_segment(jpeg: bytes, content: bytes) -> bytes:
    """A JPEG with one more APP1 segment behind its start."""
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content + jpeg[2:]
