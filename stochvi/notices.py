"""Categories of the warnings that the package gives beside its answers.

`warnings.filterwarnings("ignore", category=stochvi.StochviWarning)` silences all of them, and
"error" makes errors of them; a category does so for one kind. Every room may import this file.
"""

from __future__ import annotations


class StochviWarning(UserWarning):
    """Base of every warning that this package gives.

    See Also
    --------
    stochvi.StochviError : The base of all errors of the package.
    """


class OutputWarning(StochviWarning):
    """A picture, a file or a row of a table was not written; the answer was kept.

    See Also
    --------
    stochvi.StochviWarning : The base of all warnings of the package.
    """


class InputWarning(StochviWarning):
    """What was read is doubtful, or damaged and read again from elsewhere.

    See Also
    --------
    stochvi.StochviWarning : The base of all warnings of the package.
    """


class PartWarning(StochviWarning):
    """A part of another package was left out.

    See Also
    --------
    stochvi.StochviWarning : The base of all warnings of the package.
    """


class KernelWarning(StochviWarning):
    """Kernels run in a way that takes longer than usual.

    See Also
    --------
    stochvi.StochviWarning : The base of all warnings of the package.
    """
