"""Catching up in near-jammed packings: what a step costs over one step of PBD in the same scene,
and what other solvers take.

    python tests/studies/speed/catching_up.py [--n 30 100 1000 10000]

Scene: n unit discs on a shaken lattice, drawn together until nearly all touch, then driven for 100
steps (10 if there are ten thousand) of h = 0.01: a pull to the middle that reaches speed 1 at the
rim, a turn half as fast, and a velocity of length 1 of its own for every disc. Runs are whole:
drift, lists, linearisation, solves, records. They are interleaved; a ratio is the median of ratios
within rounds with its quartiles. The other solvers get the QPs of five states of the same run as
matrices that are ready, cold, at the tolerance named; their residual is judged by the formula of
kernels.qp.residual, not by their word.
"""

import argparse
import os
import platform
import time
from importlib import metadata, util

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import Case, Complementarity, Distance  # noqa: E402
from nsbench.dynamics.contacts.constraint_set import ConstraintSet  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402
from nsbench.solvers import get  # noqa: E402
from nsbench.solvers.catching_up.qp_backends import residual  # noqa: E402

# steps of a run, of one with thousands of discs; states whose QPs others get
STEP = 0.01
STEPS = 100
LONG = 10
STATES = 5
DENSE = 400  # rows up to which a dense solver is asked


def scene(x, pull, turn, own, steps, seed=1, h=STEP):
    """The case of discs at x, driven; pull and turn as speeds at the rim."""
    n = x.size // 2
    angle = 2 * np.pi * np.random.default_rng(seed).random(n)
    push = own * np.stack((np.cos(angle), np.sin(angle)), 1).ravel()
    rim = max(1.0, np.abs(x).max())
    spin = turn / rim * np.tile([-1.0, 1.0], n)

    def drift(xp):
        def f(t, y):
            return push - pull / rim * y + spin * y.reshape((-1, 2))[:, ::-1].flatten()

        return f

    return Case(
        "jam", Complementarity(drift, (Distance(2.0),)), x, np.array([0.0, steps * h]), start="keep"
    )


def jammed(n, seed=0):
    """Places (2 n,) of discs that nearly all touch, in random order.

    A shaken square lattice is drawn together by PBD under a pull that dies away, since PBD overlaps
    by about a step; then what overlaps is taken apart, and ten steps of catching up fit the rest.
    """
    rng = np.random.default_rng(seed)
    side = int(1.2 * np.sqrt(n)) + 3
    p = 2.4 * np.stack(np.divmod(np.arange(side * side), side), 1) - 1.2 * (side - 1)
    p = p[np.argsort((p**2).sum(1), kind="stable")[:n]] + rng.uniform(-0.2, 0.2, (n, 2))
    x = rng.permutation(p).ravel()

    def drift(xp):
        def f(t, y):
            return -rate * 0.6 ** (t / 6.0) * y + 0.3 * 0.1**t * own

        return f

    own = rng.normal(size=2 * n)
    rate = min(0.06, 3.0 / np.abs(p).max())
    case = Case(
        "draw", Complementarity(drift, (Distance(2.0),)), x, np.array([0.0, 72.0]), start="keep"
    )
    x = nsbench.solve(case, "pbd", h=0.02).x[-1]
    case = Case(
        "part", Complementarity(drift, (Distance(2.0),)), x, np.array([72.0, 80.0]), start="keep"
    )
    x = nsbench.solve(case, "pbd[sweeps=5]", h=0.02).x[-1]
    return nsbench.solve(scene(x, 1.0, 0.5, 1.0, 10), "catching_up", h=STEP).x[-1]


def problems(case, x):
    """The QPs G, q of the steps from the states x (k, 2 n)."""
    s = ConstraintSet(case.problem, case.n)
    f = case.problem.drift(np)
    for y in x:
        near = s.near(y, 0.1)
        G = s.gradients(0.0, y, near).tocsr()
        yield G, s.gaps(0.0, y, near) + G @ (STEP * f(0.0, y))


def daqp(G, q):
    """DAQP (Arnstrom, Bemporad & Axehill 2022), a dense dual active set."""
    from daqp import solve

    m, n = G.shape
    args = (np.eye(n), np.zeros(n), G.toarray(), np.full(m, 1e30), -q / STEP, np.zeros(m, np.int32))
    start = time.perf_counter()
    d, _, _, info = solve(*args)
    return time.perf_counter() - start, STEP * np.array(d), -STEP * np.array(info["lam"])


