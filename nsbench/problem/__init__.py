"""The four problem classes and the families of constraints, as frozen data.

Complementarity (gradient) system of first order::

    x' = f(t, x) + sum_k lambda_k grad g_k(t, x),    0 <= g_k  _|_  lambda_k >= 0

Filippov system: ``x'`` in the convex hull of the fields that meet at x. Linear
complementarity system: ``x' = A x + B lambda + u(t)``, ``w = C x + D lambda + q(t)``,
``0 <= w _|_ lambda >= 0``. Hybrid system: modes with a drift each, and transitions between them
that may reset the state.

Physics is written once: a *factory* takes an array namespace and returns the function,
``drift(xp) -> f(t, x)``. Data is checked here, at the border; nothing below checks it again.
"""

from nsbench.problem.constraints import Affine, Distance, Factory, Smooth, float_array
from nsbench.problem.hybrid import Hybrid, Transition
from nsbench.problem.systems import LCS, Complementarity, Filippov

Problem = Complementarity | Filippov | LCS | Hybrid

__all__ = [
    "LCS",
    "Affine",
    "Complementarity",
    "Distance",
    "Factory",
    "Filippov",
    "Hybrid",
    "Problem",
    "Smooth",
    "Transition",
    "float_array",
]
