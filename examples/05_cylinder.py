"""The paper's first experiment: 72 points on the inside of a cylinder round the optical axis, in one photo.

    python 05_cylinder.py

Nine circles of eight points, at 90 to 30 degrees from the axis; half of the points is fitted, half verifies.  The test
of the verification half passes, and still the curve r(theta) may be wrong by pixels: each angle is seen at one depth
only, so a shift of the camera along the axis looks nearly like another lens.  No residual shows that; the standard
deviation of the curve does.  A second photo from further along the axis would leave the same choice.  One from beside
the axis, where the wall is near on one side and far on the other, settles it.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fullsphere.model import BaksteinPajdla, Camera, View, assess, calibrate, curve_of

NOISE_PX = 0.3
CIRCLES_DEG = (90, 85, 80, 75, 70, 60, 50, 40, 30)


def photo(true: Camera, points_mm: NDArray[np.float64], aside_mm: float, random: np.random.Generator) -> View:
    turn = Rotation.from_euler("YXZ", [1.0, -0.7, 3.0], degrees=True).as_matrix()
    pixels = true.project(points_mm @ turn.T + [2.0 + aside_mm, -1.5, 0.0])
    return View(f"{aside_mm:g} mm aside", points_mm, pixels + random.normal(0, NOISE_PX, pixels.shape))


def main() -> None:
    lens = BaksteinPajdla(a=900.0, b=3.2, c=80.0, d=1.3)
    true = Camera(lens, (1280, 1280), centre=(643.0, 637.5), half_fov=math.radians(93))
    theta, phi = np.meshgrid(np.radians(CIRCLES_DEG), np.radians(np.arange(0, 360, 45)))
    points_mm = 150 * np.stack([np.cos(phi), np.sin(phi), 1 / np.tan(theta)], -1).reshape(-1, 3)

    random = np.random.default_rng(1)
    views = [photo(true, points_mm, aside_mm, random) for aside_mm in (0.0, 60.0)]
    one, two = (calibrate(chosen, true.size, half_fov=math.radians(90)) for chosen in (views[:1], views))
    test = assess(one).verification
    assert test is not None
    print(f"{one.points} points, noise {NOISE_PX * math.sqrt(2):.3f} px, rms {one.rms_px:.3f} px")
    print(f"{test.fit_points} fitted: rms {test.fit_rms_px:.3f} px, expected {test.expected_fit_rms_px:.3f}")
    print(f"{test.verify_points} verify: rms {test.verify_rms_px:.3f} px, expected {test.expected_verify_rms_px:.3f}")
    verdict = "passes" if test.chi_square.p_value > 0.05 else "fails"
    print(f"chi-square test {verdict}, p = {test.chi_square.p_value:.2f}")
    print("                 one photo                 two photos")
    print("theta (deg)  sigma (px)  error (px)   sigma (px)  error (px)")
    for degrees in range(30, 91, 10):
        row = [(curve_of(c).sigma_px[degrees], curve_of(c).r_px[degrees]) for c in (one, two)]
        (sigma1, r1), (sigma2, r2) = row
        r = float(lens.radius(math.radians(degrees)))
        print(f"{degrees:11d} {sigma1:11.2f} {r1 - r:11.2f} {sigma2:12.2f} {r2 - r:11.2f}")


if __name__ == "__main__":
    main()
