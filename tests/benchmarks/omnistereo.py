"""How like what it ought to show the 360 x 360 mosaic is, how exactly turns are found, and what it costs, in one table.

    python tests/benchmarks/omnistereo.py [--only PART ...] [--keep FOLDER] [--seed N]

Frames are taken of the program's own furnished room by a fisheye of 183 degrees on an arm of 15 cm, and stay in the
folder --keep.  docs/omnistereo.md says what is measured.
"""

import argparse
import dataclasses
import math
import os
import resource
import tempfile
import time
from concurrent.futures import Executor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from remap_table import Row, decibel_row, limit_row, note, print_table

from fullsphere.model.camera import Camera
from fullsphere.model.colour import encoded_from_linear
from fullsphere.model.lens import BaksteinPajdla, FloatArray
from fullsphere.model.surface import Mosaic360
from fullsphere.model.workers import ordered_map, thread_pool
from fullsphere.mosaic.arm import ArmTurn, mount_angles, mount_of
from fullsphere.mosaic.assembly import assemble
from fullsphere.mosaic.eyes import eyes_of
from fullsphere.mosaic.frames import read_files
from fullsphere.mosaic.omnistereo import omnistereo, pictures_for, range_from
from fullsphere.mosaic.turn_angles import find_turn
from fullsphere.mosaic.turn_reader import TurnReader
from fullsphere.mosaic.worlds import PanelScene, TrueMosaic, furnished_room, photograph_on_arm, true_mosaic

PARTS = ("known", "found", "held", "range", "time")
ARM, WIDTH = 0.15, 1024
HALF_FOV = math.radians(91.5)
NEAR = 8.0  # arm lengths: the furniture


@dataclasses.dataclass(frozen=True, eq=False)
class Place:
    """Where frames are taken, what ought to be seen, and where all is kept."""

    room: PanelScene
    truth: TrueMosaic
    folder: Path
    executor: Executor


def camera_of(side: int) -> Camera:
    shape = BaksteinPajdla(1.35, 2.11, 0.42, 1.13)
    lens = shape.scaled(0.97 * side / 2 / float(shape.radius(HALF_FOV)))
    return Camera(lens, (side, side), (side / 2 + 1.7, side / 2 - 2.2), half_fov=HALF_FOV)


