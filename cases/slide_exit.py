"""Sliding with an exit: a point is caught by a line, dragged along it with a moving weight, and let go.

    x' = (1 + x2, -1 - sin(x1)/2)   for x2 > 0
    x' = (2 + x1^2/4, 1 - x1)       for x2 < 0,      x(0) = (-1/2, 1/2)

The fields vary, so this is the case that ranks methods on one surface. The point enters the line at ENTER and
leaves it where the lower field turns away, at x1 = 1, with a vanishing weight and therefore tangentially.
ENTER, LEAVE, END and WEIGHT were computed with 40 digits by Taylor series for the two free arcs and by quadrature
of dx1/v(x1) along the line.
"""
import numpy as np

from nsbench import Case, Filippov

ENTER, LEAVE = 0.53625460434312500, 0.98470044921025719
END = np.array([2.4027731870276790, -0.33571792268777756])     # x(3/2)
WEIGHT = 0.64683907361142525                                   # integral of the weight up to 3/2


def above(xp):
    def f(t, x):
        return xp.array([1.0 + x[1], -1.0 - 0.5 * xp.sin(x[0])])
    return f


def below(xp):
    def f(t, x):
        return xp.array([2.0 + 0.25 * x[0] * x[0], 1.0 - x[0]])
    return f


def height(xp):
    def c(t, x):
        return x[1:2]
    return c


CASE = Case(
    name="slide_exit",
    problem=Filippov({(+1,): above, (-1,): below}, height),
    x0=np.array([-0.5, 0.5]),
    t=np.linspace(0.0, 1.5, 31),
    exact_events=(ENTER, LEAVE),
)
