"""Several pictures of one place on the sphere -> one: a blender is fed and then asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fullsphere.model.errors import UsageError
from fullsphere.mosaic import sphere_pyramid
from fullsphere.mosaic.sphere_kernels import add_detail, weigh_detail

_UNSEEN = np.float32(1e-3)
"""What a picture weighs, against 1, where it is only carried on: enough where nobody sees."""

_NOTHING = 1e-20
"""The sum of weights up to which a pixel counts as wanted by nobody: light times less has lost digits."""


class Bands(NamedTuple):
    """One picture taken apart for `MultiBand`, finest level first: each level's detail times its weight, and that."""

    detail: tuple[NDArray[np.float32], ...]
    weight: tuple[NDArray[np.float32], ...]


class MultiBand:
    """Pictures of the whole sphere joined band by band: fine detail at the seam, brightness over a wide belt.

    After Burt and Adelson, "A Multiresolution Spline With Application to Image Mosaics" (1983), on a pyramid that knows
    the sphere.  The weight of a picture in a level is its mask, blurred to that level, times how much of the level it
    sees; in each pixel weights are divided by their sum.  A constant stays constant whatever the masks, and one
    picture fed alone comes back as it was where it was seen.

    Parameters
    ----------
    height, width
        Of the equirectangular sphere in pixels, width = 2 height.  The coarsest band has 8 to 15 rows where the
        height has factors of two enough.

    Raises
    ------
    UsageError
        The sphere is not twice as wide as high, or its height cannot be halved once.
    """

    def __init__(self, height: int, width: int) -> None:
        self._sizes = sphere_pyramid.sizes(height, width)
        if len(self._sizes) < 2:
            raise UsageError(f"a sphere of {width} x {height} pixels has no two bands: give a height of 16, 32, ...")
        self._sum: Bands | None = None

    def feed(self, light: NDArray[np.float32], seen: NDArray[np.bool_], mask: NDArray[np.float32]) -> None:
        """Add a picture (H, W, C) that is `seen` (H, W), wanted where its `mask` (H, W), 0 to 1, says so.

        The masks of all pictures should sum to 1 everywhere, also where none is seen.
        """
        self.add(self.taken_apart(light, seen, mask))

    def taken_apart(self, light: NDArray[np.float32], seen: NDArray[np.bool_], mask: NDArray[np.float32]) -> Bands:
        """The costly half of `feed`: it changes nothing, so that several pictures can be taken apart side by side."""
        height, width = self._sizes[0]
        if light.ndim != 3 or not light.shape[:2] == seen.shape == mask.shape == (height, width):
            raise UsageError(
                f"light {light.shape}, seen {seen.shape} and mask {mask.shape} are not those of a sphere of"
                f" {width} x {height} pixels: give ({height}, {width}, channels), and ({height}, {width}) twice"
            )
        levels = len(self._sizes)
        pictures = sphere_pyramid.gaussian(filled(light, seen), levels)
        masks = sphere_pyramid.gaussian(np.ascontiguousarray(mask, np.float32), levels)
        views = sphere_pyramid.gaussian(seen.astype(np.float32), levels)
        weights = tuple(wanted * (view + _UNSEEN) for wanted, view in zip(masks, views, strict=True))
        details = []
        for level, (fine, weight) in enumerate(zip(pictures, weights, strict=True)):
            last = level == levels - 1
            detail = np.zeros_like(fine) if last else sphere_pyramid.expand(pictures[level + 1])
            weigh_detail(fine, weight, detail)
            details.append(detail)
        return Bands(tuple(details), weights)

    def add(self, bands: Bands) -> None:
        """The other half of `feed`; the order of additions decides about the last bits of the result alone."""
        if self._sum is None:
            self._sum = Bands(tuple(map(np.zeros_like, bands.detail)), tuple(map(np.zeros_like, bands.weight)))
        for total, one in zip(self._sum.detail + self._sum.weight, bands.detail + bands.weight, strict=True):
            total += one

    def blended(self) -> NDArray[np.float32]:
        """The picture (H, W, C), defined everywhere: where no mask wants anything, what is wanted near by goes on.

        Raises
        ------
        UsageError
            Nothing was fed.
        """
        if self._sum is None:
            raise UsageError("there is nothing to blend: feed a picture first")
        details, weights = self._sum
        light = np.zeros_like(details[-1])
        add_detail(details[-1], weights[-1], _NOTHING, light)
        wanted = np.minimum(weights[-1] / _UNSEEN, np.float32(1))
        light = sphere_pyramid.continued(light * wanted[..., None], wanted)
        for detail, weight in zip(details[-2::-1], weights[-2::-1], strict=True):
            light = sphere_pyramid.expand(light)
            add_detail(detail, weight, _NOTHING, light)
        return light


def filled(light: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """A picture of the sphere (H, W, C) carried on smoothly to where it is not `seen` (H, W); as it was where it is."""
    if seen.all():
        return np.ascontiguousarray(light, np.float32)
    known = np.where(seen[..., None], light, np.float32(0))
    return sphere_pyramid.continued(known, seen.astype(np.float32))
