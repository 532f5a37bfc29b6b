"""Mathematics that knows no scene: laws, quadrature, spectra, linear systems, units."""