def taken(place: Place, name: str, angles: FloatArray, mount: FloatArray | None = None, side: int = 900) -> ArmTurn:
    """Frames at angles (n,) in radians, with what is true of them; rendered if they are not there."""
    folder, camera = place.folder / name, camera_of(side)
    folder.mkdir(parents=True, exist_ok=True)
    mount = np.eye(3) if mount is None else mount
    paths = [folder / f"turn_{k:03d}.jpg" for k in range(len(angles))]
    for k in [k for k, path in enumerate(paths) if not path.exists()]:
        frame = photograph_on_arm(
            place.room, camera, angles[k], ARM, mount=mount, noise=0.003, seed=k, executor=place.executor
        )
        cv2.imwrite(str(paths[k]), np.ascontiguousarray(frame[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 95])
    frames = [dataclasses.replace(frame, sha256="") for frame in read_files(paths, place.executor)]
    return ArmTurn(camera, tuple(frames), angles, mount)


def even(count: int) -> FloatArray:
    return np.arange(count) * 2 * np.pi / count


def psnr(mosaic: NDArray[np.uint8], truth: TrueMosaic, eye: int, chosen: NDArray[np.bool_] | None = None) -> float:
    """dB of an eye within 75 degrees of the horizon, or of what is chosen (W, W) of the mosaic there."""
    width = mosaic.shape[1]
    rows = slice(width // 24, -(width // 24))
    wanted = eyes_of(np.ones((width, width), bool) if chosen is None else chosen)[eye][rows]
    true = encoded_from_linear(eyes_of(truth.light)[eye], np.uint8)
    error = (eyes_of(mosaic)[eye].astype(float) - true)[rows][wanted]
    return float(10 * np.log10(255**2 / np.mean(error**2)))


def both(mosaic: NDArray[np.uint8], truth: TrueMosaic) -> float:
    """The lesser of the PSNR of both eyes."""
    return min(psnr(mosaic, truth, eye) for eye in (0, 1))


def plain(turn: ArmTurn, executor: Executor) -> NDArray[np.uint8]:
    """The mosaic as if all were far."""
    pictures = pictures_for(turn.camera, turn.frames)
    list(ordered_map(executor, pictures.read, turn.frames))
    reader = TurnReader(turn, pictures, Mosaic360((WIDTH, WIDTH)), None)
    gains = np.ones((len(turn.frames), 3), np.float32)
    return np.concatenate([part.codes for part in assemble(reader, gains, executor=executor)], axis=1)


def known_rows(place: Place) -> list[Row]:
    rows = []
    for count in (180, 60):
        turn = taken(place, f"even{count}", even(count))
        made = omnistereo(turn, WIDTH, place.executor).codes
        far = plain(turn, place.executor)
        rows.append(
            decibel_row(
                f"PSNR, {count} frames / as if all were far", both(made, place.truth), both(far, place.truth), 0
            )
        )
        near = place.truth.rho < NEAR
        for name, chosen in (("near", near), ("far", ~near)):
            ours, peer = (min(psnr(one, place.truth, eye, chosen) for eye in (0, 1)) for one in (made, far))
            rows.append(decibel_row(f"PSNR, {count} frames, {name} things / as if all were far", ours, peer, -1))
        left, right = eyes_of(made)
        swapped = np.concatenate([right, left])  # as eyes, one below the other
        truth = np.concatenate([encoded_from_linear(eye, np.uint8) for eye in eyes_of(place.truth.light)])
        rows.append(Row(f"PSNR, {count} frames, eyes swapped", f"{cv2.PSNR(swapped, truth):.2f} dB"))
    return rows


def turned_by(turn: ArmTurn, angle: float) -> ArmTurn:
    """The turn with all angles in the world of the truth, in which the first frame has this one."""
    angles = np.mod(turn.angles + angle, 2 * np.pi)
    order = np.argsort(angles)
    return dataclasses.replace(turn, angles=angles[order], frames=tuple(turn.frames[k] for k in order), sigmas=None)


def found_rows(place: Place) -> list[Row]:
    angles = np.sort(even(180) + np.radians(np.random.default_rng(5).normal(0, 0.5, 180)) + 0.05)
    true = taken(place, "jitter", angles)
    found = find_turn(true.frames, true.camera, place.executor)
    assert found.sigmas is not None
    off = np.degrees(found.angles - (angles - angles[0]))
    off -= np.median(off)
    ours, best = (
        both(omnistereo(turn, WIDTH, place.executor).codes, place.truth)
        for turn in (turned_by(found, angles[0] + math.radians(float(np.median(off)))), true)
    )
    return [
        limit_row("turn angles, jitter of 0.5 degrees: largest error", float(np.abs(off).max()), 0.02, "degrees"),
        Row("turn angles: rms error / stated sigma", f"{off.std() / np.degrees(found.sigmas[1:]).mean():.2f}"),
        decibel_row("PSNR, angles found / known", ours, best, -0.5),
    ]


def held_rows(place: Place) -> list[Row]:
    mount = mount_of(0, math.radians(0.8), math.radians(0.6))
    true = taken(place, "tilted", even(180), mount)
    found = find_turn(true.frames, true.camera, place.executor, true.angles)
    off = np.degrees(mount_angles(found.mount) - mount_angles(mount))
    straight = taken(place, "even180", even(180))
    ours, best = (both(omnistereo(turn, WIDTH, place.executor).codes, place.truth) for turn in (found, straight))
    return [
        limit_row("mount: error of pitch and roll", float(np.abs(off[1:]).max()), 0.03, "degrees"),
        Row("mount: error of yaw", f"{abs(off[0]):.3f} degrees"),
        decibel_row("PSNR, camera tilted / straight", ours, best, -0.5),
    ]


def range_rows(place: Place) -> list[Row]:
    turn = taken(place, "even180", even(180))
    made = omnistereo(turn, 2 * WIDTH, place.executor)
    truth = eyes_of(true_mosaic(place.room, ARM, 2 * WIDTH, supersampling=1, executor=place.executor).rho)[0]
    rows = slice(2 * WIDTH // 24, -(2 * WIDTH // 24))
    off = np.abs(range_from(made, 2 * WIDTH) / truth - 1)[rows][truth[rows] < 20]
    known = np.isfinite(off)
    return [
        limit_row("range within 20 arms, 180 frames: median error", 100 * float(np.median(off[known])), 3, "%"),
        Row("range within 20 arms: known", f"{100 * known.mean():.0f} %"),
    ]


def time_rows(place: Place) -> list[Row]:
    """720 frames of 2000 px, of which only 60 are different: what they show does not matter here."""
    few = taken(place, "large", even(60), side=2000)
    frames = tuple(dataclasses.replace(few.frames[k // 12], id=str(k)) for k in range(720))
    turn = ArmTurn(few.camera, frames, even(720))
    pictures = pictures_for(turn.camera, frames)
    for _ in ordered_map(place.executor, pictures.read, frames, ahead=4):
        pass
    started, processors = time.perf_counter(), time.process_time()
    omnistereo(turn, 8192, place.executor, pictures=pictures)
    seconds, work = (time.perf_counter() - started) / 720, (time.process_time() - processors) / 720
    return [
        limit_row("720 frames of 2000 px, 8192 wide: time a frame once decoded", seconds, 0.15, "s"),
        Row("the same, time of processors", f"{work:.3g} s"),
        limit_row("the same, peak memory", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 2048, "MiB"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description="How good 360 x 360 mosaics are, and what they cost.")
    parser.add_argument("--only", nargs="+", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where frames are, and stay")
    parser.add_argument("--seed", type=int, default=1, help="of the room (default: %(default)s)")
    args = parser.parse_args()
    note(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    measures = {"known": known_rows, "found": found_rows, "held": held_rows, "range": range_rows, "time": time_rows}
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name, thread_pool() as executor:
        room = furnished_room(args.seed, texel_mm=4.0)
        truth = true_mosaic(room, ARM, WIDTH, executor=executor)
        place = Place(room, truth, (args.keep or Path(name)) / f"room{args.seed}", executor)
        for part in args.only or PARTS:
            note(part)
            rows += measures[part](place)
    print_table(rows)


if __name__ == "__main__":
    main()
