"""One way of sampling: blocks of paths, workers, accuracy, budget, checkpoint and progress.

A sampler (`calculations.Sampler`) says how a block of paths is simulated and what is added up of
it; `run.Run.until` adds blocks until there are enough. This package knows no method and no model.
"""
