"""How a mass that meets stops moves in time: plans and kernels that `simulate`, a replay in steps,
regimes and the splitting of rare events use."""

from stochvi.sampling.workers import leave_out_of_budgets

leave_out_of_budgets()
