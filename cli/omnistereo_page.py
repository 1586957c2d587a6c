"""The page about a 360 x 360 mosaic: the turn, how the camera is held, light, the mosaic and range."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fullsphere.cli.page import Finding, Page, Section, Table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fullsphere.mosaic.arm import ArmTurn
    from fullsphere.mosaic.omnistereo import Omnistereo

_THUMBNAIL = 1024


def page_of_turn(name: str, turn: ArmTurn, made: Omnistereo) -> Page:
    """The page about a mosaic that was made."""
    import numpy as np

    from fullsphere.cli import plots_omnistereo as plots
    from fullsphere.mosaic.arm import mount_angles
    from fullsphere.mosaic.eyes import eyes_of
    from fullsphere.mosaic.omnistereo import range_from
    from fullsphere.mosaic.red_cyan import red_cyan

    assert turn.sigmas is not None
    small = _small(made)
    seen, sigma = float(made.seen.mean(dtype=float)), float(np.degrees(turn.sigmas).max())
    held = zip(
        ("yaw", "pitch", "roll"), np.degrees(mount_angles(turn.mount)), np.degrees(turn.mount_sigmas), strict=True
    )
    mount = Table(
        ("camera on the arm", "degrees", "sigma"), tuple((what, f"{a:+.3f}", f"{s:.3f}") for what, a, s in held)
    )
    flicker = float(np.log2(made.gains).std())
    return Page(
        f"{name}: a turn of {len(turn.frames)} frames",
        (
            Finding("Seen", f"{100 * seen:.2f} % of the mosaic", "good" if seen == 1 else "look"),
            Finding("Turn angles", f"known to {sigma:.3f} degrees" if sigma else "as they were told"),
            Finding("Light of the frames", f"{flicker:.3f} EV rms, evened out"),
        ),
        turn.diagnosis,
        (
            Section("The turn", (), (mount,), (plots.steps(turn), plots.light(turn, made.gains))),
            Section("The mosaic", (), (), (plots.mosaic(small), plots.anaglyph(red_cyan(*eyes_of(small))))),
            Section("Range", (), (), (plots.nearness(range_from(made, len(small))),)),
        ),
    )


def _small(made: Omnistereo) -> NDArray[np.uint8]:
    """The mosaic as a thumbnail of 8 bits."""
    import cv2
    import numpy as np

    from fullsphere.model.colour import encoded_from_linear

    width = min(_THUMBNAIL, made.codes.shape[1])
    small = cv2.resize(made.codes, (width, width), interpolation=cv2.INTER_AREA)
    if small.dtype.kind == "f":
        return np.asarray(encoded_from_linear(small, np.uint8, made.profile), np.uint8)
    return np.asarray(small if small.dtype == np.uint8 else small >> 8, np.uint8)
