"""Renders a room from a turning arm, makes the 360 x 360 mosaic, both eyes and range, and compares with the truth.

    python 08_omnistereo.py [FOLDER]

To its right the camera's rays at 90 degrees from its axis are those of a left eye, to its left those of a right eye.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from fullsphere.model import BaksteinPajdla, Camera
from fullsphere.model.images import encoded_from_linear, gpano, open_panorama
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic.eyes import eyes_of
from fullsphere.mosaic.omnistereo import omnistereo, range_from
from fullsphere.mosaic.project import Frame
from fullsphere.mosaic.turn_angles import find_turn
from fullsphere.mosaic.worlds import furnished_room, photograph_on_arm, true_mosaic

ARM, WIDTH, FRAMES = 0.15, 512, 60


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lens = BaksteinPajdla(a=132.0, b=2.11, c=41.0, d=1.13)
    camera = Camera(lens, (340, 340), (170.2, 168.9), half_fov=math.radians(92))
    room, angles = furnished_room(seed=1, texel_mm=8), np.arange(FRAMES) * 2 * np.pi / FRAMES
    pictures = [photograph_on_arm(room, camera, angle, ARM) for angle in angles]
    frames = [Frame(f"turn {k}", "", camera.size, pictures[k].copy) for k in range(FRAMES)]

    with thread_pool() as executor:
        turn = find_turn(frames, camera, executor)
        made = omnistereo(turn, WIDTH, executor)
        truth = true_mosaic(room, ARM, WIDTH, executor=executor)
    off = np.degrees((turn.angles - angles + np.pi) % (2 * np.pi) - np.pi)
    print(f"turn angles: largest error {np.abs(off).max():.3f} degrees")

    inside, size = slice(WIDTH // 24, -WIDTH // 24), (WIDTH, WIDTH // 2)  # within 75 degrees of the horizon
    for name, eye, true in zip(("left", "right"), made.eyes, eyes_of(truth.light), strict=True):
        error = eye[inside].astype(float) - encoded_from_linear(true, np.uint8)[inside]
        print(f"{name} eye: {10 * math.log10(255**2 / np.mean(error**2)):.1f} dB")
        with open_panorama(folder / f"{name}.jpg", size, 3, "uint8", gpano(size), overwrite=True) as file:
            file.write_rows(0, eye)
    off = np.abs(range_from(made, WIDTH) / eyes_of(truth.rho)[0] - 1)[inside]
    print(f"range: known of {100 * np.isfinite(off).mean():.0f} %, median error {100 * np.nanmedian(off):.1f} %")
    print(folder / "left.jpg", folder / "right.jpg")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
        print("(removed again; name a folder to keep what is written)")
