"""A compiled drift that raises when it is called is none: the loop runs in Python."""

import numpy as np
import pytest

from nsbench import Case, Complementarity, Distance, solve


def walk(xp):
    def f(t, x):
        p = x.reshape(2, 2)
        return xp.stack((1.0 - p[:, 0], -p[:, 1])).T.reshape(4)  # numba: not of a transposed array

    return f


@pytest.mark.parametrize("method", ["pbd", "catching_up"])
def test_a_drift_that_raises_in_compiled_code_runs_in_python(method):
    case = Case(
        name="walk",
        problem=Complementarity(walk, (Distance(d=0.5),)),
        x0=np.array([-1.0, 0.2, -1.0, -0.2 - 0.2]),
        t=np.linspace(0.0, 2.0, 9),
    )
    traj = solve(case, method, h=0.01)
    assert traj.status.ok and traj.stats["loop"] == "host"
    assert "compiled, it raises NotImplementedError" in traj.stats["note"]
