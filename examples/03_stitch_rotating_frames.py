"""Stitches the frames of a turning camera: registration, photometry, composition; and compares with the truth.

    python 03_stitch_rotating_frames.py [FOLDER]

A frame is anything that can hand over its pixels: here pictures rendered in memory, elsewhere `open_frames(paths)`.
"""

import math
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from fullsphere.model import BaksteinPajdla, Camera, Equirectangular
from fullsphere.model.workers import thread_pool
from fullsphere.mosaic import Frame, compose, save_mosaic, solve
from fullsphere.mosaic.truth import rotation_errors_deg
from fullsphere.mosaic.worlds import environment, furnished_room, photograph, turn


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lens = BaksteinPajdla(a=245.0, b=2.11, c=76.5, d=1.13)
    camera = Camera(lens, size=(640, 640), centre=(321.0, 317.5), half_fov=math.radians(91.5))
    room = environment(furnished_room(seed=1, texel_mm=7), face_px=512)
    shots = turn(4, pitch_deg=12, seed=3)
    frames = []
    for k, shot in enumerate(shots):
        picture = photograph(room, camera, shot.camera_from_world, exposure_ev=shot.exposure_ev, noise=0.004, seed=k)
        frames.append(Frame(f"frame {k}", "", camera.size, load=picture.copy))
    with thread_pool() as executor:
        mosaic = solve(frames, camera, executor)  # register(frames, camera) and then the exposures
        bands = list(compose(mosaic, Equirectangular((1024, 512)), np.uint8, executor))
    panorama = np.concatenate([band.rows for band in bands])

    placed = [(frame, shot) for frame, shot in zip(mosaic.frames, shots, strict=True) if frame.registered]
    found = [np.asarray(frame.camera_from_world) for frame, _ in placed]
    errors, _ = rotation_errors_deg(found, [shot.camera_from_world for _, shot in placed])
    mean_ev = np.mean([shot.exposure_ev for _, shot in placed])  # exposures are found relative to their mean
    print(f"{len(placed)} of {len(frames)} frames, {mosaic.quality['matches']} matches, level by {mosaic.level}")
    for (frame, shot), error in zip(placed, errors, strict=True):
        exposures = f"exposure {frame.exposure_ev:+.3f} EV, true {shot.exposure_ev - mean_ev:+.3f}"
        print(f"{frame.id}: {error:.4f} degrees off, {exposures}")
    print(f"sphere covered: {100 * np.mean(panorama[..., 3] > 0):.1f} % of the panorama's pixels")

    save_mosaic(folder / "mosaic.json", mosaic, overwrite=True)
    cv2.imwrite(str(folder / "panorama.png"), panorama[..., [2, 1, 0, 3]])
    print(folder / "panorama.png")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
        print("(removed again; name a folder to keep what is written)")
