"""Statistical linearisation: stops replaced by a spring and a damper that do the same on average.

The stop force in x'' + b x' + omega^2 x = f + g + stop force is replaced by

    -(m_F + k (x - m) + beta x'),        m = E x.                              (B 13.3, 13.4)

The linear system x'' + (b + beta) x' + (omega^2 + k)(x - m) = f is solved exactly, for white or
tabulated noise. m_F, k and beta follow from the response that they are to produce. Four forms of
that last step:

* "closure": x has the density C exp(lambda x - kappa x^2 / 2) between the stops and x' is
  Gaussian; both obey the balances of force, virial and energy. Exact for elastic stops and
  white noise.
* "motion": x has a normal distribution truncated at the stops (B 8.58-8.77, 13.12-13.20).
* "force": the force of spring and stops together is Gaussian, and x follows from it through
  the inverse characteristic (B 8.79-8.87, 13.24-13.33).
* "clumps": the closure corrected by the distribution of a slowly varying energy, where light
damping lets impacts come in clusters. Between two stops it is the closure with the impacts of a box
(variant "box").

`linearise_many` is the closure for arrays; the errors that `linearise` states are in
`model/build_response.py`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
