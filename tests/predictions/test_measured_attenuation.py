"""Points of attenuation from a file: what is read, what is refused, what is drawn."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer
from synthetic_fit import make_fit

from pyburgers.common.errors import InputError
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.attenuation_figures import attenuation
from pyburgers.predictions.measured_attenuation import load_measured_attenuation

POINTS = """# made up for a test
frequency_Hz, tan_delta, tan_delta_sd, series
1e-3, 0.41, 0.03, 1 MPa
1e-2, 0.22, , 1 MPa
1e-1, 0.11, 0.01,
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_points_are_read_with_and_without_what_is_optional(tmp_path: Path) -> None:
    points = load_measured_attenuation(write(tmp_path, POINTS))
    assert points.frequency.tolist() == [1e-3, 1e-2, 1e-1]
    assert points.tan_delta.tolist() == [0.41, 0.22, 0.11]
    assert points.standard_deviation.tolist() == [0.03, 0.0, 0.01]
    assert points.series == ("1 MPa", "1 MPa", "measured")
    bare = load_measured_attenuation(write(tmp_path, "frequency_Hz,tan_delta\n0.01,0.2\n"))
    assert bare.series == ("measured",)
    assert bare.standard_deviation.tolist() == [0.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tan_delta\n0.1\n", "column 'frequency_Hz' is missing, expected frequency_Hz, tan_delta"),
        ("frequency_Hz,tan_delta,q\n1,1,1\n", "found column 'q', expected frequency_Hz"),
        ("frequency_Hz,tan_delta\n", "found no points, expected at least one row"),
        ("frequency_Hz,tan_delta\n1,1\n-1,1\n", "'frequency_Hz', point 2: found '-1', expected a"),
        ("frequency_Hz,tan_delta\n1,x\n", "column 'tan_delta', point 1: found 'x', expected a"),
        (
            "frequency_Hz,tan_delta,tan_delta_sd\n1,1,-2\n",
            "found '-2', expected zero or a positive",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_measured_attenuation(write(tmp_path, text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.csv does not exist"):
        load_measured_attenuation(tmp_path / "absent.csv")


def test_points_are_drawn_over_the_spectrum(tmp_path: Path) -> None:
    spectrum = predict_attenuation(make_fit(tmp_path / "run", draws=30))
    points = load_measured_attenuation(write(tmp_path, POINTS))
    axes = attenuation(spectrum, "title", measured=points).axes[0]
    containers = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
    drawn = {one.get_label(): one.lines[0].get_xydata() for one in containers}
    assert set(drawn) == {"1 MPa", "measured"}
    assert drawn["1 MPa"] == pytest.approx(np.array([[1e-3, 0.41], [1e-2, 0.22]]))
    (legend,) = axes.figure.legends
    assert {"1 MPa", "measured"} <= {text.get_text() for text in legend.get_texts()}
    assert not attenuation(spectrum, "title").axes[0].containers
