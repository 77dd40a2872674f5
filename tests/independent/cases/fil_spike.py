"""A spike of width 1e-2 tears the state off its surface."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([3.0 * xp.exp(-(((t - 4.2137) / 0.01) ** 2))])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0]])
    return f


CASE = Case(
    name="fil_spike", problem=Filippov.relay(drift, np.array([[-1.0]]), switch), x0=np.array([0.5]), t=np.linspace(0.0, 8.0, 9)
)
