"""Mathematics that knows no scene: laws, quadrature, spectra, linear systems, units."""

__all__ = ["kelvin_voigt", "rods"]
