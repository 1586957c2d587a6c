"""The page about a composition: light before and after, seams, where frames disagree, coverage, and the poles."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import TYPE_CHECKING

from fullsphere.cli.page import Finding, Page, Section, Table

if TYPE_CHECKING:
    from fullsphere.mosaic.planning import Plan


def page_of_panorama(name: str, plan: Plan, executor: Executor | None = None) -> Page:
    """The page about a panorama as it was planned; its frames are opened once more."""
    import numpy as np

    from fullsphere.cli import plots_panorama as plots
    from fullsphere.mosaic.agreement import agreement
    from fullsphere.mosaic.overview import overviews
    from fullsphere.mosaic.sphere_pyramid import latitudes

    frames = plan.mosaic.registered
    names = [frame.id for frame in frames]
    found = agreement(plan.mosaic, overviews(plan.mosaic, plan.shares.sphere, executor, plan.shares.shifts))
    solid = np.cos(latitudes(len(found.frames)))[:, None]
    covered = float(((found.frames > 0) * solid).sum() / (solid.sum() * found.frames.shape[1]))
    before, after = (
        float(np.median(np.abs([getattr(pair, kind) for pair in found.pairs]))) if found.pairs else 0.0
        for kind in ("recorded_ev", "evened_ev")
    )
    owned = np.where(found.frames > 0, plan.shares.owners, -1)
    area = [float(((owned == k) * solid).sum()) for k in range(len(frames))]
    shown = [100 * part / max(sum(area), 1e-9) for part in area]
    table = Table(
        ("frame", "exposure (EV)", "red", "green", "blue", "share of the sphere"),
        tuple(
            (frame.id, f"{frame.exposure_ev:+.3f}", *(f"{w:.3f}" for w in frame.white_balance), f"{share:.1f} %")
            for frame, share in zip(frames, shown, strict=True)
        ),
    )
    return Page(
        f"{name}: a panorama of {len(frames)} frames",
        (
            Finding("Covered", f"{100 * covered:.1f} % of the sphere", "good" if covered > 0.999 else ""),
            Finding("Brightness of overlapping frames, before", f"{before:.3f} EV apart (median)"),
            Finding("after", f"{after:.3f} EV apart (median)", "good" if after < 0.05 else "look"),
        ),
        plan.notes,
        (
            Section("Light", (), (table,), (plots.exposures(found),)),
            Section("Seams", (), (), (plots.seam_map(found, plan.shares.owners, names), plots.difference_map(found))),
            Section("Coverage", (), (), (plots.coverage_map(found), plots.poles(found))),
        ),
    )
