"""Filippov systems with few modes: event_driven against SciPy and heyoka with the modes written by
hand.

    python tests/studies/speed/filippov.py                   (--rounds 7)

Each method runs at the loosest tolerance of a ladder with which it reaches the error asked for
(against the exact solution or the stored reference, at all samples). event_driven is told the
fields and the surface and finds the modes itself; it certifies its steps and records 31 to 51
samples, integrals of the weights and events. solve_ivp (DOP853) and heyoka are told the modes, and
record the same; "end" is heyoka with the state at the end time alone, no weights and no samples.
Its integrators are built before the clock starts. Ratios are medians over interleaved rounds, with
quartiles. CPU seconds of compilation are apart: of event_driven's kernels in a process of its own
with an empty cache (once for all cases), of heyoka's integrators here (for each case). heyoka
misses a terminal event silently when its function is exactly zero at the start of the step in which
it vanishes again; none of these arcs is that short, and the end states are compared.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

import nsbench  # noqa: E402
from nsbench import solvers  # noqa: E402
from nsbench.measure.clock import interleaved, ratio  # noqa: E402

ASKED = {"oscillator": 1e-11, "slide_exit": 1e-11, "stick_slip": 1e-9, "friction": 1e-9}
LADDER = 10.0 ** -np.arange(7, 14)
COLD = (
    "import time, nsbench; from nsbench import solvers; case = nsbench.get_case('slide_exit'); a "
    "= time.process_time(); "
    "s = solvers.get('event_driven'); s.prepare(case, 1e-12)(); print(time.process_time() - a)"
)


def truth(case) -> np.ndarray:
    """(k, n) states at the samples, exact or from the stored reference."""
    if case.exact is not None:
        return case.exact(case.t)
    from nsbench.reference.storage import load

    return load(case).x


def reaching(asked, attempt):
    """(run, error, tolerance) at the loosest tolerance of the ladder for which attempt(tol) ->
    (run, error) reaches it."""
    for tol in LADDER:
        run, error = attempt(float(tol))
        if error <= asked:
            return run, error, float(tol)
    return run, error, float(tol)


def ours(case, name, exact):
    """An attempt with a method of the bench."""

    def attempt(tol):
        run = solvers.get(name).prepare(case, tol)
        traj = run()
        return run, float(np.abs(traj.x - exact).max()) if traj.status.ok else np.inf

    return attempt


def scripts(hy, tol, weigh):
    """Modes by hand for heyoka: arcs by name (integrator, what follows its event) and the first
    one. weigh: with the integral of the weight as a third unknown."""
    x, y, w = hy.make_vars("x", "y", "w")
    turn = 2.0 * np.pi
    belt = 0.2
    mu = 0.3

    def arc(rhs, weight, g=None, direction=0):
        kind = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
        events = [] if g is None else [hy.t_event(g, direction=kind[direction])]
        system = list(zip((x, y, w), [*rhs, weight + 0.0 * x], strict=True))[: 2 + weigh]
        return hy.taylor_adaptive(system, [0.5] * len(system), t_events=events, tol=tol)

    def slide_exit():
        on = (1.0 - x) / (2.0 - x + 0.5 * hy.sin(x))
        return {
            "above": (arc([1.0 + y, -1.0 - 0.5 * hy.sin(x)], 1.0, y, -1), lambda s: "on"),
            "on": (
                arc([on + (1.0 - on) * (2.0 + 0.25 * x * x), 0.0 * x], on, 1.0 - x, -1),
                lambda s: "below",
            ),
            "below": (arc([2.0 + 0.25 * x * x, 1.0 - x], 0.0), None),
        }, "above"

    def oscillator():
        return {
            "in": (arc([x - turn * y, y + turn * x], 0.0, x * x + y * y - 1.0, 1), lambda s: "out"),
            "out": (arc([x + turn * y, y - turn * x], 1.0), None),
        }, "in"

    def stick_slip():
        caught = lambda other: lambda s: "stick" if abs(s[0]) <= 1.0 else other
        return {
            "slow": (arc([y, -x + 1.0 / (1.2 - y)], 0.0, y - belt, 1), caught("fast")),
            "fast": (arc([y, -x - 1.0 / (0.8 + y)], 1.0, y - belt, -1), caught("slow")),
            "stick": (
                arc([belt + 0.0 * x, 0.0 * x], 0.5 * (1.0 - x), 1.0 - x, -1),
                lambda s: "slow",
            ),
        }, "slow"

    def friction():
        stop = lambda other: lambda s: "stuck" if abs(s[0]) <= mu else other
        return {
            "left": (arc([y, mu - x], 0.0, y, 1), stop("right")),
            "right": (arc([y, -mu - x], 1.0, y, -1), stop("left")),
            "stuck": (arc([0.0 * x, 0.0 * x], 0.5 - 0.5 * x / mu), None),
        }, "left"

    return {f.__name__: f for f in (slide_exit, oscillator, stick_slip, friction)}


SURFACE = {
    "slide_exit": ("on", 0.0),
    "stick_slip": ("stick", 0.2),
    "friction": (None, 0.0),
}  # arcs that start with y given


def by_hand(hy, case, exact, all_of_it):
    """An attempt with heyoka; building the integrators is not part of the run. all_of_it: the
    samples, the integral of the weight and the events, as the others give them; else the end state
    alone."""

    def attempt(tol):
        arcs, first = scripts(hy, max(tol * 1e-2, np.finfo(float).eps), all_of_it)[case.name]()
        held, value = SURFACE.get(case.name, ("none", 0.0))
        times = case.t
        T = float(case.t[-1])
        start = np.append(case.x0, np.zeros(int(all_of_it)))

        def run():
            t = float(times[0])
            state = start
            name = first
            done = 1
            events = []
            X = np.full((len(times), len(start)), np.nan)
            X[0] = start
            while True:
                ta, follows = arcs[name]
                ta.time = t
                ta.state[:] = state
                if ta.with_events:
                    ta.reset_cooldowns()
                if all_of_it:
                    out = ta.propagate_grid(np.concatenate(([t], times[done:])))
                    rows = out[-1][1:]
                    X[done : done + len(rows)] = rows
                    done += len(rows)
                else:
                    out = ta.propagate_until(T)
                if out[0] == hy.taylor_outcome.time_limit:
                    return X if all_of_it else ta.state.copy()
                t = ta.time
                state = ta.state.copy()
                name = follows(state)
                events.append((t, name))
                if held is None or name == held:
                    state[1] = value

        out = run()
        return run, float(
            np.abs(out[:, :2] - exact).max() if all_of_it else np.abs(out - exact[-1]).max()
        )

    return attempt


def cold() -> float:
    """CPU seconds of the first run in a fresh process without compiled kernels."""
    with tempfile.TemporaryDirectory() as folder:
        out = subprocess.run(
            [sys.executable, "-c", COLD],
            env=os.environ | {"NUMBA_CACHE_DIR": folder},
            capture_output=True,
            text=True,
            check=True,
        )
    return float(out.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    try:
        import heyoka as hy
    except ImportError:
        hy = None
        print("heyoka is not installed: left out")
    versions = [f"{m.__name__} {m.__version__}" for m in (np, *([hy] if hy else []))]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; Python "
        f"{platform.python_version()}, " + ", ".join(versions)
    )
    print(f"event_driven: {cold():.1f} CPU s of compilation without a cache, once for all cases")
    print(
        f"{'case':11s} {'asked':>5s} | error, tol: {'ours':>15s} {'SciPy':>14s} {'heyoka':>14s} "
        f"{'end':>14s} | {'us':>5s} | "
        f"ours / {'SciPy':>24s} {'heyoka':>18s} {'end':>18s} | heyoka / {'SciPy':>24s} | built, "
        f"CPU s"
    )
    for name, asked in ASKED.items():
        case = nsbench.get_case(name)
        exact = truth(case)
        built = 0.0
        attempts = {
            "ours": ours(case, "event_driven", exact),
            "scipy": ours(case, "solve_ivp", exact),
        }
        if hy:
            attempts |= {
                "heyoka": by_hand(hy, case, exact, True),
                "end": by_hand(hy, case, exact, False),
            }
        found = {k: reaching(asked, f) for k, f in attempts.items()}
        if hy:
            built = time.process_time()
            scripts(hy, found["heyoka"][2] * 1e-2, True)[name]()
            built = time.process_time() - built
        times = interleaved({k: v[0] for k, v in found.items()}, rounds)
        cells = [f"{e:.1e}, {tol:.0e}" for _, e, tol in found.values()] + ["-"] * (4 - len(found))
        pairs = [("ours", "scipy"), ("ours", "heyoka"), ("ours", "end"), ("heyoka", "scipy")]
        r = [str(ratio(times[a], times[b])) if a in times and b in times else "-" for a, b in pairs]
        print(
            f"{name:11s} {asked:5.0e} | {cells[0]:>27s} {cells[1]:>14s} {cells[2]:>14s} "
            f"{cells[3]:>14s} | "
            f"{times['ours'].median * 1e6:5.0f} | {r[0]:>31s} {r[1]:>18s} {r[2]:>18s} | "
            f"{r[3]:>33s} | {built:.2f}"
        )


if __name__ == "__main__":
    main()
