"""Periodic regimes of oscillators with stops."""
