"""A solution -> the mosaic: levelled orientations, what became of each frame, and how good it all is."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from fullsphere.model.lens import FloatArray
from fullsphere.mosaic.allowed import allowed_pixels
from fullsphere.mosaic.left_out import why_left_out
from fullsphere.mosaic.level import level
from fullsphere.mosaic.links import Evidence, Pair
from fullsphere.mosaic.match_errors import held_out_px
from fullsphere.mosaic.options import Levelling
from fullsphere.mosaic.parallax import Parallax
from fullsphere.mosaic.project import Frame, Link, Mosaic
from fullsphere.mosaic.rig import Rig
from fullsphere.mosaic.self_calibration import tolerance_px
from fullsphere.mosaic.solution import Solution

HELD_OUT_GATE = 12 / 1920
"""Share of the picture's width beyond which two rays that no fit saw are no match at all."""


def mosaic_of(
    frames: Sequence[Frame],
    rig: Rig,
    evidence: Evidence,
    solution: Solution,
    parallax: Mapping[Pair, Parallax],
    self_calibrated: bool,
    levelling: Levelling,
    executor: Executor | None = None,
) -> Mosaic:
    """The mosaic that a solution makes.

    Parameters
    ----------
    frames
        All of them, those left out before included.
    rig
        Which camera took which frame.
    evidence
        What the frames in use have in common.
    solution
        Their orientations.
    parallax
        Of pairs of frames, under the solution's cameras.
    self_calibrated
        Whether the solution's cameras were estimated from the frames themselves.
    levelling
        What up is found by.
    executor
        Where pairs are worked on side by side.
    """
    links, group, adjusted = solution
    reasons = _reasons(frames, evidence, solution, executor)
    placed: list[Frame] = []
    for k, frame in enumerate(frames):
        if k in reasons:
            placed.append(frame.left_out(reasons[k]))
        elif frame.reason:
            placed.append(frame)
        else:
            sigma_deg = float(np.rad2deg(adjusted.sigma[k]))
            placed.append(dataclasses.replace(frame, camera_from_world=adjusted.rotations[k], sigma_deg=sigma_deg))
    levelled = level(placed, adjusted.cameras, levelling, executor)
    return Mosaic(
        adjusted.cameras,
        tuple(_turned(frame, levelled.levelled_from_world) for frame in placed),
        tuple(_judged(link, parallax) for link in links),
        level=levelled.source,
        self_calibrated=self_calibrated,
        quality=_quality(solution, rig) | _known(level_sigma_deg=levelled.sigma_deg),
        camera_from_rig=tuple(adjusted.mounts) if rig.mount_tree(group) else (),
        camera_covariances=adjusted.covariances if any(c.any() for c in adjusted.covariances) else (),
    )


def _turned(frame: Frame, levelled_from_world: FloatArray) -> Frame:
    if frame.camera_from_world is None:
        return frame
    return dataclasses.replace(frame, camera_from_world=frame.camera_from_world @ levelled_from_world.T)


def _known(**figures: float | None) -> dict[str, float]:
    return {name: figure for name, figure in figures.items() if figure is not None}


def _reasons(
    frames: Sequence[Frame], evidence: Evidence, solution: Solution, executor: Executor | None
) -> dict[int, str]:
    """Why each frame that was in use found no place."""
    group, cameras = set(solution.group.tolist()), solution.adjustment.cameras
    lost = [k for k in evidence.features if k not in group]
    if not lost:
        return {}
    links = evidence.links(cameras, tolerance_px(cameras), executor)
    found = {}
    for k in lost:
        allowed = allowed_pixels(frames[k], frames[k].load(), cameras[frames[k].camera])
        found[k] = why_left_out(k, frames, evidence, cameras, links, group, allowed)
    return found


def _judged(link: Link, parallax: Mapping[Pair, Parallax]) -> Link:
    one = parallax.get((link.i, link.j))
    return link if one is None else dataclasses.replace(link, verdict=one.verdict)


def _quality(solution: Solution, rig: Rig) -> dict[str, float]:
    links, _, adjusted = solution
    every = np.concatenate(adjusted.residuals_px)
    held = held_out_px(links, adjusted.rotations, adjusted.cameras, rig)
    inside = held[held < HELD_OUT_GATE * max(side for camera in adjusted.cameras for side in camera.size)]
    return {
        "matches": int(every.size),
        "residual_median_px": float(np.median(every)),
        "residual_rms_px": _rms(every[every < tolerance_px(adjusted.cameras)]),
        "held_out_matches": int(inside.size),
        "held_out_share": inside.size / held.size if held.size else 0.0,
        "held_out_median_px": float(np.median(inside)) if inside.size else 0.0,
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
