"""Is the numerical error small beside the model error? Observables of the epithelium over seeds.

For each seed the observables at the end (heights, widths, straightness, extrusions) of the true
solution and of methods with three steps. The spread over seeds, its standard deviation, stands for
what the model leaves to chance; numerical errors are compared with it.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import case_module, get_case
from nsbench.solvers import solve
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.truth import extrapolate

DIVISORS = (10, 40, 160)  # steps per sample of 0.05; 40 is the step of the authors' code
METHODS = ("pbd", "catching_up")
LEVEL = 0.95


def observe(seed: int, end: float, r_hard: float, substeps: int) -> dict:
    """Return the observables of one seed at the end: of the truth, with a bound, and of methods.

    substeps: of the coarsest of three runs of catching-up that are extrapolated to the truth.
    """
    case = get_case("epithelium", seed=seed, T=end, r_hard=r_hard)
    observables = case_module("epithelium").observables
    truth = extrapolate(case, substeps)
    spacing = float(np.diff(case.t).min())
    runs = []
    for method in METHODS:
        for n in DIVISORS:
            traj = solve(case, method, h=spacing / n)
            known = traj.status.code in USABLE and np.isfinite(traj.x).all()
            runs.append(
                {
                    "method": method,
                    "h": spacing / n,
                    "status": traj.status.code,
                    "values": _at_end(observables(case, traj.x)) if known else None,
                }
            )
    return {
        "seed": seed,
        "truth": _at_end(observables(case, truth.x)),
        "truth_error": truth.state_error,
        "runs": runs,
    }


def truth_error(seeds: list[dict]) -> float:
    """Return the root mean square, over seeds, of the errors of their true solutions."""
    return float(np.sqrt(np.mean([s["truth_error"] ** 2 for s in seeds])))


def _at_end(values: dict[str, np.ndarray]) -> dict[str, float]:
    return {name: float(v[-1]) for name, v in values.items()}


def compare(seeds: list[dict]) -> list[dict]:
    """Compare numerical errors with the spread over seeds, by observable, method and step.

    ratio: root mean square error over the standard deviation of the true values, with the 95 %
    interval (low, high) that the sample of seeds leaves to that deviation, for normal values, wider
    by the root mean square to which the truths are known; None where an observable varies by less.
    """
    from scipy.stats import chi2

    n = len(seeds)
    known = truth_error(seeds)
    out = []
    for name in seeds[0]["truth"]:
        true = np.array([s["truth"][name] for s in seeds])
        spread = float(true.std(ddof=1))
        for k, run in enumerate(seeds[0]["runs"]):
            values = [s["runs"][k]["values"] for s in seeds]
            used = [i for i, v in enumerate(values) if v is not None]
            row = {
                "observable": name,
                "method": run["method"],
                "h": run["h"],
                "mean": float(true.mean()),
                "spread": spread,
                "failed": n - len(used),
                "rms": None,
                "largest": None,
                "ratio": None,
                "low": None,
                "high": None,
                "changed": None,
            }
            out.append(row)
            if not used:
                continue
            off = np.array([values[i][name] for i in used]) - true[used]
            row["rms"] = float(np.sqrt(np.mean(off**2)))
            row["largest"] = float(np.abs(off).max())
            row["changed"] = int(np.count_nonzero(np.abs(off) >= 0.5))  # of counts
            if spread > known:
                tails = chi2.ppf([(1.0 - LEVEL) / 2, (1.0 + LEVEL) / 2], n - 1) / (n - 1)
                low, high = np.sqrt(tails)
                row["ratio"] = row["rms"] / spread
                row["low"] = float(max(0.0, row["rms"] - known) / spread * low)
                row["high"] = float((row["rms"] + known) / spread * high)
    return out
