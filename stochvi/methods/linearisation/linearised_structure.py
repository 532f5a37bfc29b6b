"""The linear structure that stands for several coordinates and pairs, and its spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.frequency_response import Force, gains
from stochvi.mathematics.spectra import Filter
from stochvi.methods.linearisation.structure_closure import solutions
from stochvi.model.calculations import calculation
from stochvi.model.coverage import functions, not_gaussian
from stochvi.model.modal import EquivalentLinear, ModalForm
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

Density = Callable[[ArrayLike], NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class LinearisedStructure:
    """M q'' + C q' + K q + sum over pairs d (k (y - centre) + beta y') = forces, y = d . q.

    It stands for a scene in `linearise` (B 17.3, 17.38). Densities are one-sided per hertz, at
    frequencies in hertz, and exact for this structure; sines are lines and are left out.

    Parameters
    ----------
    coordinates
        Names of q.
    stops
        Spring k (N/m), its centre (m) and damper beta (N s/m), by the name of the pair.
    shapes
        Phi (n, n), q = Phi times modal displacements.
    stiffness, damping
        Modal matrices (n, n), stops included, and the dampers of impacts that scatter energy.
    shaken
        (one-sided density, modal forces (n,) per unit of it) of all noise, that of impacts that
        scatter energy included.

    See Also
    --------
    stochvi.methods.linearisation.linearised_structures : The calculation.
    """

    coordinates: tuple[str, ...]
    stops: Mapping[str, EquivalentLinear]
    shapes: Matrix
    stiffness: Matrix
    damping: Matrix
    shaken: tuple[tuple[Density, Force], ...]

    def displacement_density(self, coordinate: str, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the displacement of a coordinate, m^2/Hz.

        Raises
        ------
        KeyError
            If there is no such coordinate.
        """
        if coordinate not in self.coordinates:
            raise KeyError(
                f"coordinate must be one of {', '.join(self.coordinates)}, got {coordinate!r}"
            )
        row = self.shapes[self.coordinates.index(coordinate)]
        f = np.asarray(frequency_hz, dtype=float)
        total = np.zeros(f.size)
        for density, force in self.shaken:
            gain = gains(f.ravel(), self.stiffness, self.damping, force) @ row
            total += density(f.ravel()) * np.abs(gain) ** 2
        return total.reshape(f.shape)

    def velocity_density(self, coordinate: str, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the velocity of a coordinate, (m/s)^2/Hz."""
        w = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
        return np.asarray(w**2 * self.displacement_density(coordinate, frequency_hz))


@calculation
def linearised_structures(scene: Scene) -> tuple[LinearisedStructure, ...]:
    """The linear structures that stand for a scene in `linearise`, one for every solution.

    Parameters
    ----------
    scene
        Any scene that `linearise` covers by the closure. A loose mass in a box, too, gets the
        springs and dampers of the closure.

    Returns
    -------
    tuple[LinearisedStructure, ...]
        Every linear structure that was found.

    Raises
    ------
    NotApplicable, NotConverged
        As `linearise`.

    See Also
    --------
    stochvi.linearise : The response.
    stochvi.methods.linearisation.linearised_oscillators : The same for one oscillator.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Viscoelastic
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Matrices
    >>> scene = Scene(
    ...     structure=Matrices(
    ...         coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 0.5]],
    ...         damping=[[0.3, -0.1], [-0.1, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 1.0]],
    ...     ),
    ...     impact_pairs=[
    ...         ImpactPair(on="a", upper=0.5, law=Viscoelastic(stiffness=50.0, damping_ratio=0.2))
    ...     ],
    ...     excitations=[WhiteNoise(on="a", intensity=0.3)],
    ... )
    >>> (found,) = linearised_structures(scene)
    >>> f = np.linspace(0.0, 20.0, 100_001)
    >>> area = np.trapezoid(found.displacement_density("a", f), f)
    >>> from stochvi.methods.linearisation import linearise
    >>> rms = linearise(scene).coordinates["a"]["displacement_std"].value
    >>> print(f"{area**0.5 / rms:.4f}")
    1.0000
    """
    model = model_of(scene)
    if conditions := functions(model) + not_gaussian(model):
        raise NotApplicable("linearise", conditions)
    modes = model.modal
    found = []
    for one in solutions(model):
        stops = {
            gap.pair.name: gap.substitute(candidate)
            for gap, candidate in zip(one.gaps, one.candidates, strict=True)
        }
        springs = np.array([each.spring for each in stops.values()])
        dampers = np.array([each.damper for each in stops.values()])
        found.append(
            LinearisedStructure(
                coordinates=model.coordinates,
                stops=stops,
                shapes=modes.shapes,
                stiffness=np.diag(modes.squares) + (modes.gaps.T * springs) @ modes.gaps,
                damping=one.modes.damping + (modes.gaps.T * dampers) @ modes.gaps,
                shaken=_shaken(model, one.modes),
            )
        )
    return tuple(found)


def _shaken(model: Model, modes: ModalForm) -> tuple[tuple[Density, Force], ...]:
    """All noise as densities and modal forces; white noise in independent parts of density 2."""
    found: list[tuple[Density, Force]] = [(table, force) for table, force in modes.tables]
    for signal in model.signals:
        if signal.intensity:
            noise = Filter(signal.omega, signal.damping_rate, signal.intensity)
            found.append((noise.__call__, modes.shapes.T @ signal.direction))
    intensities, directions = np.linalg.eigh(modes.white)
    # the error of an eigenvalue of a matrix of low rank is the rounding error of the largest one
    kept = intensities > np.finfo(float).eps * len(intensities) * max(intensities[-1], 0.0)
    for intensity, direction in zip(intensities[kept], directions.T[kept], strict=True):
        found.append((_flat, np.sqrt(intensity) * direction))
    return tuple(found)


def _flat(frequency_hz: ArrayLike) -> Vector:
    """One-sided density of white noise of intensity 1."""
    return np.full(np.shape(frequency_hz), 2.0)
