"""Rows of the sums over the impacts and contacts of a pair; per unit of its reduced mass."""

ROWS_OF_PAIR = 6
"""Rows of the impacts of a pair: N, F1 and F2 at the lower stop, then at the upper stop."""

IMPULSE, LOSS, PEAK, TIME, ENDED = range(5)
ROWS_OF_STOP = 5
"""Rows of the contacts with one compliant stop: impulse, dissipated energy, sum of the peak
forces of ended contacts, time in which the stop pushes, and number of ended contacts."""

ROWS_OF_CONTACT_PAIR = ROWS_OF_PAIR + 2 * ROWS_OF_STOP
"""Rows of a pair with compliant stops: those of impacts, then those of the contacts with the
lower stop, and with the upper stop."""

FASTEST, SHARPEST, FORCE_SQUARE, POSITION_FORCE = range(4)
EXTREMES = 4
"""Columns of the extremes of a path: largest impact speed, largest absolute acceleration
|b x' + w0^2 x + F|, and the integrals of F^2 and of x F over time."""

PLACE, SPEED, LEFT, EXTREME = range(4, 8)
FOUND = EXTREME + EXTREMES
"""Rows of a contact of one mass that was followed: IMPULSE, LOSS (with what the stop holds at the
end), PEAK and TIME; deflection and rate at the end; and the time that is left, s. A contact that
ended has the deflection 0. From EXTREME on stand the extremes, which go on from contact to contact.
But for the speed they are those of a mass that is shaken."""
