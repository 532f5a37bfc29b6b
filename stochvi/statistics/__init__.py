"""What Monte Carlo samples, looked at: impacts, spectra, first crossings, bursts, reliability."""
