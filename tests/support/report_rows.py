"""Made-up rows of several cases and methods, with every kind of outcome a report must show."""

import numpy as np

from nsbench.report import data, summary

STEPS = 0.05 / np.unique(np.round(2 ** np.arange(0, 7.5, 0.27)))
METHODS = {  # order, constant of the state error, cost per step, loop
    "pbd": (1.0, 1.0, 1e-7, "compiled"),
    "pbd[order=reverse]": (1.0, 1.3, 1e-7, "compiled"),
    "catching_up": (1.0, 0.2, 3e-6, "compiled"),
    "penalty": (1.0, 0.4, 2e-6, "compiled"),
    "implicit_euler": (1.0, 0.5, 3e-5, "host"),
    "event_driven": (0.0, 0.0, 0.0, "host"),
}
SOLVERS = {
    name: {"doc": f"{name} in one line.", "accuracy": "h", "claims": {"state": 1.0, "impulse": 1.0}}
    for name in METHODS
}
SOLVERS["event_driven"] = {"doc": "Events.", "accuracy": "tol", "claims": {"exact": 1e-9}}
SOLVERS["penalty"]["accuracy"] = "k"
CASES = {
    "tide": {
        "doc": "Tide: a point pushed against the floor, held, and released.\n\n    y' = -cos t + "
        "lam\n\nMore.",
        "n": 1,
        "families": "1 affine row",
        "reference": "exact",
    },
    "apple": {
        "doc": "The talk's falling apple.",
        "n": 1,
        "families": "1 affine row",
        "reference": "exact",
    },
    "hex[n=19]": {
        "doc": "Nineteen discs pulled to a point.",
        "n": 38,
        "families": "171 pairs of discs",
    },
    "discs[n=30,seed=0]": {"doc": "Thirty hard discs.", "n": 60},
    "discs[n=30,seed=1]": {"doc": "Thirty hard discs."},
    "sliding": {
        "doc": "The talk's sliding example.",
        "n": 2,
        "families": "1 surface",
        "reference": "exact",
    },
    "repulsive": {"doc": "Not unique.", "n": 2, "reference": "none"},
}
ENV = {
    "python": "3.11.2",
    "versions": {"numpy": "2.1"},
    "machine": "two cores",
    "cores": 2,
    "load": [0.1, 0.2, 0.3],
    "argv": [],
}


def row(case, solver, h, accuracy="h", **more):
    return {
        "case": case,
        "solver": solver,
        "accuracy": accuracy,
        "asked": h * 1.01,
        "h": h,
        "status": "ok",
        "why": "",
        "loop": METHODS[solver][3] if solver in METHODS else "compiled",
        "reference": "exact",
        "multipliers_unique": True,
        "state_floor": 0.0,
        "impulse_floor": 0.0,
        **more,
    }


def ladder(case, solver, rng, plateau=0.0, unique=True, exact=False, steps=STEPS):
    """Rows of one fixed-step method: a clean power law with 2 % of noise, or a plateau, or zeros
    and rounding."""
    p, c, cost, _ = METHODS[solver]
    out = []
    for h in steps:
        noise = lambda: float(np.exp(0.02 * rng.standard_normal()))
        state = rng.choice([0.0, 2e-16]) if exact else (plateau + c * h**p) * noise()
        n = round(3.0 / h)
        qp = solver == "catching_up"
        out.append(
            row(
                case,
                solver,
                float(h),
                "k" if solver == "penalty" else "h",
                seconds=cost * n * noise(),
                steps=n,
                drift_calls=n,
                projections=0 if qp else 3 * n,
                inner_iterations=9 * n if qp else 0,
                qp_solves=n if qp else 0,
                state_sup=float(state),
                state_T=float(state) / 2,
                impulse=0.7 * c * h * noise() if unique else 0.4,
                reaction=0.9 * c * h * noise(),
                settled=2 * c * h * noise(),
                feasibility=float(0.0 if exact else 0.3 * c * h * noise()),
                selection=None if unique else 0.4,
                multipliers_unique=unique,
                reference="exact",
            )
        )
    return out


def made(seed=0):
    """Rows of several cases: orders, exactness, a plateau, redundant contacts, refusals, failures,
    NaN and zeros."""
    rng = np.random.default_rng(seed)
    rows = []
    for case in CASES:
        for solver in METHODS:
            if case == "repulsive":
                rows += [
                    row(
                        case,
                        solver,
                        float(h),
                        state_sup=None,
                        residual=1e-9,
                        reference="none",
                        seconds=1e-3,
                        multipliers_unique=None,
                    )
                    for h in STEPS[:4]
                ]
            elif solver == "event_driven":
                if case.startswith("hex"):
                    rows.append(
                        row(
                            case,
                            solver,
                            1e-9,
                            "tol",
                            status="chatter",
                            why="More than 1e4 events at t = 0.4.",
                        )
                    )
                else:
                    bad = case.startswith("discs")
                    rows += [
                        row(
                            case,
                            solver,
                            tol,
                            "tol",
                            state_sup=(1e3 if bad else 0.1) * tol,
                            impulse=tol,
                            events=12,
                            event_time=tol / 7,
                            feasibility=1e-16,
                            seconds=0.3 - 0.02 * np.log10(tol),
                        )
                        for tol in (1e-6, 1e-9, 1e-11 if not bad else 1e-10)
                    ]
            elif case == "sliding" and solver != "implicit_euler":
                rows.append(
                    row(
                        case,
                        solver,
                        np.nan,
                        status="refused",
                        loop="",
                        seconds=None,
                        why=f"{solver} needs constraints to project on; this case is a Filippov "
                        f"system.",
                    )
                )
            else:
                rows += ladder(
                    case,
                    solver,
                    rng,
                    plateau=3e-3 if (case, solver) == ("discs[n=30,seed=0]", "penalty") else 0.0,
                    unique=not case.startswith("hex"),
                    exact=case in ("apple", "sliding"),
                )
    for r in rows:
        if r["case"].startswith("discs") and r["solver"] == "pbd[order=reverse]" and r["h"] > 0.02:
            r.update(
                status="diverged",
                why=f"The state left all bounds at t = {3 * r['h']:.3g}.",
                state_sup=np.nan,
                impulse=np.nan,
                reaction=np.nan,
                feasibility=np.nan,
            )
    return rows


def summaries(rows, solvers=None):
    return summary.summarise(
        data.build(data.columns_of(rows), solvers=SOLVERS if solvers is None else solvers)
    )
