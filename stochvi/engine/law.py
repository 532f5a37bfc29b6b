"""What a kernel asks of the law of a stop.

A law is a class of named tuples of numbers, for forces per unit mass. It has one of two functions:

    rebound(law, w, uniform)     rigid: speed after an impact at the speed w
    force(law, y, v)            compliant: force at the deflection y and its rate v

The other functions say how a contact is followed; they have bodies that serve most laws.

A law is known to a kernel by the numbers of its stop, a row of a table, from which `read` makes it.
`compiled_laws` compiles the functions of a class on their own, so that a kernel serves all laws.
"""

from __future__ import annotations

import math

from stochvi.engine.parts import generic

MOST_NUMBERS = 4
"""Largest number of numbers of a law that are kept beside a lane. A law with more reads the table,
whose row is kept as well."""


@generic
def rebound(law, w, uniform):
    """Speed after an impact at the speed w, m/s; `uniform` is a uniform number of that impact."""


@generic
def mean_rebound(law, w):
    """Mean speed after impacts at the speed w, m/s."""


@generic
def force(law, y, v):
    """Force of a stop that pushes, m/s^2, at the deflection y > 0 (m) and its rate v (m/s)."""


@generic
def margin(law, y, v):
    """Deflection, m, that is left until the stop no longer pushes; linear in y and v."""


@generic
def rate(law, y, v, push):
    """Largest rate (rad/s) in a contact that is at y and v, with the acceleration `push` onto the
    stop: that of its oscillation or of its damping."""


@generic
def energy(law, y):
    """Energy that a stop without losses holds at the deflection y, m^2/s^2; nan where nobody has
    said."""


@generic
def is_rigid(law):
    """Whether the stop is rigid."""


@generic
def is_lossy(law):
    """Whether a contact takes energy."""


@generic
def is_smooth(law):
    """Whether the force has derivatives where the contact begins."""


@generic
def read(law, numbers, row):
    """The law of this class whose numbers are a row of a table."""


@generic
def read_lane(law, lanes, lane, numbers):
    """The law of this class of a lane, from its numbers or from the table.

    `lanes` (lanes, MOST_NUMBERS + 1) holds the first numbers of each lane, and its row of the table
    `numbers`.
    """


@read_lane.of(object)
def _(law, lanes, lane, numbers):
    return read(law, lanes, lane)


@margin.of(object)
def _(law, y, v):
    return y


@rebound.of(object)
def _(law, w, uniform):
    return 0.0


@mean_rebound.of(object)
def _(law, w):
    return rebound(law, w, 0.5)


@force.of(object)
def _(law, y, v):
    return 0.0


@rate.of(object)
def _(law, y, v, push):
    return 0.0


@energy.of(object)
def _(law, y):
    return math.nan


@is_rigid.of(object)
def _(law):
    return False


@is_lossy.of(object)
def _(law):
    return False


@is_smooth.of(object)
def _(law):
    return True
