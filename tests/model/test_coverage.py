"""Alpha of resampled pictures."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fullsphere.model.coverage import file_channels, with_channels


@pytest.mark.parametrize(
    ("given", "alpha", "channels"),
    [(1, True, 2), (1, False, 1), (2, True, 2), (2, False, 1), (3, True, 4), (4, False, 3)],
)
def test_a_file_has_alpha_or_not_whatever_the_source_had(given: int, alpha: bool, channels: int) -> None:
    assert file_channels(given, alpha) == channels


@pytest.mark.parametrize(("dtype", "whole"), [(np.uint8, 255), (np.uint16, 65535), (np.float16, 1), (np.float32, 1)])
@pytest.mark.parametrize("colours", [1, 3])
def test_alpha_says_what_was_seen(dtype: type, whole: int, colours: int) -> None:
    pixels: NDArray[Any] = np.full((2, 2, colours), whole / 4, dtype)
    weight = np.array([[0, 0.25], [0.5, 1]], np.float32)
    result = with_channels(pixels, weight, colours + 1)
    assert result.dtype == dtype
    assert np.array_equal(result[..., :-1], pixels)
    assert np.allclose(result[..., -1], weight * whole, atol=0.5 if whole > 1 else 0)


def test_alpha_that_was_there_counts_with_what_was_seen() -> None:
    pixels = np.full((1, 2, 4), 200, np.uint8)
    assert with_channels(pixels, np.array([[0.5, 1]], np.float32), 4)[0].tolist() == [
        [200, 200, 200, a] for a in (100, 200)
    ]
    assert with_channels(pixels, np.array([[0.5, 1]], np.float32), 3)[0].tolist() == [[200] * 3] * 2
