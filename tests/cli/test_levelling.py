"""What `--level` and `--centre-yaw` ask for."""

import argparse

import numpy as np
import pytest
from turning import orientation

from fullsphere.cli.levelling import add_level_arguments, levelling_of
from fullsphere.model.errors import UsageError
from fullsphere.mosaic.options import Levelling


def asked(*words: str) -> Levelling:
    parser = argparse.ArgumentParser()
    add_level_arguments(parser)
    return levelling_of(parser.parse_args(words))


def test_nothing_said_takes_the_best_there_is() -> None:
    assert asked() == Levelling()


@pytest.mark.parametrize("source", ["auto", "cameras", "verticals", "gravity", "none"])
def test_a_source_by_its_name(source: str) -> None:
    levelling = asked("--level", source, "--centre-yaw", "-12.5")
    assert levelling.source == source
    assert levelling.turn is None
    assert levelling.centre_yaw_deg == -12.5


def test_angles_are_the_first_frames() -> None:
    levelling = asked("--level=-30,5,2.5")
    assert levelling.source == "none"
    assert levelling.turn is not None
    np.testing.assert_allclose(levelling.turn, orientation(-30, 5, 2.5).T, atol=1e-15)


@pytest.mark.parametrize("level", ["up", "", "1,2", "1,2,3,4", "1,2,x", "nan,0,0", "inf,0,0"])
def test_what_is_neither_is_refused(level: str) -> None:
    with pytest.raises(UsageError, match="auto, cameras, verticals"):
        asked("--level", level)


def test_a_longitude_that_is_no_number_is_refused() -> None:
    with pytest.raises(UsageError, match="centre-yaw"):
        asked("--centre-yaw", "nan")
