"""Three discs: drawn to the origin from an asymmetric start, so that the contacts come one after the other.

    x_i' = -x_i + sum_j lam_ij (x_i - x_j) / |x_i - x_j|,   g_ij = |x_i - x_j| - 2 >= 0

Discs 0 and 1 meet at t = 0.2906, disc 2 joins them at 0.4227, nearly in line; the three fold up like a hinge, with
multipliers that fall from about 1.75, until the triangle closes at 2.0412. There all three are 2/3 whatever happened
before, so the end is a poor place to compare. No closed form is known for the hinge; the mean is m0 e^-t at all times.

`overlap` starts with the third disc inside both others, as in the pictures of one sweep at a large step:
"project" begins at the nearest feasible point, "keep" leaves the overlap to the method.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

APART = np.array([2.6, 0.5, 0.1, -0.45, -3.1, -0.1])
OVERLAPPING = np.array([-1.1, 0.0, 1.1, 0.1, 0.1, 1.2])
SUITES = {"standard": [{}], "full": [{"overlap": "project"}, {"overlap": "keep"}]}


def drift(xp):
    def f(t, x):
        return -x
    return f


def make(overlap: str = "none") -> Case:
    """overlap: "none", or what the overlapping start means: "project" or "keep"."""
    if overlap not in ("none", "project", "keep"):
        raise ValueError(f"overlap is {overlap!r}; one of none, project, keep")
    return Case(
        name="three_discs",
        problem=Complementarity(drift, (Distance(d=2.0),)),
        x0=APART if overlap == "none" else OVERLAPPING,
        t=np.linspace(0.0, 3.0, 61),
        start="error" if overlap == "none" else overlap,
        substeps=8, also=("pbd[order=reverse]",), radius=1.0,
        tags=("seed",) if overlap == "none" else ("seed", "infeasible_start"),
    )
