"""Figures: the same bytes for the same values, whatever the user's settings; small; true to their numbers."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from calibrations import CAMERA, made_calibration

from fullsphere.cli.figures import Format, write_figure
from fullsphere.cli.plots_lens import binned, curve_sigma, projection_functions
from fullsphere.cli.plots_picture import difference_map, magnification, reprojection, round_number
from fullsphere.cli.plots_points import error_by_point, probability
from fullsphere.model.calibration.difference import difference
from fullsphere.model.errors import OutputError, UsageError
from fullsphere.model.lens import Equidistant, Equisolid, Orthographic, Perspective, Stereographic

SIGNATURES: dict[Format, bytes] = {"png": b"\x89PNG\r\n", "pdf": b"%PDF-1", "svg": b"<?xml"}


@pytest.mark.parametrize("format_", SIGNATURES)
def test_bytes_depend_on_the_values_alone(format_: Format) -> None:
    first = projection_functions(CAMERA).encoded(format_)
    with mpl.rc_context({"font.size": 31, "lines.linewidth": 9, "svg.hashsalt": "other", "savefig.dpi": 20}):
        settings = dict(mpl.rcParams)
        again = projection_functions(CAMERA)
        second, third = again.encoded(format_), again.encoded(format_)
        assert dict(mpl.rcParams) == settings
    assert first == second == third
    assert first.startswith(SIGNATURES[format_])


@pytest.mark.parametrize("format_", SIGNATURES)
def test_no_date_and_no_version_is_in_a_file(format_: Format) -> None:
    content = projection_functions(CAMERA).encoded(format_)
    for telling in (b"CreationDate", b"dc:date", b"matplotlib.org", b"Matplotlib v", b"Software"):
        assert telling not in content


def test_neither_pyplot_nor_a_window_is_needed() -> None:
    code = (
        "import sys; from calibrations import CAMERA; import fullsphere.cli.report;"
        "assert 'matplotlib' not in sys.modules;"
        "from fullsphere.cli.plots_lens import projection_functions; projection_functions(CAMERA).encoded('png');"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    folder = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_classical_projections_are_drawn_to_the_scale_of_the_lens_on_its_axis() -> None:
    lines = {
        str(line.get_label()): np.asarray(line.get_xydata(), float).T
        for line in projection_functions(CAMERA).figure.axes[0].get_lines()
    }
    scale = float(CAMERA.lens.slope(0.0))
    for lens in (Perspective(scale), Stereographic(scale), Equidistant(scale), Equisolid(scale), Orthographic(scale)):
        theta_deg, radius = lines[lens.projection]
        assert len(radius) > 100
        np.testing.assert_allclose(radius, lens.radius(np.radians(theta_deg)))
    theta_deg, radius = lines[f"this lens: {CAMERA.lens.projection}"]
    assert math.isclose(theta_deg[-1], math.degrees(CAMERA.half_fov))
    np.testing.assert_allclose(radius, CAMERA.lens.radius(np.radians(theta_deg)))


def test_reprojection_lines_are_residuals_times_the_magnification_that_is_printed() -> None:
    calibration = made_calibration(points=60, rejected=4)
    drawing = reprojection(calibration)
    stated = float(drawing.title.split("magnified ")[1].split(" times")[0])
    (lines,) = (c for c in drawing.figure.axes[0].collections if len(c.get_paths()) == 116)
    drawn = np.array([path.vertices for path in lines.get_paths()])
    residuals = np.concatenate(calibration.residuals_px)[np.concatenate(calibration.used)]
    np.testing.assert_allclose(drawn[:, 1] - drawn[:, 0], stated * residuals, atol=1e-9)
    rejected = (c for c in drawing.figure.axes[0].collections if len(c.get_paths()) == 2)
    assert next(rejected, None) is not None  # of the four, two have no residual at all


def test_seven_thousand_points_make_a_small_figure_that_is_still_a_vector_figure() -> None:
    calibration = made_calibration(points=700, views=10)
    pixels = np.concatenate(calibration.residuals_px)
    used, view = np.concatenate(calibration.used), np.repeat(np.arange(10), 700)
    for drawing in (reprojection(calibration), error_by_point(np.hypot(*pixels.T), used, view, 0.3)):
        content = drawing.encoded("svg")
        assert len(content) < 1_200_000
        assert content.count(b"<path") > 10
        assert b"<image" in content


@pytest.mark.parametrize("value", [3e-7, 0.4, 1, 1.99, 2, 4.999, 5, 9.99, 10, 731.0])
def test_round_numbers_are_below_and_near(value: float) -> None:
    found = round_number(value)
    assert found <= value * (1 + 1e-9) < 2.5 * found
    assert round(found / 10 ** math.floor(math.log10(found * (1 + 1e-9)))) in (1, 2, 5)


def test_large_errors_are_not_made_smaller() -> None:
    assert magnification(500.0, 20.0) == 1
    assert magnification(0.0, 20.0) > 1e6


def test_means_over_bins_have_the_standard_error_of_their_points() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 9, 3000)
    middle, mean, error = binned(x, np.floor(x / 3) + rng.normal(0, 0.5, x.size), 3.0)
    np.testing.assert_allclose(middle, [1.5, 4.5, 7.5], atol=0.1)
    np.testing.assert_allclose(mean, [0, 1, 2], atol=4 * 0.5 / math.sqrt(1000))
    np.testing.assert_allclose(error, 0.5 / math.sqrt(1000), rtol=0.1)
    assert binned(np.array([1.0, 2.0]), np.array([0.0, 0.0]), 3.0)[0].size == 0  # two points say nothing


def test_small_probabilities_are_words_not_noughts() -> None:
    assert [probability(p) for p in (0.0, 9e-5, 0.034, 1.0)] == ["< 0.0001", "< 0.0001", "0.034", "1"]


def test_equal_cameras_make_a_map_without_warnings() -> None:
    assert difference_map(CAMERA, difference(CAMERA, CAMERA)).encoded("png")


def test_the_range_without_points_is_hatched_and_only_there() -> None:
    theta_deg = np.arange(93.0)
    for observed, hatched in (((5.0, 80.0), 2), ((0.0, 80.0), 1), ((0.0, 95.0), 0)):
        axes = curve_sigma(theta_deg, 0.01 * theta_deg, observed).figure.axes[0]
        assert sum(patch.get_hatch() is not None for patch in axes.patches) == hatched


def test_a_figure_is_written_by_its_ending_and_never_over_another_file(tmp_path: Path) -> None:
    drawing = projection_functions(CAMERA)
    for format_, signature in SIGNATURES.items():
        path = tmp_path / f"figure.{format_.upper()}"
        write_figure(path, drawing, overwrite=False)
        assert path.read_bytes().startswith(signature)
        with pytest.raises(OutputError, match="exists already"):
            write_figure(path, drawing, overwrite=False)
    with pytest.raises(UsageError, match=r"\.png, \.pdf or \.svg"):
        write_figure(tmp_path / "figure.gif", drawing, overwrite=False)
    assert len(list(tmp_path.iterdir())) == 3
