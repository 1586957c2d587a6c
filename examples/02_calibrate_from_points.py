"""Calibrates a fisheye lens from known points in space, and compares the curve found with the true one.

    python 02_calibrate_from_points.py [FOLDER]

The four values of the Bakstein-Pajdla lens are nearly interchangeable, so the curve r(theta) is what is compared.
Its standard deviation comes from the fit itself; the true error should be of that size.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fullsphere.model import BaksteinPajdla, Camera, View, calibrate, curve_of, load_camera, save_calibration

NOISE_PX = 0.15


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    half_fov = math.radians(92)
    lens = BaksteinPajdla(a=490.0, b=2.11, c=153.0, d=1.13)
    true = Camera(lens, (1280, 1280), centre=(644.0, 637.5), half_fov=half_fov, aspect=1.001)
    random = np.random.default_rng(0)
    points_mm = random.uniform(-600, 600, (400, 3))  # a target that surrounds the camera
    views = []
    for k in range(3):
        pose = Rotation.from_euler("YXZ", random.uniform(-40, 40, 3), degrees=True).as_matrix()
        pixels = true.project(points_mm @ pose.T + random.uniform(-60, 60, 3))
        seen = np.isfinite(pixels[:, 0])
        views.append(View(f"view {k}", points_mm[seen], pixels[seen] + random.normal(0, NOISE_PX, (seen.sum(), 2))))

    found = calibrate(views, true.size, half_fov=half_fov)
    curve = curve_of(found)
    print(f"{found.points} points in {found.views} views, noise {NOISE_PX * math.sqrt(2):.3f} px")
    print(f"rms {found.rms_px:.3f} px over all of them, nothing rejected")
    print(f"centre ({found.camera.centre[0]:.2f}, {found.camera.centre[1]:.2f}), true {true.centre}")
    print(f"aspect {found.camera.aspect:.5f}, true {true.aspect}")
    print("theta (deg)   r (px)   sigma (px)   true error (px)")
    for theta in range(0, 91, 15):
        error = curve.r_px[theta] - true.lens.radius(math.radians(theta))
        print(f"{theta:11d} {curve.r_px[theta]:8.2f} {curve.sigma_px[theta]:12.4f} {error:17.4f}")

    save_calibration(folder / "camera.json", found, inputs=[], overwrite=True)
    assert load_camera(folder / "camera.json") == found.camera
    print(folder / "camera.json")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
        print("(removed again; name a folder to keep what is written)")
