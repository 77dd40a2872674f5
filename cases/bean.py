"""Bean: a point falls inside a disc with a bite taken out of it, over the bite or into the corner beside it.

    x' = (0, -1) + w J x + lam1 grad g1 + lam2 grad g2,   w = 0.3,   J = [[0, -1], [1, 0]]
    g1 = 2 - |x| >= 0 (inside the disc),   g2 = |x - c| - 1 >= 0 (outside the bite),   c = (-1, -1)

In complex numbers z' = i w (z - q), q = 1/w: free motion circles about q. On an arc z = m + R e^{ip} with
m - q = D e^{ia}, theta = p - a obeys theta' = w (1 + beta cos theta), beta = D/R > 1, and the force presses outwards
with w D sin theta: lam1 = w D sin theta on the rim, lam2 = -w D sin theta on the bite. So the impulse is
-/+ R ln((1 + beta cos theta) / (1 + beta cos theta_0)) on rim and bite. With kappa^2 = (beta + 1) / (beta - 1) and
s^2 = beta^2 - 1, v = tan(theta/2) / kappa solves v' = (w s/2) (1 - v^2): v is tanh or coth of xi = xi_0 + w s t/2.

side = "right": the point lands on the bite, is carried over its shoulder, leaves it tangentially where theta = -pi
(lam2 = 0), falls onto the rim and creeps to its rest at cos theta = -1/beta. side = "left": it slides down the bite
until it meets the rim as well, and rests in that corner with constant multipliers, both positive.

What it is for: a set that is not convex, with a re-entrant arc and corners between the arcs: prox-regular, with a
metrically calm intersection, which is all that the theory of projections in turn asks for.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

W, RIM, BITE, CENTRE = 0.3, 2.0, 1.0, -1.0 - 1.0j
Q = 1.0 / W
STARTS = {"right": -0.6 + 1.2j, "left": -0.9 + 1.3j}
SUITES = {"standard": [{}], "full": [{"side": "left"}]}


# Zeros of |z - m| = R along free motion, and xi there, with 40 digits: computed in float64 they cost the left side, which
# starts near an unstable rest, two digits.
HIT, HIT_XI, LAND, LAND_XI = 1.007110591454036315795, -1.068871650213896156908, 3.888581986585556467815, 0.758310070211060317640
LEFT_HIT, LEFT_XI, CORNER_AT = 0.9965638086754796638629, -1.514309597892674333562, 2.902957499257168729538
CORNER = -1.911437827766147647625 - 0.5885621722338523523746j


def falling(z, t):
    """Free motion from z."""
    return Q + (z - Q) * np.exp(1j * W * t)


class Arc:
    """Motion along a circle that begins at xi; sign +1 outside the circle, -1 inside."""

    def __init__(self, middle, radius, sign, xi, coth=False):
        away = middle - Q
        beta = abs(away) / radius
        self.middle, self.arm, self.weight, self.xi, self.coth = middle, radius * away / abs(away), sign * radius, xi, coth
        self.kappa = np.sqrt((beta + 1.0) / (beta - 1.0))
        self.rate = 0.5 * W * np.sqrt((beta - 1.0) * (beta + 1.0))

    def root(self, xi):
        """e^{i theta/2} up to a factor: down + i kappa up, where v = up/down."""
        up, down = (np.cosh(xi), np.sinh(xi)) if self.coth else (np.sinh(xi), np.cosh(xi))
        return down + 1j * self.kappa * up

    def at(self, t):
        """Place (complex) and impulse after the time t; 1 + beta cos theta is 1 / |root|^2 up to a factor."""
        root, first = self.root(self.xi + self.rate * t), self.root(self.xi)
        return self.middle + self.arm * root / np.conj(root), 2.0 * self.weight * np.log(np.abs(first) / np.abs(root))


def over(z0):
    """Event times, and (place as a complex number, impulses of rim and bite) of times."""
    bite, rim = Arc(CENTRE, BITE, +1, HIT_XI, coth=True), Arc(0.0, RIM, -1, LAND_XI)
    leave = HIT - HIT_XI / bite.rate                    # theta = -pi at xi = 0
    shoulder = CENTRE - bite.arm

    def motion(t):
        on_bite, by_bite = bite.at(np.clip(t, HIT, leave) - HIT)
        on_rim, by_rim = rim.at(np.maximum(t, LAND) - LAND)
        z = np.select([t < HIT, t < leave, t < LAND], [falling(z0, t), on_bite, falling(shoulder, t - leave)], on_rim)
        return z, by_rim, by_bite
    return (HIT, leave, LAND), motion


def down(z0):
    """The same for the start on the other side: down the bite into the corner."""
    bite = Arc(CENTRE, BITE, +1, LEFT_XI)
    force, out, up = 1j * W * (CORNER - Q), CORNER / RIM, (CORNER - CENTRE) / BITE
    lam = np.linalg.solve([[out.real, -up.real], [out.imag, -up.imag]], [force.real, force.imag])

    def motion(t):
        on_bite, by_bite = bite.at(np.clip(t, LEFT_HIT, CORNER_AT) - LEFT_HIT)
        z = np.select([t < LEFT_HIT, t < CORNER_AT], [falling(z0, t), on_bite], CORNER)
        since = np.maximum(t - CORNER_AT, 0.0)
        return z, lam[0] * since, by_bite + lam[1] * since
    return (LEFT_HIT, CORNER_AT), motion


DOWN, TURN = np.array([0.0, -1.0]), W * np.array([-1.0, 1.0])


def drift(xp):
    def f(t, x):
        return DOWN + TURN * x[::-1]
    return f


def make(side: str = "right") -> Case:
    """side: of the bite on which the point comes down, "right" or "left"."""
    if side not in STARTS:
        raise ValueError(f"side is {side!r}; one of {', '.join(STARTS)}")
    z0 = STARTS[side]
    events, motion = (over if side == "right" else down)(z0)

    def exact(t):
        z = motion(t)[0]
        return np.stack((z.real, z.imag), axis=1)

    def exact_impulse(t):
        return np.stack(motion(t)[1:], axis=1)

    rim = Distance(d=RIM, sign=-1, pairs=[[0, 0]], anchors=np.zeros((1, 2)))
    bite = Distance(d=BITE, sign=+1, pairs=[[0, 0]], anchors=np.array([[CENTRE.real, CENTRE.imag]]))
    return Case(
        name="bean",
        problem=Complementarity(drift, (rim, bite)),
        x0=np.array([z0.real, z0.imag]),
        t=np.linspace(0.0, 8.0, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=events, contacts=((0, 0, 0), (1, 0, 0)),
        substeps=8, also=("pbd[order=reverse]",),
    )
