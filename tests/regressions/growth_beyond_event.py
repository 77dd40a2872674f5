"""A step that grew by 1e17 behind an event made everything before the event rounding."""

import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([1.215 * t, -0.891 + 1.916 * xp.sin(3.478 * t + 0.532) + 1.668 * t])

    return f


def q(xp):
    def f(t):
        return xp.array([0.79 * xp.sin(3.219 * t), 0.46332 - 0.129 * xp.sin(3.355 * t)])

    return f


A = [[-2.0, -0.602], [0.003, -1.958]]
B = [[-0.5, 1.0], [0.856, 0.642]]
C = [[-0.153, -0.598], [0.52, -0.58]]
D = [[0.010162, -0.000604], [-0.000604, 0.056746]]
CASE = Case(
    name="scene",
    problem=LCS(np.array(A), np.array(B), np.array(C), np.array(D), u=u, q=q),
    x0=np.array([0.894, 0.79]),
    t=np.linspace(0.0, 1.0, 11),
)

BY = ("event_driven", "event_driven[method=lsoda,max_steps=1500]")
