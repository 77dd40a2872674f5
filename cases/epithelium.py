"""Epithelium: a row of cells, each an apical point A, a nucleus X and a basal point B.

    mu (A, X, B)' = forces,   eta_A' = -5 (eta_A - max(0, |X-A| - R_s)),   eta_B likewise,   rho' = -rho
    |X_i - X_j| >= 2 r_hard,  (B_{i+1} - B_i)_x >= 0,  |B_{i+1} - B_i| <= 1/3,  B on the line y = 0

Forces: springs k (d/l - 1)^2 along X-A and X-B with l = eta + R_s; straightness k_s cos(angle at X between
X - A and X - B); repulsion of nuclei closer than 2 R_s; springs between neighbouring apical points with the
shrinking rest length rho (apical constriction). Lengths in cell diameters (5 micrometres), times in hours.
Equations and default values as in the open code of its authors (sEMTor.jl; Nature Communications 2024,
doi 10.1038/s41467-024-51372-z), except that the rest lengths follow their equations continuously instead of by
an exponential once per 0.05. mu rubs the points alone: the rest lengths have rates of their own.

State: A (2n), X (2n), B, eta_A (n), eta_B (n), rho (1; all links share it). The families are in the authors' order
of the sweep: nuclei, order, links. The line is built into the state: B holds n positions s along it, so order and
links are affine. curvature bends the line into a circle about (0, -1/curvature): s is then the arc length (the metric,
and so the projection, is that of the plane), and a link |B_{i+1} - B_i| <= 1/3 is the arc it spans. free_basal=True
holds B in the plane (2n), drops the line, and the links become distances: a chain that hangs on the cells alone.

The drift is only C0: max(0, .) of the rest lengths and the reach of the repulsion are kinks, so methods of high order
see their steps refused there. It lists all n x n pairs of nuclei, meant for n of about 100.

What acts (n = 30, PBD at h = 1.25e-3, contacts with an impulse in the 0.05 before the time): the 29 links from
t = 0.15 on, the order never, and of the hard nuclei
    t              0.05  0.1  0.2  0.3  0.5   1   2   6  12  24  48
    r_hard = 0.3      0    0    0    0    0   0   0   0   0   0   0      (seed 1: 3 at 0.05, 1 at 0.1)
    r_hard = 0.7     42   43   34   26   20  10   4   3   3   1   0      (seed 1: 40 37 33 30 22 15 5 3 1 2 1)
so r_hard = 0.3 is a scene of the chain alone, 0.7 one of both. The chain makes the constant of PBD large: with 29 links
at their maximum, up to t = 0.2, PBD is 0.045 (0.13) off the event-driven solution at the authors' step 1.25e-3, most at
the ends of the basal line; from h = 1e-4 on the error falls with h: that limit does solve the system.
Over 48 h, against PBD at a 32nd of that step, positions are off by up to 0.22 (1.04), at an 8th by 0.014 (0.039).
"""
import functools

import numpy as np

from nsbench import Affine, Case, Complementarity, Distance

SPACING, HEIGHT = 1 / 3, 8.0          # between neighbours; of the apical points over the basal ones
R_SOFT = 1.0
K_AXIS, K_STRAIGHT, K_SOFT, K_APICAL = 2.0, 15.0, 1.0, 0.25 * 5.0
ETA_RATE, ETA_START = 5.0, 1.5
SAMPLE, SUBSTEPS = 0.05, 40           # the authors' step, and their steps of PBD in it
ROUNDING = 1e-13                      # of gaps: lengths of about 10 carry rounding of 1e-15
SUITES = {"smoke": [{"n": 3}], "standard": [{}, {"r_hard": 0.7}],
          "full": [{"T": 48.0}, {"r_hard": 0.7, "T": 48.0}, {"free_basal": True}, {"curvature": 0.1}]}


