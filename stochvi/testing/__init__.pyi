from stochvi.verification.testing import *  # noqa: F403

from . import samples as samples
