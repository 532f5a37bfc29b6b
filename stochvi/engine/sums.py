"""Rows of the sums over the impacts and contacts of a pair; per unit of its reduced mass."""

ROWS_OF_PAIR = 6
"""Rows of the impacts of a pair: N, F1 and F2 at the lower stop, then at the upper stop."""

IMPULSE, LOSS, PEAK, TIME, ENDED = range(5)
ROWS_OF_STOP = 5
"""Rows of the contacts with one compliant stop: impulse, dissipated energy, sum of the peak
forces of ended contacts, duration, and number of ended contacts."""

ROWS_OF_CONTACT_PAIR = ROWS_OF_PAIR + 2 * ROWS_OF_STOP
"""Rows of a pair with compliant stops: those of impacts, then those of the contacts with the
lower stop, and with the upper stop."""

PLACE, SPEED, LEFT = range(4, 7)
FOUND = 7
"""Rows of a contact of one mass that was followed: IMPULSE, LOSS (with what the stop holds at the
end), PEAK and TIME; deflection and rate at the end; and the time that is left, s. A contact that
ended has the deflection 0."""