@functools.cache                      # one factory for all seeds, radii and times: it is compiled once
def make_drift(n, mu, free_basal, curvature):
    """Factory of f(t, x); written with slices and broadcasting alone, for numpy, numba and JAX.

    Points are complex numbers inside: half as many expressions, and so half the time to compile them.
    """
    s = 2 if free_basal else 1
    up = 1j if free_basal else 0j
    xs, bs = 2 * n, 4 * n
    es = bs + s * n
    same, all_ones = np.eye(n), np.ones(n, dtype=complex)

    def drift(xp):
        one, ones = xp.asarray(same), xp.asarray(all_ones)

        def f(t, x):
            a, q = x[0:xs:2] + 1j * x[1:xs:2], x[xs:bs:2] + 1j * x[xs + 1:bs:2]
            b = x[bs:es:s] + up * x[bs + s - 1:es:s]
            eta, rho = x[es:es + 2 * n].reshape((2, n)), x[es + 2 * n:]
            tangent = xp.ones_like(b)
            if curvature != 0.0:
                tangent = xp.exp(-1j * curvature * b)
                b = 1j * (tangent - 1.0) / curvature

            # both sides of the cells at once, (2, n): springs and straightness, as they pull on the nucleus
            u = q - xp.stack((a, b))
            d, length = xp.abs(u), eta + R_SOFT
            cosine = (u[0] * xp.conj(u[1])).real / (d[0] * d[1])
            pull = (K_STRAIGHT * (cosine / (d * d) * u - u[::-1] / (d[0] * d[1]))
                    - 2.0 * K_AXIS * (d - length) / (d * length * length) * u)

            # soft repulsion; `one` keeps the distance of a nucleus to itself away from zero
            p = q.reshape((n, 1)) - q
            r = xp.sqrt(p.real * p.real + p.imag * p.imag + one)
            push = K_SOFT / R_SOFT * (xp.minimum(0.5 * r / R_SOFT - 1.0, 0.0) / r * p) @ ones

            # apical springs between neighbours
            g = a[1:] - a[:-1]
            g = K_APICAL * (1.0 - rho / xp.abs(g)) * g
            end = xp.zeros(1) * 1j
            g = xp.concatenate((end, g, end))

            force = xp.concatenate((g[1:] - g[:-1] - pull[0], pull[0] + pull[1] - push, -pull[1] * xp.conj(tangent)))
            force = xp.stack((force.real, force.imag), axis=1) / mu
            rest = xp.concatenate(((-ETA_RATE * (eta - xp.maximum(d - R_SOFT, 0.0))).reshape(2 * n), -rho))
            return xp.concatenate((force[:2 * n].copy().reshape(bs), force[2 * n:, :s].copy().reshape(s * n), rest))
        return f
    return drift


def place(s, height, curvature):
    """Points (.., 2) at arc length s and `height` over the basal line."""
    if curvature == 0.0:
        return np.stack((s, np.broadcast_to(height, np.shape(s))), axis=-1)
    r = 1.0 / curvature + height
    return np.stack((r * np.sin(curvature * s), r * np.cos(curvature * s) - 1.0 / curvature), axis=-1)


def separate(points, d, sweeps=20_000):
    """`points` (n, 2) moved apart by sweeps of exact projections until all are d apart up to rounding.

    ValueError if that takes more than `sweeps`: the start would not be feasible.
    """
    x = points.copy()
    i, j = np.triu_indices(len(x), 1)
    for _ in range(sweeps):
        near = np.hypot(*(x[i] - x[j]).T) < d
        if not near.any():
            return x
        worst = 0.0
        for a, b in zip(i[near], j[near], strict=True):
            u = x[a] - x[b]
            r = np.hypot(u[0], u[1])
            worst = max(worst, d - r)
            if r < d:
                move = 0.5 * (d - r) / r * u
                x[a] += move
                x[b] -= move
        if worst < ROUNDING:
            return x
    raise ValueError(f"{len(x)} nuclei are not {d:g} apart after {sweeps} sweeps")