def piqp(G, q, eps=1e-8):
    """PIQP (Schwan et al. 2023), sparse."""
    import piqp as library
    from scipy.sparse import csc_matrix, identity

    P = csc_matrix(identity(G.shape[1]))
    A = csc_matrix(G)
    start = time.perf_counter()
    s = library.SparseSolver()
    s.settings.eps_abs = s.settings.eps_rel = eps
    s.setup(P=P, c=np.zeros(G.shape[1]), G=A, h_l=-q / STEP)
    s.solve()
    return time.perf_counter() - start, STEP * np.array(s.result.x), STEP * np.array(s.result.z_l)


def clarabel(G, q, eps=1e-8):
    """Clarabel (Goulart & Chen 2024)."""
    import clarabel as library
    from scipy.sparse import csc_matrix, identity

    P = csc_matrix(identity(G.shape[1]))
    A = csc_matrix(-G)
    start = time.perf_counter()
    s = library.DefaultSettings()
    s.verbose = False
    s.tol_gap_abs = eps
    s.tol_gap_rel = eps
    s.tol_feas = eps
    r = library.DefaultSolver(
        P, np.zeros(G.shape[1]), A, q / STEP, [library.NonnegativeConeT(G.shape[0])], s
    ).solve()
    return time.perf_counter() - start, STEP * np.array(r.x), STEP * np.array(r.z)


def osqp(G, q, eps=1e-6):
    """OSQP (Stellato et al. 2020) with polishing."""
    import osqp as library
    from scipy.sparse import csc_matrix, identity

    P = csc_matrix(identity(G.shape[1]))
    A = csc_matrix(G)
    start = time.perf_counter()
    s = library.OSQP()
    s.setup(
        P,
        np.zeros(G.shape[1]),
        A,
        -q / STEP,
        np.full(G.shape[0], np.inf),
        eps_abs=eps,
        eps_rel=eps,
        polishing=True,
        max_iter=20000,
        verbose=False,
    )
    r = s.solve(raise_error=False)
    return time.perf_counter() - start, STEP * r.x, -STEP * r.y


def others(case, x, pbd):
    """One line for each solver that is installed: multiples of a PBD step, and the worst
    residual."""
    for solver in (daqp, piqp, clarabel, osqp):
        name = solver.__name__
        if util.find_spec(name) is None:
            print(f"    {name}: not installed, left out")
            continue
        rows = list(problems(case, x if case.n < 5000 else x[:1]))
        if solver is daqp and rows[0][0].shape[0] > DENSE:
            print("    daqp: dense, left out")
            continue
        if solver in (clarabel, osqp) and case.n > 5000:
            print(f"    {name}: minutes at this size, left out")
            continue
        got = [solver(G, q) for G, q in rows]
        left = max(
            residual(G, q + G @ d, mu, d) for (G, q), (_, d, mu) in zip(rows, got, strict=True)
        )
        print(
            f"    {name} {metadata.version(name)}: {np.median([s for s, *_ in got]) / pbd:.0f} "
            f"PBD steps, residual {left:.1e}"
        )


def measure(n):
    """Lines of the table for n discs."""
    x = jammed(n)
    steps = STEPS if n < 5000 else LONG  # a hundred steps of ten thousand discs take minutes
    case = scene(x, 1.0, 0.5, 1.0, steps)
    runs = {name: get(name).prepare(case, STEP) for name in ("pbd", "catching_up")}
    done = {name: run() for name, run in runs.items()}
    times = interleaved(runs, rounds=5 if n < 1000 else 3 if n < 5000 else 1, least=0.05)
    stats = done["catching_up"].stats
    pbd = times["pbd"].median / steps
    print(
        f"{n:6d} discs, {steps} steps, {stats['contacts_peak']} rows, {stats['contacts']} acting "
        f"on average: "
        f"{ratio(times['catching_up'], times['pbd'])} PBD steps of {1e9 * pbd / n:.0f} ns per "
        f"disc, "
        f"worst residual {stats['kkt']:.1e}, {stats['inner_iterations'] / steps:.1f} factors and "
        f"exchanges a step, "
        f"worst step {stats['rounds_worst']}, {done['catching_up'].status.code}",
        flush=True,
    )
    states = (
        nsbench.solve(
            case.replace(t=np.linspace(0.0, steps * STEP, STATES + 1)), "catching_up", h=STEP
        ).x
        if n < 5000
        else done["catching_up"].x
    )
    others(case, states[1:], pbd)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, nargs="+", default=[30, 100, 1000, 10000])
    print(
        f"python {platform.python_version()}, numba {metadata.version('numba')}, load "
        f"{os.getloadavg()[0]:.1f}"
    )
    for n in parser.parse_args().n:
        measure(n)


if __name__ == "__main__":
    main()
