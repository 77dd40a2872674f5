"""Hard discs in a box, one step = drift, neighbour search, one sweep: the same work by libraries
that users have.

    python tests/studies/speed/peers_discs.py --n 1000 10000

Functions that give zero-argument runs for other scripts, and a table of their own. The scene is
`drift_scene`: discs of radius 1, random velocities of length 1, area fraction 0.8, four walls.
Every step is explicit Euler, then one sweep of exact projections over the pairs that a search
finds, then the walls. The peers:

    kdtree + numba   scipy's cKDTree lists the pairs within 2 R (it allocates them anew in each
    step), numba sweeps
    tuned            the same with a tree that is neither balanced nor compact: quicker to build,
    about as quick to ask
    kdtree + numpy   the same pairs, all projections at once from the same state, averaged by
    contacts (Jacobi)
    taichi           counting sort into cells, then a sequential sweep over cells and half of their
    neighbours; the
                     whole march is one compiled kernel on one thread in float64

The order of a sweep is the peer's own; none has a margin, so a contact made by the sweep itself may
be missed (13 % of them in this scene), which is what users have. What is not installed is left out,
with a sentence.
"""

import argparse
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402

DIAMETER = 2.0
STEP = 0.01


@dataclass(frozen=True)
class Scene:
    """x0, v: places and velocities (n, 2); low, high (2,): the walls for centres; case: the same
    for nsbench."""

    x0: np.ndarray
    v: np.ndarray
    low: np.ndarray
    high: np.ndarray
    case: object


def drift_scene(
    n: int, steps: int, labels: str = "rows", seed: int = 0, h: float = STEP, warm: int = 100
) -> Scene:
    """n discs at area fraction 0.8 with random unit velocities, for `steps` steps of h; labels:
    "rows" (sorted by rows of the packing, which is about by cells) or "random". The start is what
    PBD makes of the packing in `warm` steps: before that most discs have not met a neighbour, and a
    step costs less."""
    case = nsbench.get_case("discs", n=n, seed=seed, box=True, packing=0.8, labels=labels)
    if warm:
        x0 = nsbench.solve(case.replace(t=np.array([0.0, warm * h])), "pbd", h=h).x[-1]
        case = case.replace(x0=x0, start="keep")
    case = case.replace(t=np.array([0.0, steps * h]))
    v = case.problem.drift(np)(0.0, case.x0.copy()).reshape(-1, 2)
    b = case.problem.constraints[1].b
    return Scene(case.x0.reshape(-1, 2).copy(), v, -b[:2], b[2 * n : 2 * n + 2].copy(), case)


def kdtree(
    scene: Scene, steps: int, h: float = STEP, sweep: str = "numba", tuned: bool = False
) -> Callable[[], np.ndarray]:
    """A run with scipy's cKDTree, as it is or tuned: the places (n, 2) at the end."""
    from scipy.spatial import cKDTree

    options = {"compact_nodes": False, "balanced_tree": False} if tuned else {}
    project = _numba_sweep() if sweep == "numba" else _numpy_sweep

    def run():
        x = scene.x0.copy()
        for _ in range(steps):
            x += h * scene.v
            project(x, cKDTree(x, **options).query_pairs(DIAMETER, output_type="ndarray"))
            np.clip(x, scene.low, scene.high, out=x)
        return x

    run()  # compiled before it is timed
    return run


def _numpy_sweep(x, pairs):
    """All projections from the same state, those of a disc averaged by its number of contacts."""
    i = pairs[:, 0]
    j = pairs[:, 1]
    u = x[i] - x[j]
    r = np.sqrt(np.einsum("ij,ij->i", u, u))
    u *= (0.5 * (DIAMETER - r) / r)[:, None]
    n = len(x)
    count = np.maximum(np.bincount(i, minlength=n) + np.bincount(j, minlength=n), 1)
    for c in range(2):
        x[:, c] += (np.bincount(i, u[:, c], n) - np.bincount(j, u[:, c], n)) / count


def _numba_sweep():
    from numba import njit

    @njit(error_model="numpy")
    def sweep(x, pairs):
        for k in range(pairs.shape[0]):
            i = pairs[k, 0]
            j = pairs[k, 1]
            u = x[i, 0] - x[j, 0]
            v = x[i, 1] - x[j, 1]
            r2 = u * u + v * v
            if r2 < DIAMETER * DIAMETER:
                r = np.sqrt(r2)
                m = 0.5 * (DIAMETER - r) / r
                x[i, 0] += m * u
                x[i, 1] += m * v
                x[j, 0] -= m * u
                x[j, 1] -= m * v

    return sweep