def make_start(n, seed, r_hard, free_basal, curvature):
    """The feasible start (state,): everything one SPACING apart, nuclei at random between the two lines.

    Nuclei: equally spaced over the width plus uniform noise of one spacing (half of it to either side), uniform in the
    middle two thirds of the height, then moved apart until feasible.
    """
    rng = np.random.default_rng(seed)
    s = SPACING * (np.arange(n) - 0.5 * (n - 1))
    x = place(s + SPACING * rng.uniform(-0.5, 0.5, n), HEIGHT * rng.uniform(1 / 6, 5 / 6, n), curvature)
    basal = place(s, 0.0, curvature).ravel() if free_basal else s
    rest = np.concatenate((np.full(2 * n, ETA_START), [SPACING]))
    return np.concatenate((place(s, HEIGHT, curvature).ravel(), separate(x, 2 * r_hard).ravel(), basal, rest))


def make_constraints(n, r_hard, free_basal, curvature):
    """Nuclei, order, links, in the authors' order of the sweep."""
    nuclei = Distance(d=2 * r_hard, start=2 * n, count=n)
    size, s, i = 6 * n + 1 + (2 if free_basal else 1) * n, 2 if free_basal else 1, np.arange(n - 1)
    order = np.zeros((n - 1, size))
    order[i, 4 * n + s * i], order[i, 4 * n + s * (i + 1)] = -1.0, 1.0
    if free_basal:
        links = Distance(d=SPACING, sign=-1, pairs=np.stack((i, i + 1), 1), start=4 * n, count=n)
    else:
        reach = SPACING if curvature == 0.0 else 2.0 / curvature * np.arcsin(0.5 * SPACING * curvature)
        links = Affine(A=-order, b=np.full(n - 1, reach))
    return nuclei, Affine(A=order, b=np.zeros(n - 1)), links


def stiffness(A, X, B, mu):
    """A bound on the rates (1/h) of the drift at points (n, 2), reached by a nucleus near an end of its cell.

    The straightness k_s cos(theta) has the Hessian -k_s (cos(theta) grad theta grad theta^T + sin(theta) grad^2 theta);
    with a, b the distances of the nucleus to its ends, |grad theta|^2 <= (1/a + 1/b)^2 + 1/a^2 + 1/b^2 and
    |grad^2 theta| <= 2/a^2 + 2/b^2. The other forces add less than 15. Over 48 h nuclei come within 0.86 of an end;
    the largest rate of all forces together was then 46 / mu (measured).
    """
    u, v = X - A, X - B
    a, b = 1 / np.hypot(*u.T), 1 / np.hypot(*v.T)
    cosine = np.sum(u * v, axis=1) * a * b
    bend = 2 * (a * a + b * b)
    rate = K_STRAIGHT * (np.abs(cosine) * ((a + b) ** 2 + bend / 2) + np.sqrt(np.maximum(1 - cosine ** 2, 0)) * bend)
    return max(46.0, rate.max() + 15.0) / mu


def make(n=30, seed=0, r_hard=0.3, mu=0.2, T=0.5, free_basal=False, curvature=0.0):
    """n cells with hard nuclei of radius r_hard, up to time T; see the module's text for the options."""
    if n < 2 or T <= 0 or not (r_hard > 0 and mu > 0):
        raise ValueError(f"n = {n}, T = {T:g}, r_hard = {r_hard:g}, mu = {mu:g}: n >= 2, the others positive")
    if curvature < 0.0 or curvature > 1.0 or (free_basal and curvature):
        raise ValueError(f"curvature = {curvature:g}: 0 to 1, and 0 with free_basal, which has no line to bend")
    x0 = make_start(n, seed, r_hard, free_basal, curvature)
    samples = max(1, int(np.ceil(T / SAMPLE - 1e-9)))
    case = Case(
        name="epithelium",
        problem=Complementarity(make_drift(n, mu, free_basal, curvature),
                                make_constraints(n, r_hard, free_basal, curvature)),
        x0=x0, t=np.linspace(0.0, T, samples + 1), radius=r_hard, tags=("cells",),
        params={"n": n, "seed": seed, "r_hard": r_hard, "mu": mu, "T": T, "free_basal": free_basal,
                "curvature": curvature},
    )
    fastest = stiffness(*(p[0] for p in points(case, x0)), mu)
    return case.replace(substeps=max(SUBSTEPS, int(np.ceil(fastest * T / samples))))     # h * rate < 1


