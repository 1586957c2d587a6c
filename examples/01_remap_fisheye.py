"""Turns one fisheye frame into a full-sphere picture and into views, and says how much of the sphere it saw.

    python 01_remap_fisheye.py [FOLDER]

A camera is a lens, a picture size, a centre and a field of view.  Any picture is resampled from its own projection
into another one, with a rotation where the two look in different directions; the weight that comes with the pixels says
where the source saw anything at all.
"""

import math
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fullsphere.model import BaksteinPajdla, Camera, Equirectangular, Perspective, remap, tabulate
from fullsphere.mosaic.worlds import environment, furnished_room, photograph


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lens, half_fov = BaksteinPajdla(a=306.0, b=2.11, c=95.5, d=1.13), math.radians(91.5)
    camera = Camera(lens, size=(800, 800), centre=(401.5, 397.0), half_fov=half_fov)
    room = environment(furnished_room(seed=1, texel_mm=8), face_px=400)
    frame = photograph(room, camera, np.eye(3))

    sphere = Equirectangular((1600, 800))
    panorama, weight = remap(frame, camera, sphere)
    back, seen = remap(panorama, sphere, camera)

    cosines = np.sin(math.pi * (np.arange(800) + 0.5) / 800)  # of the rows' latitudes: how much sphere they show
    covered = np.average(weight.mean(axis=1), weights=cosines)
    print(f"image circle of {2 * math.degrees(half_fov):.1f} degrees: {camera.image_radius:.0f} px in radius")
    print(f"table of the lens: at most {tabulate(camera).error_px:.1e} px from the exact camera")
    print(f"sphere covered: {100 * covered:.2f} %, expected {50 * (1 - math.cos(half_fov)):.2f} %")
    inside = camera.unproject(np.stack(np.meshgrid(np.arange(800), np.arange(800)), -1))[..., 2] > 0
    difference = np.abs(back.astype(float) - frame)[inside & (seen > 0)]
    print(f"there and back again: pixels change by {difference.mean():.2f} of 255 on average")

    to_the_right = Rotation.from_euler("YXZ", [40, 5, 0], degrees=True).as_matrix()  # world_from_view: yaw, pitch, roll
    view = Camera(Perspective(f=400), size=(640, 480), centre=(319.5, 239.5), half_fov=math.radians(50))
    ordinary, seen = remap(frame, camera, view, to_the_right.T, "lanczos3")
    print(f"an ordinary view to the right: {100 * seen.mean():.0f} % of it seen")

    for name, picture in (("fisheye.png", frame), ("sphere.png", panorama), ("view.png", ordinary)):
        cv2.imwrite(str(folder / name), picture[..., ::-1])
        print(folder / name)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
        print("(removed again; name a folder to keep what is written)")
