"""Thirty cells of an epithelium over 48 hours at the published substep: PBD, and the same written
by hand.

    python tests/studies/speed/epithelium.py                 (--r-hard 0.7 for the packed one,
    --whole 0 to skip T = 48)

One run of PBD to T = 48 at h = 1.25e-3 (38 400 steps) gives the seconds. What users write
themselves is measured on a piece of that run, per step, in interleaved rounds with ours on the same
piece, and checked to compute the same thing:

    numpy loops   PBD: drift in numpy, then a loop over all 435 pairs and the 58 rows with numpy's
    vectors of two
    plain lists   the same loops on lists of Python floats, which are quicker than small arrays
    cvxpy         the step min |y - (x + h f)|^2, g + grad g (y - x) >= 0 over all constraints,
    written anew in each step
    cvxpy, once   the same written once with parameters, which cvxpy compiles once

The first two must agree with PBD to 1e-10 at the end of the piece, the others with catching_up to
1e-7 when their solver (Clarabel) is given tight tolerances; what its defaults leave is printed.
They are timed with the defaults.
"""

import argparse
import math
import os
import platform
import time

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import solvers  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402

H = 1.25e-3
TIGHT = {
    "tol_gap_abs": 1e-13,
    "tol_gap_rel": 1e-13,
    "tol_feas": 1e-12,
}  # for the comparison; timed with the defaults


def piece(r_hard: float, steps: int, start: float):
    """The case from the time `start` of PBD's own run, over `steps` steps."""
    whole = nsbench.get_case("epithelium", r_hard=r_hard, T=48.0)
    x0 = whole.x0
    if start:
        x0 = nsbench.solve(whole.replace(t=np.array([0.0, start])), "pbd", h=H).x[-1]
    return whole.replace(x0=x0, t=np.array([0.0, steps * H]), start="keep")


