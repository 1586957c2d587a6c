"""Remaps frame after frame of one camera with geometry that is kept, and one frame to a file that is never held whole.

    python 07_many_frames.py [FOLDER]

A `Remapper` is `remap` with a memory: where each pixel of the target lies in the source does not change from frame to
frame.  Its `bands` are finished rows from the top, for targets larger than the memory.
"""

import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from fullsphere.model import BaksteinPajdla, Camera, Cylindrical, Equirectangular, Remapper, remap
from fullsphere.model.coverage import with_channels
from fullsphere.model.images import gpano, open_panorama
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.worlds import environment, furnished_room, photograph, turn


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lens = BaksteinPajdla(a=306.0, b=2.11, c=95.5, d=1.13)
    camera = Camera(lens, size=(800, 800), centre=(401.5, 397.0), half_fov=math.radians(91.5))
    room = environment(furnished_room(seed=1, texel_mm=8), face_px=400)
    frames = [photograph(room, camera, shot.camera_from_world) for shot in turn(6, seed=2)]

    strip = Cylindrical((1600, 700), hfov=math.radians(180))
    with thread_pool() as executor:
        remapper = Remapper(camera, strip, interpolation="linear", kept_bytes=64 << 20, executor=executor)
        for k, frame in enumerate(frames):
            start = time.perf_counter()
            pixels, _ = remapper(frame)
            print(f"frame {k}: {1000 * (time.perf_counter() - start):.1f} ms{', geometry made' if k == 0 else ''}")
        alone, _ = remap(frames[-1], camera, strip, interpolation="linear")
        print(f"the same as without: {np.array_equal(pixels, alone)}")

        sphere = Equirectangular((4096, 2048))
        bands = Remapper(camera, sphere, executor=executor).bands(frames[0])
        place = folder / "sphere.tif"
        with open_panorama(place, sphere.size, 4, "uint8", gpano(sphere.size), overwrite=True) as file:
            for band in bands:
                file.write_rows(band.top, with_channels(band.pixels, band.weight, 4))
        print(place)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
        print("(removed again; name a folder to keep what is written)")
