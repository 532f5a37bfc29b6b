"""The judge of other people's integrators; `stochvi.testing` holds its public names.

Nothing is imported here, so that the plugin for pytest costs nothing before it is used.
"""
