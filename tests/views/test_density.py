"""Pictures of densities: what is drawn is what the density says."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest

from support.known import oscillator

mpl.use("Agg")

from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator
from stochvi.views.density import plot_impact_speeds, plot_marginals, plot_plane

LOSSY = oscillator(-0.7, 1.0, 0.4, load=0.2)
SOFT = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    impact_pairs=[
        ImpactPair(
            lower=-1.0,
            upper=1.0,
            lower_law=Restitution(coefficient=1.0),
            upper_law=Elastic(stiffness=20.0),
        )
    ],
    excitations=[WhiteNoise(intensity=0.2)],
)


@pytest.fixture(scope="module")
def lossy():
    return fokker_planck_density(LOSSY)


def test_the_plane_holds_the_density_between_walls_with_a_slit(lossy):
    ax = plot_plane(LOSSY, lossy)
    (mesh,) = ax.collections
    shown = np.asarray(mesh.get_array())
    assert shown.shape == (241, 241) and np.all(np.isfinite(shown))
    x, v = np.linspace(-0.7, 1.0, 241), np.asarray(mesh.get_coordinates())[:, 0, 1]
    assert shown[180, 100] == pytest.approx(float(lossy.density(x[100], v[180])), rel=1e-6)
    walls = [line for line in ax.lines if len(set(line.get_xdata())) == 1]
    assert sorted({float(line.get_xdata()[0]) for line in walls}) == [-0.7, 1.0]
    assert len(walls) == 4 and all(0.5 not in line.get_ydata() for line in walls)


def test_a_stop_that_gives_way_has_no_slit_and_the_picture_goes_on_behind_it():
    found = exact_density(SOFT)
    ax = plot_plane(SOFT, found)
    assert {float(line.get_xdata()[0]) for line in ax.lines} == {-1.0}
    assert ax.get_xlim()[1] > 1.3
    ax = plot_impact_speeds(SOFT, found)
    assert [line.get_label() for line in ax.lines if "β" in line.get_label()] != []


def test_impact_speeds_have_the_slope_that_the_dotted_line_says(lossy):
    ax = plot_impact_speeds(LOSSY, lossy)
    curves = {line.get_label(): line for line in ax.lines}
    dotted = next(line for name, line in curves.items() if "β" in name)
    w, line = dotted.get_data()
    slope = np.log(line[-1] / line[0]) / np.log(w[-1] / w[0])
    assert slope == pytest.approx(1.0 - corner_exponent(0.4), rel=1e-10)
    speeds, flux = curves["upper stop"].get_data()
    slow = (speeds > 0.006) & (speeds < 0.03)
    found = np.polyfit(np.log(speeds[slow]), np.log(flux[slow]), 1)[0]
    assert found == pytest.approx(slope, abs=0.1)


def test_marginals_are_curves_of_unit_area(lossy):
    for ax in plot_marginals(LOSSY, lossy):
        x, p = ax.lines[0].get_data()
        # a singular stop lies between two points of the curve
        assert np.trapezoid(p, x) == pytest.approx(1.0, abs=0.03)
