"""Laws of stops: each a class of numbers with its functions, in a file of its own.

A kernel is compiled for a set of classes. `FEW` and `MANY` are the sets in which the laws of the
package are compiled together, so that scenes share kernels; a law that is in neither is compiled
beside `MANY`.
"""

from stochvi.engine.laws.force_table import ForceTable
from stochvi.engine.laws.hertz import Hertz
from stochvi.engine.laws.restitution import Restitution
from stochvi.engine.laws.viscoelastic import Viscoelastic

FEW = (Restitution(1.0), Viscoelastic(1.0, 0.0))
MANY = (*FEW, Hertz(1.0), ForceTable.of([[0.0, 0.0, 1.0]]))
