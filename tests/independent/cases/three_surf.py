"""Three surfaces with a coupled drift."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array(
            [
                -1.0 * s[0] + 0.3 * x[1] + 0.5 * xp.sin(t),
                -1.2 * s[1] - 0.4 * x[2] + 1.6 * xp.cos(1.1 * t),
                -0.8 * s[2] + 0.2 * s[0] + 0.9 * xp.sin(0.7 * t),
            ]
        )
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0], x[1], x[2] - 0.3 * x[0]])
    return f


CASE = Case(name="three_surf", problem=Filippov.signs(drift, switch), x0=np.array([0.7, 0.5, -0.6]), t=np.linspace(0.0, 10.0, 51))
