"""The paper's second experiment: 285 points on a half cylinder, 19 stops of a turntable before a line of 15 points.

    python 06_half_cylinder.py

The line is turned about an upright axis through the lens, from -90 to 90 degrees in steps of 10.  Its points stand at
many depths, and many of them share an angle from the optical axis: that fixes where the camera stands, which the
cylinder of 05_cylinder.py leaves open, and the curve is right to a fraction of a pixel.  Half of the points is fitted,
half verifies, and the squared residuals of the second are compared with the chi-square distribution.
"""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from fullsphere.model import BaksteinPajdla, Camera, View, assess, calibrate, curve_of

NOISE_PX = 0.3


def main() -> None:
    lens = BaksteinPajdla(a=900.0, b=3.2, c=80.0, d=1.3)
    true = Camera(lens, (1280, 1280), centre=(643.0, 637.5), half_fov=math.radians(93))
    turn, height_mm = np.meshgrid(np.radians(np.arange(-90, 91, 10)), np.linspace(-350, 350, 15))
    points_mm = np.stack([250 * np.sin(turn), height_mm, 250 * np.cos(turn)], -1).reshape(-1, 3)

    random = np.random.default_rng(1)
    pose = Rotation.from_euler("YXZ", [0.5, -0.7, 2.0], degrees=True).as_matrix()
    pixels = true.project(points_mm @ pose.T + [2.0, -1.5, 4.0])
    view = View("half cylinder", points_mm, pixels + random.normal(0, NOISE_PX, pixels.shape))

    found = calibrate([view], true.size, half_fov=math.radians(90))
    test = assess(found).verification
    assert test is not None
    print(f"{found.points} points, noise {NOISE_PX * math.sqrt(2):.3f} px, rms {found.rms_px:.3f} px")
    print(f"{test.fit_points} fitted: rms {test.fit_rms_px:.3f} px, expected {test.expected_fit_rms_px:.3f}")
    print(f"{test.verify_points} verify: rms {test.verify_rms_px:.3f} px, expected {test.expected_verify_rms_px:.3f}")
    print("squared residuals over their variance, in bins that chance fills alike:")
    print(
        "  " + " ".join(f"{count:3d}" for count in test.chi_square.counts) + f"   expected {test.chi_square.expected}"
    )
    verdict = "passes" if test.chi_square.p_value > 0.05 else "fails"
    print(f"chi-square test {verdict}, p = {test.chi_square.p_value:.2f}")
    curve = curve_of(found)
    print("theta (deg)   r (px)   sigma (px)   true error (px)")
    for theta in range(0, 91, 15):
        error = curve.r_px[theta] - lens.radius(math.radians(theta))
        print(f"{theta:11d} {curve.r_px[theta]:8.2f} {curve.sigma_px[theta]:12.3f} {error:17.3f}")


if __name__ == "__main__":
    main()
