"""Rows of finished panoramas of rendered frames: how like the scene they are, and how their light was found."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from composition_scene import WIDTH, RenderedTruth, Seen, likeness, oracle, scene_of
from registration_process import fullsphere, run
from remap_table import Row, limit_row, note

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.project import Mosaic
from fullsphere.mosaic.store import load_mosaic
from fullsphere.mosaic.truth import rotation_errors_deg

_WITHIN_DB = {"true": 1.0, "self": 3.0}
_COVER_LOST = 0.001
_EXPOSURE_EV, _VIGNETTING = 0.02, 0.01
_FIELD = 0.98  # of theta, to which vignetting is compared


def stitched(truth: RenderedTruth, lens: str, folder: Path) -> tuple[Path, Path]:
    """The panorama and the mosaic of a set, made by the command with the true lens or with none, if not there yet."""
    name = f"{truth.folder.name}_{truth.scene.stem}_{lens}"
    picture, mosaic = folder / f"{name}.tif", folder / f"{name}.json"
    if not (picture.exists() and mosaic.exists()):
        note(f"stitching {truth.folder.name}, {lens} lens")
        files = [str((truth.folder / file).resolve()) for file in truth.files]
        camera = ["--camera", str((truth.folder / "camera.json").resolve())] if lens == "true" else []
        sizes = ["--size", str(WIDTH), "--overwrite"]
        run(fullsphere("stitch", *files, "-o", str(picture), "--mosaic", str(mosaic), *sizes, *camera), folder)
    return picture, mosaic


def likeness_rows(truths: Sequence[RenderedTruth], lenses: Sequence[str], folder: Path) -> list[Row]:
    """PSNR against the scene beside that of perfect knowledge, and cover."""
    rows: list[Row] = []
    for truth in truths if lenses else ():
        note(f"{truth.folder.name}: what perfect knowledge gives")
        scene = scene_of(truth)
        perfect = likeness(oracle(truth), scene, np.eye(3))
        for lens in lenses:
            picture, mosaic = stitched(truth, lens, folder)
            turn = scene_from_mosaic(load_mosaic(mosaic), truth)
            found = likeness(Seen.read(picture), scene, turn)
            less = perfect.psnr_db - found.psnr_db
            holds = less <= _WITHIN_DB[lens] and found.cover >= perfect.cover - _COVER_LOST
            rows.append(
                Row(
                    f"PSNR, {truth.folder.name}, {truth.scene.stem[:12]}, {lens} lens / perfect knowledge",
                    f"{found.psnr_db:.2f} dB, cover {found.cover:.4f}",
                    f"{perfect.psnr_db:.2f} dB, cover {perfect.cover:.4f}",
                    f"{-less:+.2f} dB",
                    f">= {-_WITHIN_DB[lens]:g}",
                    "yes" if holds else "NO",
                )
            )
    return rows


def scene_from_mosaic(mosaic: Mosaic, truth: RenderedTruth) -> FloatArray:
    """The turn (3, 3) from the mosaic's world to the scene's."""
    true = dict(zip(truth.files, truth.rotations, strict=True))
    frames = [(f.camera_from_world, true[Path(f.image).name]) for f in mosaic.registered]
    _, turn = rotation_errors_deg([found for found, _ in frames if found is not None], [there for _, there in frames])
    return turn


def light_rows(truths: Sequence[RenderedTruth], folder: Path) -> list[Row]:
    """Exposures and vignetting as the mosaic with the true lens has them, against those that frames were made with."""
    rows = []
    for truth in truths:
        mosaic = load_mosaic(stitched(truth, "true", folder)[1])
        true = dict(zip(truth.files, np.log2(truth.gains), strict=True))
        off = np.array([f.exposure_ev - true[Path(f.image).name] for f in mosaic.registered])
        spread = np.ptp(np.log2(truth.gains))
        s = np.linspace(0, _FIELD, 99) ** 2
        w1, w2 = mosaic.vignetting_of(0)
        vignetting = np.abs(np.exp2(w1 * s + w2 * s**2) / (1 - truth.vignette * s) - 1).max()
        name = truth.folder.name
        rms = float(np.sqrt(np.mean((off - off.mean()) ** 2)))
        rows.append(limit_row(f"exposures, {name}, {spread:.2f} EV apart: rms error", rms, _EXPOSURE_EV, "EV"))
        rows.append(limit_row(f"vignetting, {name}: largest error", 100 * float(vignetting), 100 * _VIGNETTING, "%"))
    return rows