def points(case, x):
    """A, X, B as arrays (k, n, 2) for states x (k, size) or (size,)."""
    x = np.atleast_2d(x)
    n = case.problem.constraints[0].count
    A, X = x[:, :2 * n].reshape(-1, n, 2), x[:, 2 * n:4 * n].reshape(-1, n, 2)
    if isinstance(case.problem.constraints[2], Distance):
        return A, X, x[:, 4 * n:6 * n].reshape(-1, n, 2)
    return A, X, place(x[:, 4 * n:5 * n], 0.0, case.params.get("curvature", 0.0))


def observables(case, x):
    """What biologists look at, as a dict of (k,) arrays for states x (k, size).

    apical/nuclear/basal_height: mean height over the basal line (over y = 0 where the basal points are free);
    ..._width: extent of the layer in x; straightness: end-to-end distance of the apical line over its length (1 is
    straight); apical/basal_extrusions: nuclei beyond the own apical or basal point, along the axis of their cell;
    nuclear_gap: smallest |X_i - X_j| - 2 r_hard, negative where nuclei overlap.
    """
    layers = dict(zip(("apical", "nuclear", "basal"), points(case, x), strict=True))
    bend = case.params.get("curvature", 0.0)
    out = {}
    for name, p in layers.items():
        up = p[..., 1] if bend == 0.0 else np.hypot(p[..., 0], p[..., 1] + 1 / bend) - 1 / bend
        out[f"{name}_height"], out[f"{name}_width"] = up.mean(1), np.ptp(p[..., 0], axis=1)
    A, X, B = layers.values()
    steps = np.linalg.norm(np.diff(A, axis=1), axis=2).sum(1)
    out["straightness"] = np.linalg.norm(A[:, -1] - A[:, 0], axis=1) / steps
    along = ((X - B) * (A - B)).sum(2) / ((A - B) ** 2).sum(2)
    out["apical_extrusions"], out["basal_extrusions"] = (along > 1).sum(1), (along < 0).sum(1)
    i, j = np.triu_indices(X.shape[1], 1)
    out["nuclear_gap"] = np.linalg.norm(X[:, i] - X[:, j], axis=2).min(1) - case.problem.constraints[0].d
    return out


def draw(ax, case, x):
    """The cells of one state: axes, nuclei (soft rim, hard core), apical line and, in black, the basal line."""
    from matplotlib.collections import EllipseCollection, LineCollection
    A, X, B = (p[0] for p in points(case, x))
    ax.add_collection(LineCollection(np.stack((A, X, B), 1), colors="#999999", linewidths=0.6))
    for r, face, edge in ((R_SOFT, "#56B4E91F", "none"), (case.radius, "#56B4E9CC", "#0072B2")):
        d = np.full(len(X), 2 * r)
        ax.add_collection(EllipseCollection(d, d, 0 * d, units="xy", offsets=X, offset_transform=ax.transData,
                                            facecolors=face, edgecolors=edge, linewidths=0.6))
    ax.plot(*A.T, "-", color="#D55E00", lw=1.2, marker="o", ms=1.8)
    ax.plot(*B.T, "-", color="black", lw=1.6, marker="o", ms=1.8)
    ax.update_datalim(np.concatenate((A, X - R_SOFT, X + R_SOFT, B)))
