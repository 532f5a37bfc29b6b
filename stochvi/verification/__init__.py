"""Agreement of the methods, the cost of accuracy, and the judging of other integrators."""
