"""Teaser: 42 discs in a box are drawn to its centre until they are packed.

    x_i' = -kappa (x_i - c) + contact and wall forces,   g_ij = |x_i - x_j| - 2 R >= 0,   R <= x_i <= L - R,
    kappa = 0.0125 alpha

Scene: numbers of discs, radius, box, attraction, step and time as in an interactive demonstration of position-based
dynamics by the author of the talk that this bench follows (2026): 42 discs of radius 6 in a box of side 100, alpha = 8,
dt = 0.1, T = 12. There the error is measured against PBD itself with dt = 0.001. The starting positions are not those of
the demonstration: they are drawn here, uniformly, one disc after the other, where there is room.

No closed form. The walls never act, as every disc is drawn inwards. The discs close up to a cluster with more contacts
(98 act at some time, seed 0) than coordinates (84), so only the reaction of the contacts is unique. 212 events.

What it is for: what a reference of the same method hides. What two runs of one method share cancels in their
difference; the study `budget` compares the error against PBD with dt = 0.001 with the true one.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance

SUITES = {"full": [{}]}
TRIES = 100_000                       # places that are drawn for all discs together


def scatter(n, radius, box, rng):
    """Centres (n, 2) inside the box, no two of them closer than 2 radius."""
    x = np.zeros((0, 2))
    for _ in range(TRIES):
        if len(x) == n:
            return x
        place = rng.uniform(radius, box - radius, 2)
        if not len(x) or np.hypot(*(x - place).T).min() > 2.0 * radius:
            x = np.vstack((x, place))
    raise ValueError(f"{n} discs of radius {radius:g} find no place in a box of side {box:g}; {len(x)} do")


def make(n: int = 42, alpha: float = 8.0, seed: int = 0, radius: float = 6.0, box: float = 100.0) -> Case:
    """n discs; alpha: strength of the attraction; seed: of the start."""
    if not (1 <= n <= 1000 and alpha > 0.0 and 0.0 < 2.0 * radius <= box):
        raise ValueError(f"n is {n!r}, alpha {alpha!r}, radius {radius!r}, box {box!r}: 1 to 1000 discs that are smaller than "
                         f"the box, and a positive attraction")
    x0 = scatter(n, radius, box, np.random.default_rng(seed)).ravel()
    kappa = 0.0125 * alpha
    centre = np.full(2 * n, 0.5 * box)

    def drift(xp):
        def f(t, x):
            return kappa * (centre - x)
        return f

    one = np.eye(2 * n)
    walls = Affine(np.vstack((one, -one)), np.repeat([-radius, box - radius], 2 * n))
    return Case(
        name="teaser",
        problem=Complementarity(drift, (Distance(d=2.0 * radius), walls)),
        x0=x0,
        t=np.linspace(0.0, 12.0, 25),
        substeps=5, also=("pbd[order=reverse]",), radius=radius, tags=("published",),
    )
