"""`exact`: the closed form of one oscillator, or that of several coordinates."""

from __future__ import annotations

import time

from stochvi.methods.closed_form import one_coordinate, several_coordinates
from stochvi.model.calculations import calculation
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NoExactSolution
from stochvi.results.response import Response
from stochvi.scenes.scene import Scene


@calculation
def exact(
    scene: Scene,
    *,
    budget: float | None = None,
) -> Response:
    """Exact stationary response (B 13.38-13.44, for any spring, any stops and a constant load).

    White force noise of intensity S = 2 theta C, C the damping, leaves the Gibbs density

        p(q, q') = Z exp(-(q' M q' / 2 + U(q)) / theta),        (B 13.38 for one coordinate)

    with U the potential of springs, load and elastic stops, infinite beyond rigid ones; for one
    oscillator theta = S0 / 2 b per unit mass. The answer holds every moment and, by stop, the
    impact rate nu = p(stop) sqrt(E y'^2 / 2 pi), y the coordinate of the impact pair. Impact speeds
    are Rayleigh distributed, which gives F1 and F2. Compliant stops also have the share of time in
    contact and the mean force. One oscillator has the mean of the largest force of a contact as
    well; it neglects noise and damping, and `bias` bounds the error of that. Without stops the
    response of a linear structure to Gaussian noise is Gaussian: white and filtered noise through
    the Lyapunov equation, tables as integrals over frequency.

    Parameters
    ----------
    scene
        The scene.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Response
        Moments, rates and their errors, SI units.

    Raises
    ------
    NoExactSolution
        With every condition that the scene does not meet.

    See Also
    --------
    stochvi.fokker_planck : The same from the Fokker-Planck equation.
    stochvi.simulate : The same by Monte Carlo.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> exact(scene).coordinates["x"]["displacement_std"]
    0.539560094 [closed form]
    """
    started = time.perf_counter()
    model = model_of(scene)
    conditions = unmet(model)
    if conditions:
        raise NoExactSolution(conditions)
    if one_oscillator(model):
        return one_coordinate.response(scene, started)
    return several_coordinates.response(scene, started)


def unmet(model: Model) -> list[str]:
    """The conditions of a closed form that a model does not meet; empty where it meets all.

    Parameters
    ----------
    model
        The model of a scene.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.exact : The method.
    stochvi.explain : What all methods say of a scene.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> len(unmet(model))  # both stops take energy
    2
    """
    return (
        one_coordinate.unmet(model) if one_oscillator(model) else several_coordinates.unmet(model)
    )


def one_oscillator(model: Model) -> bool:
    """Whether the law of one oscillator, which takes functions, is the one to use."""
    return not beyond_one_oscillator(model, with_functions=True)
