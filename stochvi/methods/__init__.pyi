from . import averaging, closed_form, fokker_planck, linearisation, monte_carlo, periodic, replay

__all__ = [
    "averaging",
    "closed_form",
    "fokker_planck",
    "linearisation",
    "monte_carlo",
    "periodic",
    "replay",
]
