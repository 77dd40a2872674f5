"""Two cells that push each other: hard discs run head-on into one another and stay there.

    x_1' = (v, 0) + lam n,   x_2' = (-v, 0) - lam n,   g = |x_1 - x_2| - 2 r >= 0,   n = (x_1 - x_2) / |x_1 - x_2|

Scene: the unit test "Mechanics, two cells pushing each other" of the PerMedCoE community benchmark of cell-based tools
(github.com/PerMedCoE/observatory_benchmark, README, Appendix 1): cells of size 10 um, centres 30 um apart, each driven
towards the other with 10 um/min, mechanical step 0.1 min, 10 min. The force between the cells is left to the tools
there (Hertz, JKR, linear, ...), so that no answer is stated; read as hard contact the scene has one. Lengths here in
micrometres, times in minutes.

Exact: the gap closes at 2 v, x = (-+ (distance / 2 - v t), 0) up to t = (distance - 2 r) / (2 v) = 1; from then on
the cells rest 2 r = 10 apart, and lam = v. Euler is exact for a constant drift, and the published step ends at t = 1, so
PBD makes no error at all: the scene tells force laws apart, not methods. `distance` moves the contact off the steps.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"full": [{}]}


def make(distance: float = 30.0, radius: float = 5.0, speed: float = 10.0) -> Case:
    """distance: of the centres at the start, at least 2 radius; speed: of either cell."""
    if not (radius > 0.0 and speed > 0.0 and distance >= 2.0 * radius):
        raise ValueError(f"distance is {distance!r}, radius {radius!r}, speed {speed!r}: radius and speed are positive, and "
                         f"the distance is at least 2 radius")
    push = np.array([speed, 0.0, -speed, 0.0])
    meet = (distance - 2.0 * radius) / (2.0 * speed)
    side = np.array([-1.0, 0.0, 1.0, 0.0])

    def drift(xp):
        def f(t, x):
            return push + 0.0 * x
        return f

    def exact(t):
        return np.maximum(0.5 * distance - speed * t, radius)[:, None] * side

    def exact_impulse(t):
        return speed * np.maximum(t - meet, 0.0)[:, None]

    return Case(
        name="two_cells",
        problem=Complementarity(drift, (Distance(d=2.0 * radius),)),
        x0=0.5 * distance * side,
        t=np.linspace(0.0, 10.0, 101),
        exact=exact, exact_impulse=exact_impulse, exact_events=(meet,), contacts=((0, 0, 1),),
        substeps=1, radius=radius, tags=("constant_force", "published"),
    )