def taichi(scene: Scene, steps: int, h: float = STEP) -> Callable[[], np.ndarray] | str:
    """A run with taichi, sequential and in float64; a sentence where taichi is not installed."""
    try:
        import taichi as ti
    except ImportError:
        return "taichi is not installed (pip install taichi); left out."
    from taichi.lang import impl

    if not impl.get_runtime().prog:  # one runtime for all scenes: a second init would end the first
        ti.init(
            arch=ti.cpu,
            default_fp=ti.f64,
            cpu_max_num_threads=1,
            offline_cache=False,
            log_level=ti.ERROR,
        )
    n = len(scene.x0)
    low = scene.low - 1.0
    high = scene.high + 1.0
    columns, rows = (
        max(1, int(s)) for s in (high - low) / DIAMETER
    )  # cells of at least one diameter
    a = float(low[0])
    b = float(low[1])
    per = ti.Vector([columns / (high[0] - low[0]), rows / (high[1] - low[1])])
    bounds = [float(v) for v in (*scene.low, *scene.high)]
    x, y, v = (ti.Vector.field(2, float, n) for _ in range(3))
    cell = ti.field(int, n)
    ids = ti.field(int, n)
    first = ti.field(int, columns * rows + 1)

    @ti.func
    def push(i, j):
        u = x[i] - x[j]
        r2 = u[0] * u[0] + u[1] * u[1]
        if r2 < DIAMETER * DIAMETER:
            r = ti.sqrt(r2)
            m = 0.5 * (DIAMETER - r) / r * u
            x[i] += m
            x[j] -= m

    @ti.kernel
    def march(steps: ti.i32, h: ti.f64):
        ti.loop_config(serialize=True)
        for _ in range(steps):
            for c in range(columns * rows + 1):
                first[c] = 0
            for i in range(n):
                x[i] += h * v[i]
                c0 = ti.max(0, ti.min(columns - 1, int((x[i][0] - a) * per[0])))
                c1 = ti.max(0, ti.min(rows - 1, int((x[i][1] - b) * per[1])))
                cell[i] = c1 * columns + c0
                first[cell[i] + 1] += 1
            for c in range(columns * rows):
                first[c + 1] += first[c]
            for i in range(n):
                k = n - 1 - i
                first[cell[k] + 1] -= 1  # filled from the back: first[c + 1] ends as the start of c
                ids[first[cell[k] + 1]] = k
            for c in range(columns * rows):
                begin = first[c + 1]
                end = n
                if c + 2 <= columns * rows:
                    end = first[c + 2]
                for p in range(begin, end):
                    i = ids[p]
                    for q in range(p + 1, end):
                        push(i, ids[q])
                    c0 = c % columns
                    if c0 + 1 < columns:
                        stop = n
                        if c + 3 <= columns * rows:
                            stop = first[c + 3]
                        for q in range(end, stop):
                            push(i, ids[q])
                    if c + columns < columns * rows:
                        lo = c + columns - ti.min(c0, 1)
                        up = c + columns + ti.min(columns - 1 - c0, 1)
                        stop = n
                        if up + 2 <= columns * rows:
                            stop = first[up + 2]
                        for q in range(first[lo + 1], stop):
                            push(i, ids[q])
            for i in range(n):
                x[i][0] = ti.max(bounds[0], ti.min(bounds[2], x[i][0]))
                x[i][1] = ti.max(bounds[1], ti.min(bounds[3], x[i][1]))

    @ti.kernel
    def restart():
        ti.loop_config(serialize=True)
        for i in range(n):
            x[i] = y[i]

    y.from_numpy(scene.x0)
    v.from_numpy(scene.v)

    def run():
        restart()
        march(steps, h)
        ti.sync()
        return x

    run()
    return lambda: run()


def peers(scene: Scene, steps: int, h: float = STEP) -> tuple[dict[str, Callable], list[str]]:
    """Runs by name, compiled and ready to be timed, and a sentence for each peer that is left
    out."""
    found = {
        "kdtree + numba": kdtree(scene, steps, h),
        "kdtree + numba, tuned": kdtree(scene, steps, h, tuned=True),
        "kdtree + numpy": kdtree(scene, steps, h, "numpy"),
        "taichi": taichi(scene, steps, h),
    }
    return (
        {k: r for k, r in found.items() if callable(r)},
        [r for r in found.values() if not callable(r)],
    )


def overlap(x: np.ndarray) -> tuple[float, float]:
    """Largest and mean overlap of discs at x (n, 2): whether two peers did the same work."""
    from scipy.spatial import cKDTree

    i, j = cKDTree(x).query_pairs(DIAMETER, output_type="ndarray").T
    depth = DIAMETER - np.linalg.norm(x[i] - x[j], axis=1)
    return (float(depth.max()), float(depth.sum() / len(x))) if len(depth) else (0.0, 0.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, numpy {np.__version__}, load "
        f"{os.getloadavg()[0]:.1f}"
    )
    for labels in ("rows", "random"):
        for n in args.n:
            steps = max(20, min(200, 1_000_000 // n))
            scene = drift_scene(n, steps, labels)
            runs, skipped = peers(scene, steps)
            ours = nsbench.solvers.get("pbd").prepare(scene.case, STEP)
            ours()
            times = interleaved({"pbd": ours, **runs}, args.rounds)
            for name, run in {"pbd": ours, **runs}.items():
                end = run()
                end = (
                    end.x[-1].reshape(-1, 2)
                    if name == "pbd"
                    else end.to_numpy()
                    if name == "taichi"
                    else end
                )
                worst, mean = overlap(end)
                print(
                    f"{labels:>7} {n:>7} discs {steps:>4} steps  {name:<21} "
                    f"{1e9 * times[name].median / n / steps:8.1f} ns "
                    f"per disc and step, over pbd {ratio(times[name], times['pbd'])!s:<22} "
                    f"overlap {worst:.3f} mean {mean:.4f}"
                )
            for why in skipped:
                print(why)


if __name__ == "__main__":
    main()
