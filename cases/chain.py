"""Chain: beads on links of maximal length 1 are pulled straight, or hang between two hooks.

    x_i' = f_i + tensions,   g_i = 1 - |x_i - x_{i-1}| >= 0,   x_0 the hook at the origin

**Pulled** (links k, slack s): the beads start on a line, 1 - s apart. With pull = "all" every bead feels the force
a(t) = 1 + growth t along the line. Exact, in the clock c(t) = t + growth t^2 / 2: all beads travel at speed 1;
bead i has only i s to go and is stopped at c = i s (arrival times in arithmetic progression); link i carries the
m - i + 1 stopped beads i .. m beyond it. With pull = "last" only the last bead is pulled; j beads move together at
speed 1/j, so link after link comes taut from the end after s, 2s, 3s, ... more of c; link j from the moving end
carries (m - j)/m, and 1 once the chain is straight. Both are piecewise linear in c. With zigzag > 0 every other
bead starts that far off the line: no closed form.

**Hanging** (30 beads, 31 links, two hooks): gravity (0, -1) on each bead. The discrete catenary: link i carries
the horizontal tension H and the weight V_i = n/2 - i, so its multiplier is the tension sqrt(H^2 + V_i^2) and its
direction (H, -V_i); H follows from the span, sum_i H / sqrt(H^2 + V_i^2) = span. Started there it rests, exactly.
With hanging = "fall" it starts on the straight line between the hooks, all links slack, and falls into the
catenary: no closed form, but the same limit.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SPAN = 0.6                                              # distance of the hooks as part of the length of the chain
SUITES = {"smoke": [{}], "standard": [{}, {"pull": "last"}, {"hanging": "rest"}],
          "full": [{"growth": 1.0}, {"zigzag": 0.3}, {"hanging": "fall"}, {"links": 10}]}


def make(links: int = 5, slack: float = 0.2, pull: str = "all", growth: float = 0.0, zigzag: float = 0.0,
         hanging: str = "no", n: int = 30) -> Case:
    """See the module; hanging: "no", "rest" or "fall" (then only n counts, the number of beads)."""
    for name, value, known in (("pull", pull, ("all", "last")), ("hanging", hanging, ("no", "rest", "fall"))):
        if value not in known:
            raise ValueError(f"{name} is {value!r}; one of {', '.join(known)}")
    if hanging != "no":
        return hang(n, hanging)
    if not (links >= 1 and 0 < slack < 1 and growth >= 0 and 0 <= zigzag):
        raise ValueError(f"links={links}, slack={slack}, growth={growth}, zigzag={zigzag}: links >= 1, slack in (0, 1)"
                         " and no negative numbers are needed")
    if (1 - slack) ** 2 + (2 * zigzag) ** 2 > 1:
        raise ValueError(f"zigzag is {zigzag!r}; with slack {slack} at most {0.5 * (1 - (1 - slack) ** 2) ** 0.5:g}")
    return pulled(links, slack, pull, growth, zigzag)


def beads(count, hooks, ends):
    """Links from bead to bead after the links from beads to hooks."""
    inner = np.stack((np.arange(count - 1), np.arange(1, count)), axis=1)
    anchored = Distance(d=1.0, sign=-1, anchors=hooks, pairs=ends)
    return (anchored, Distance(d=1.0, sign=-1, pairs=inner)) if count > 1 else (anchored,)


def pulled(links, slack, pull, growth, zigzag):
    i = np.arange(1, links + 1)
    x0 = np.stack((i * (1 - slack), np.where(i % 2, zigzag, -zigzag)), axis=1).ravel()
    force = np.zeros(2 * links)
    force[0 if pull == "all" else -2::2] = 1.0
    knots, places, tensions = (arrivals if pull == "all" else towed)(links, slack)
    knots = np.append(knots, knots[-1] + 100.0)         # at rest ever after
    places = np.vstack((places, places[-1:]))
    impulses = np.vstack((np.zeros(links), np.cumsum(np.diff(knots)[:, None] * tensions, axis=0)))

    def clock(t):
        return t + 0.5 * growth * t * t

    def drift(xp):
        def f(t, x):
            return force * (1.0 + growth * t)
        return f

    def exact(t):
        x = np.zeros((len(t), 2 * links))
        x[:, ::2] = np.stack([np.interp(clock(t), knots, p) for p in places.T], axis=1)
        return x

    def exact_impulse(t):
        return np.stack([np.interp(clock(t), knots, p) for p in impulses.T], axis=1)

    known = zigzag == 0.0
    events = knots[1:-1]
    if growth:
        events = (np.sqrt(1 + 2 * growth * events) - 1) / growth
    spacing = events[-1] * 1.5 / 24                     # half as long again as the last arrival
    return Case(
        name="chain",
        problem=Complementarity(drift, beads(links, np.zeros((1, 2)), [[0, 0]])),
        x0=x0,
        t=np.linspace(0.0, 24 * spacing, 25),
        exact=exact if known else None, exact_impulse=exact_impulse if known else None,
        exact_events=tuple(events) if known else None,
        contacts=((0, 0, 0), *((1, j - 1, j) for j in range(1, links))),
        substeps=16, also=("pbd[order=reverse]",), radius=0.1,
        tags=("seed",) if growth or zigzag else ("seed", "constant_force"),
    )


def arrivals(links, slack):
    """Times at which beads stop, their places then, and the tensions (links, links) from there on (row 0 before)."""
    i = np.arange(1, links + 1)
    knots = slack * np.arange(links + 1)
    places = np.minimum(i * (1 - slack) + knots[:, None], i)
    stopped = np.arange(links + 1)[:, None]
    return knots, places, np.maximum(stopped - i + 1, 0.0)


def towed(links, slack):
    """The same for a chain pulled at its end: m beads move together from knot m - 1 to knot m."""
    i = np.arange(1, links + 1)
    m = np.arange(1, links + 1)[:, None]
    knots = slack * np.concatenate(([0.0], np.cumsum(np.arange(1.0, links + 1))))
    moved = np.vstack((np.zeros(links), np.cumsum(slack * (i > links - m), axis=0)))
    # the last bead is pulled by 1, each of the m moving ones needs 1/m to go along: link i pulls those before it
    behind = np.maximum(m - (links + 1 - i), 0.0) / m
    return knots, i * (1 - slack) + moved, np.vstack((behind, np.ones(links)))


def catenary(n):
    """Places of the beads (n, 2) and tensions (n + 1,) of the hanging chain between (0, 0) and (SPAN (n + 1), 0)."""
    V, span = 0.5 * n - np.arange(n + 1.0), SPAN * (n + 1)
    low, high = 0.0, 10.0 * n                           # the span grows with H
    for _ in range(200):
        H = 0.5 * (low + high)
        low, high = (H, high) if np.sum(H / np.hypot(H, V)) < span else (low, H)
    tension = np.hypot(H, V)
    places = np.cumsum(np.stack((H / tension, -V / tension), axis=1), axis=0)
    return places[:-1], tension


def hang(n, hanging):
    if n < 2:
        raise ValueError(f"n is {n!r}; at least 2 beads")
    places, tension = catenary(n)
    hooks = np.array([[0.0, 0.0], [SPAN * (n + 1), 0.0]])
    level = np.stack((SPAN * np.arange(1.0, n + 1), np.zeros(n)), axis=1)
    rest = hanging == "rest"
    x0 = (places if rest else level).ravel()
    weight = np.tile([0.0, -1.0], n)
    order = np.concatenate(([0, n], np.arange(1, n)))   # links to the hooks first, as the families state them

    def drift(xp):
        def f(t, x):
            return weight + 0.0 * x
        return f

    def exact(t):
        return np.tile(x0, (len(t), 1))

    def exact_impulse(t):
        return t[:, None] * tension[order]

    return Case(
        name="chain",
        problem=Complementarity(drift, beads(n, hooks, [[0, 0], [n - 1, 1]])),
        x0=x0,
        t=np.linspace(0.0, 4.0 if rest else 10.0, 21),
        exact=exact if rest else None, exact_impulse=exact_impulse if rest else None,
        exact_events=() if rest else None,
        contacts=((0, 0, 0), (0, n - 1, 1), *((1, j - 1, j) for j in range(1, n))),
        substeps=16, also=("pbd[order=reverse]",), radius=0.1,
        tags=("seed", "constant_force") if rest else ("seed",),
    )