def data(case):
    """Particles n, their first coordinate, distance, and the affine rows (i, j, a_i, a_j, b) of
    order and links."""
    nuclei, *rows = case.problem.constraints
    listed = [
        (
            int(c.indices[k]),
            int(c.indices[k + 1]),
            float(c.data[k]),
            float(c.data[k + 1]),
            float(c.b[k // 2]),
        )
        for c in rows
        for k in range(0, len(c.indices), 2)
    ]
    return nuclei.count, nuclei.start, float(nuclei.d), listed


def numpy_loops(case, steps):
    f, (n, start, d, rows) = case.problem.drift(np), data(case)

    def run():
        x = case.x0.copy()
        for s in range(steps):
            x = x + H * f(s * H, x)
            X = x[start : start + 2 * n].reshape(n, 2)
            for i in range(n):
                for j in range(i + 1, n):
                    u = X[i] - X[j]
                    r = np.sqrt(u @ u)
                    if r < d:
                        X[i] += 0.5 * (d - r) / r * u
                        X[j] -= 0.5 * (d - r) / r * u
            for i, j, a, b, c in rows:
                g = a * x[i] + b * x[j] + c
                if g < 0.0:
                    x[i] -= g * a / (a * a + b * b)
                    x[j] -= g * b / (a * a + b * b)
        return x

    return run


def plain_lists(case, steps):
    f, (n, start, d, rows) = case.problem.drift(np), data(case)
    end = start + 2 * n

    def run():
        x = case.x0.copy()
        for s in range(steps):
            y = (x + H * f(s * H, x)).tolist()
            for i in range(start, end, 2):
                for j in range(i + 2, end, 2):
                    u = y[i] - y[j]
                    v = y[i + 1] - y[j + 1]
                    r2 = u * u + v * v
                    if r2 < d * d:
                        r = math.sqrt(r2)
                        m = 0.5 * (d - r) / r
                        y[i] += m * u
                        y[i + 1] += m * v
                        y[j] -= m * u
                        y[j + 1] -= m * v
            for i, j, a, b, c in rows:
                g = a * y[i] + b * y[j] + c
                if g < 0.0:
                    m = g / (a * a + b * b)
                    y[i] -= m * a
                    y[j] -= m * b
            x = np.array(y)
        return x

    return run


def linearised(case):
    """(x) -> g (m,), G (m, n) of all constraints, assembled with numpy."""
    n, start, d, rows = data(case)
    i, j = np.triu_indices(n, 1)
    m = len(i)
    at = np.arange(len(i))
    A = np.zeros((len(rows), case.n))
    for k, (p, q, a, b, _) in enumerate(rows):
        A[k, p] = a
        A[k, q] = b
    c = np.array([r[-1] for r in rows])

    def both(x):
        X = x[start : start + 2 * n].reshape(n, 2)
        u = X[i] - X[j]
        r = np.linalg.norm(u, axis=1)
        G = np.zeros((m, case.n))
        for e in range(2):
            G[at, start + 2 * i + e] = u[:, e] / r
            G[at, start + 2 * j + e] = -u[:, e] / r
        return np.concatenate((r - d, A @ x + c)), np.vstack((G, A))

    return both


def cvxpy_rebuilt(case, steps, **settings):
    import cvxpy as cp

    f = case.problem.drift(np)
    both = linearised(case)

    def run():
        x = case.x0.copy()
        for s in range(steps):
            g, G = both(x)
            y = cp.Variable(case.n)
            problem = cp.Problem(
                cp.Minimize(cp.sum_squares(y - (x + H * f(s * H, x)))), [g + G @ (y - x) >= 0]
            )
            problem.solve(solver=cp.CLARABEL, **settings)
            x = y.value
        return x

    return run


def cvxpy_once(case, steps, **settings):
    import cvxpy as cp

    f = case.problem.drift(np)
    both = linearised(case)
    g0, G0 = both(case.x0)
    y = cp.Variable(case.n)
    z = cp.Parameter(case.n)
    G = cp.Parameter(G0.shape)
    rest = cp.Parameter(len(g0))
    problem = cp.Problem(cp.Minimize(cp.sum_squares(y - z)), [G @ y + rest >= 0])

    def run():
        x = case.x0.copy()
        for s in range(steps):
            g, M = both(x)
            z.value = x + H * f(s * H, x)
            G.value = M
            rest.value = g - M @ x
            problem.solve(solver=cp.CLARABEL, **settings)
            x = y.value
        return x

    return run


def check(name, make, run, case, steps):
    """The end of the piece is that of our method, or SystemExit."""
    model = "catching_up" if name.startswith("cvxpy") else "pbd"
    end = nsbench.solve(case, model, h=H).x[-1]
    off = np.abs(run() - end).max()
    print(f"{name}: {off:.1e} from {model} after {steps} steps", end="")
    if model == "catching_up":
        off = np.abs(make(case, steps, **TIGHT)() - end).max()
        print(f", {off:.1e} with tight tolerances", end="")
    print()
    if not off <= (1e-7 if model == "catching_up" else 1e-10):
        raise SystemExit(f"{name} does not compute what {model} computes")


def installed(name):
    from importlib.util import find_spec

    return find_spec(name) is not None


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--r-hard", type=float, default=0.3)
    parser.add_argument(
        "--whole", type=float, default=48.0, help="end time of the whole run, 0 for none"
    )
    parser.add_argument(
        "--start", type=float, default=0.0, help="time from which the piece is taken"
    )
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, numpy "
        f"{np.__version__}, "
        f"r_hard = {args.r_hard:g}, h = {H:g}"
    )
    if args.whole:
        case = nsbench.get_case("epithelium", r_hard=args.r_hard, T=args.whole)
        start = time.perf_counter()
        run = solvers.get("pbd").prepare(case, H)
        ready = time.perf_counter()
        traj = run()
        took = time.perf_counter() - ready
        print(
            f"pbd to T = {args.whole:g}: {took:.2f} s, {traj.stats['steps']} steps, "
            f"{1e6 * took / traj.stats['steps']:.1f} "
            f"microseconds each, prepared in {ready - start:.1f} s, {traj.status.code}, loop "
            f"{traj.stats['loop']}"
        )
    steps = {"pbd": 400, "numpy loops": 20, "plain lists": 40, "catching_up": 40}
    made = {"numpy loops": numpy_loops, "plain lists": plain_lists}
    if installed("cvxpy") and installed("clarabel"):
        steps |= {"cvxpy": 3, "cvxpy, once": 3}
        made |= {"cvxpy": cvxpy_rebuilt, "cvxpy, once": cvxpy_once}
    else:
        print("cvxpy (or its solver clarabel) is not installed (pip install cvxpy); left out.")
    runs = {
        name: make(piece(args.r_hard, steps[name], args.start), steps[name])
        for name, make in made.items()
    }
    ours = {
        name: solvers.get(name).prepare(piece(args.r_hard, steps[name], args.start), H)
        for name in ("pbd", "catching_up")
    }
    for name, run in runs.items():
        check(name, made[name], run, piece(args.r_hard, steps[name], args.start), steps[name])
    times = interleaved({**ours, **runs}, args.rounds)
    print(f"{'':<14}{'us per step':>12}  {'whole run, s':>12}  over pbd, per step [quartiles]")
    for name, t in times.items():
        scale = steps["pbd"] / steps[name]
        r = ratio(t, times["pbd"])
        print(
            f"{name:<14}{1e6 * t.median / steps[name]:>12.1f}  "
            f"{48.0 / H * t.median / steps[name]:>12.4g}  "
            f"{scale * r.median:.4g} [{scale * r.low:.4g}, {scale * r.high:.4g}]"
        )


if __name__ == "__main__":
    main()
