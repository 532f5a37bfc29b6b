"""Linear numbers of a table and of a record, by pyYeti and by scipy alone.

Both judges answer the same questions, so that numbers can be compared where pyYeti is not
installed. Tables are (frequency in Hz, one-sided density), straight in double logarithmic axes;
accelerations of records are in m/s^2. `q` is 1 / (2 zeta).
"""

import math
from itertools import pairwise

import numpy as np
from scipy import integrate, signal

POINTS = 20_001
"""Frequencies of a grid on which pyYeti integrates; its sums are then converged to 3e-4."""

POINTS_PER_CYCLE = 200
"""Fewest samples per natural period from which a peak is read: 1 - cos(pi / 200) is 1.2e-4."""


class PyYeti:
    """pyYeti's own functions: psd.area, srs.vrs, ode.SolveUnc, srs.srs and psd.psdmod."""

    name = "pyYeti"

    def __init__(self) -> None:
        from pyyeti import ode, psd, srs

        self.ode, self.psd, self.srs = ode, psd, srs

    def input_rms(self, table) -> float:
        return math.sqrt(self.psd.area(np.transpose(table))[0])

    def responses(self, table, natural, q) -> dict[str, np.ndarray]:
        """Rms absolute acceleration, Miles' estimate of it, and rms relative displacement."""
        grid = grid_of(table, natural, q)
        rms, miles = self.srs.vrs(tuple(map(np.asarray, table)), grid, q, linear=False, Fn=natural,
                                  getmiles=True)  # fmt: skip
        density = self.psd.interp(np.transpose(table), grid).ravel()
        moved = []
        for each in 2.0 * np.pi * natural:
            solver = self.ode.SolveUnc(1.0, each / q, each**2)
            motion = solver.fsolve(-np.ones((1, len(grid))), grid).d[0]
            moved.append(math.sqrt(np.trapezoid(np.abs(motion) ** 2 * density, grid)))
        return {"acceleration": rms, "miles": miles, "displacement": np.array(moved)}

    def record(self, values, fs, natural, q, finely: bool = True) -> dict[str, np.ndarray]:
        """Shock response spectra, with peaks between samples if `finely`; rms displacement."""
        ends = {"highest": "pos", "lowest": "neg"}
        asked = {"sr": fs, "freq": natural, "Q": q, "ic": "zero", "parallel": "no"}
        read = {"ppc": POINTS_PER_CYCLE, "rolloff": "linear"} if finely else {"rolloff": "none"}
        found = {
            name: self.srs.srs(values, stype="reldisp", peak=peak, **asked, **read)
            for name, peak in ends.items()
        }
        found["acceleration"] = self.srs.srs(values, stype="absacce", **asked, **read)
        found["rms"] = self.srs.srs(values, stype="reldisp", peak=spread, rolloff="none", **asked)
        return found

    def density(self, values, fs, length):
        duration = len(values) / fs
        return self.psd.psdmod(values, fs, nperseg=length, timeslice=duration)


class SciPy:
    """Quadrature of the same integrals; an exact filter of an input linear between samples."""

    name = "scipy"

    def input_rms(self, table) -> float:
        return math.sqrt(integral(table, np.ones_like))

    def responses(self, table, natural, q) -> dict[str, np.ndarray]:
        found: dict[str, list[float]] = {"acceleration": [], "miles": [], "displacement": []}
        for each in natural:

            def gain(f, each=each):
                return 1.0 / ((1.0 - (f / each) ** 2) ** 2 + (f / each / q) ** 2)

            def passed(f, each=each, gain=gain):
                return (1.0 + (f / each / q) ** 2) * gain(f)

            found["acceleration"].append(math.sqrt(integral(table, passed, each)))
            moved = math.sqrt(integral(table, gain, each))
            found["displacement"].append(moved / (2.0 * math.pi * each) ** 2)
            found["miles"].append(math.sqrt(math.pi / 2.0 * each * q * density_at(table, each)))
        return {name: np.array(values) for name, values in found.items()}

    def record(self, values, fs, natural, q, finely: bool = True) -> dict[str, np.ndarray]:
        found: dict[str, list[float]] = {
            "highest": [], "lowest": [], "acceleration": [], "rms": []
        }  # fmt: skip
        for each in natural:
            omega = 2.0 * math.pi * each
            times = max(1, math.ceil(POINTS_PER_CYCLE * each / fs)) if finely else 1
            fine = np.interp(np.arange((len(values) - 1) * times + 1) / times,
                             np.arange(len(values)), values)  # fmt: skip
            shares = {"moved": [-1.0], "felt": [omega / q, omega**2]}
            motion = {}
            for name, numerator in shares.items():
                system = (numerator, [1.0, omega / q, omega**2])
                top, bottom, _ = signal.cont2discrete(system, 1.0 / (fs * times), "foh")
                motion[name] = signal.lfilter(np.ravel(top), bottom, fine)
            found["highest"].append(motion["moved"].max())
            found["lowest"].append(-motion["moved"].min())
            found["acceleration"].append(np.abs(motion["felt"]).max())
            found["rms"].append(motion["moved"][::times].std())
        return {name: np.array(values) for name, values in found.items()}

    def density(self, values, fs, length):
        return signal.welch(values, fs, nperseg=length)


def judge():
    """pyYeti where it is installed, else scipy."""
    try:
        return PyYeti()
    except ModuleNotFoundError:
        return SciPy()


def spread(response: np.ndarray) -> np.ndarray:
    """Standard deviation of each column."""
    return response.std(axis=0)


def density_at(table, f) -> np.ndarray:
    """Density of a table, straight in logarithms, 0 outside."""
    x, y = np.log(table[0]), np.log(table[1])
    return np.where((f >= table[0][0]) & (f <= table[0][-1]), np.exp(np.interp(np.log(f), x, y)), 0)


def grid_of(table, natural, q) -> np.ndarray:
    """Frequencies of an integral, over the table and all natural frequencies.

    They reach beyond a table that ends before a natural frequency: srs.vrs adds the natural
    frequencies to those that it is given, and takes a gap up to one of them for a wide strip.
    """
    low, high = min(table[0][0], natural.min()), max(table[0][-1], natural.max())
    near = (natural[:, None] * (1.0 + np.linspace(-3.0, 3.0, 401) / q)).ravel()
    near = near[(near > low) & (near < high)]
    return np.unique(np.concatenate([np.geomspace(low, high, POINTS), np.asarray(table[0]), near]))


def integral(table, weight, natural: float | None = None) -> float:
    """Integral of weight(f) times the density, piece by piece between breakpoints."""
    cuts = set(map(float, table[0]))
    if natural is not None:
        cuts |= {c * natural for c in (0.8, 0.95, 1.0, 1.05, 1.25)
                 if table[0][0] < c * natural < table[0][-1]}  # fmt: skip
    ordered = sorted(cuts)
    return sum(
        integrate.quad(lambda f: float(weight(f) * density_at(table, f)), low, high, epsrel=1e-10)[
            0
        ]
        for low, high in pairwise(ordered)
    )
