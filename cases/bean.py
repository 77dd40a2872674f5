"""Bean: a point falls inside a disc with a bite taken out of it, over the bite or into the corner beside it.

    x' = (0, -1) + w J x + lam1 grad g1 + lam2 grad g2,   w = 0.3,   J = [[0, -1], [1, 0]]
    g1 = 2 - |x| >= 0 (inside the disc),   g2 = |x - c| - 1 >= 0 (outside the bite),   c = (-1, -1)

In complex numbers z' = i w (z - q), q = 1/w: free motion circles about q. On an arc z = m + R e^{ip} with
m - q = D e^{ia}, theta = p - a obeys theta' = w (1 + beta cos theta), beta = D/R > 1, and the force presses outwards
with w D sin theta: lam1 = w D sin theta on the rim, lam2 = -w D sin theta on the bite. So the impulse is
-/+ R ln((1 + beta cos theta) / (1 + beta cos theta_0)) on rim and bite. With kappa^2 = (beta + 1) / (beta - 1) and
s^2 = beta^2 - 1, v = tan(theta/2) / kappa solves v' = (w s/2) (1 - v^2): v = (v0 + T) / (1 + v0 T), T = tanh(w s t/2).

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


def falling(z, t):
    """Free motion from z."""
    return Q + (z - Q) * np.exp(1j * W * t)


def landing(z, middle, radius):
    """Time at which free motion from z first meets the circle: |q - m + (z - q) e^{iwt}| = radius."""
    arm, far = z - Q, Q - middle
    cos = (radius**2 - abs(arm) ** 2 - abs(far) ** 2) / (2.0 * abs(arm) * abs(far))
    start = np.angle(arm / far)
    return min(np.mod(np.array([1.0, -1.0]) * np.arccos(cos) - start, 2 * np.pi)) / W


def halves(unit, kappa):
    """v = tan(theta/2) / kappa of e^{i theta}, as a fraction (up, down) that is never 0/0."""
    if unit.real > 0.0:
        return unit.imag, kappa * (1.0 + unit.real)
    return 1.0 - unit.real, kappa * unit.imag


class Arc:
    """Motion along a circle from z on; sign +1 outside the circle, -1 inside."""

    def __init__(self, z, middle, radius, sign):
        away = middle - Q
        self.middle, self.radius, self.sign = middle, radius, sign
        self.turn = away / abs(away)
        beta = abs(away) / radius
        self.kappa = np.sqrt((beta + 1.0) / (beta - 1.0))
        self.rate = 0.5 * W * np.sqrt((beta - 1.0) * (beta + 1.0))
        self.up, self.down = halves((z - middle) / (radius * self.turn), self.kappa)

    def when(self, unit):
        """Time at which e^{i theta} = unit."""
        up, down = halves(unit, self.kappa)
        return np.arctanh((up * self.down - self.up * down) / (down * self.down - up * self.up)) / self.rate

    def at(self, t):
        """Place (complex) and impulse after the time t; 1 + beta cos theta is (1 - v^2) / (1 + kappa^2 v^2) up to a factor."""
        T = np.tanh(self.rate * t)
        up, down = self.kappa * (self.up + self.down * T), self.down + self.up * T
        size = up * up + down * down
        root = down + 1j * up
        fall = np.log((self.down**2 + (self.kappa * self.up) ** 2) / size) - 2.0 * np.log(np.cosh(self.rate * t))
        return self.middle + self.radius * self.turn * root * root / size, self.sign * self.radius * fall


def over(z0):
    """Event times, and (k, 3) from times: place as a complex number, impulses of rim and bite."""
    t1 = landing(z0, CENTRE, BITE)
    bite = Arc(falling(z0, t1), CENTRE, BITE, +1)
    t2 = t1 + bite.when(-1.0 + 0.0j)
    shoulder = bite.at(t2 - t1)[0]
    t3 = t2 + landing(shoulder, 0.0, RIM)
    rim = Arc(falling(shoulder, t3 - t2), 0.0, RIM, -1)

    def motion(t):
        on_bite, by_bite = bite.at(np.clip(t, t1, t2) - t1)
        on_rim, by_rim = rim.at(np.maximum(t, t3) - t3)
        z = np.select([t < t1, t < t2, t < t3], [falling(z0, t), on_bite, falling(shoulder, t - t2)], on_rim)
        return z, by_rim, by_bite
    return (t1, t2, t3), motion


def down(z0):
    """The same for the start on the other side: down the bite into the corner."""
    t1 = landing(z0, CENTRE, BITE)
    bite = Arc(falling(z0, t1), CENTRE, BITE, +1)
    far = abs(CENTRE)
    along = (RIM**2 + far**2 - BITE**2) / (2.0 * far)
    corner = CENTRE / far * (along - 1j * np.sqrt((RIM - along) * (RIM + along)))
    t2 = t1 + bite.when((corner - CENTRE) / (BITE * bite.turn))
    force, out, up = 1j * W * (corner - Q), corner / RIM, (corner - CENTRE) / BITE
    lam = np.linalg.solve([[out.real, -up.real], [out.imag, -up.imag]], [force.real, force.imag])

    def motion(t):
        on_bite, by_bite = bite.at(np.clip(t, t1, t2) - t1)
        z = np.select([t < t1, t < t2], [falling(z0, t), on_bite], corner)
        since = np.maximum(t - t2, 0.0)
        return z, lam[0] * since, by_bite + lam[1] * since
    return (t1, t2), motion


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
