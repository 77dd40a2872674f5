"""Random units: twenty cases with units of length, time and switches drawn over thirty decades.

    python tests/studies/random_units.py [--draws 5] [--seed 1] [--cases NAME ...]

Ten cases of the catalogue and ten of this study, each run by event_driven at its default tolerance
in units that are drawn log-uniformly in 1e-15 .. 1e15: time, length (one for each coordinate where
coordinates have units of their own), switches. The truth is that of the unscaled case: closed form,
stored reference, or arcs solved with 28 digits (tests/support/joined_arcs.py). A run is right if no
coordinate is wrong by more than 1e-10 of its largest value; a run whose status is not ok is honest;
one that is ok and wrong is a silent one, and makes the exit status 1.
"""

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from changed_cases import run, units  # noqa: E402
from interpreted_physics import patch_pointers  # noqa: E402
from joined_arcs import contacts, diode, filippov  # noqa: E402

from nsbench import LCS, Case, Complementarity, Distance, Filippov  # noqa: E402
from nsbench.case import get_case  # noqa: E402
from nsbench.reference.lookup import reference  # noqa: E402

CATALOGUE = (
    "apple_filippov",
    "tide",
    "bean",
    "slide_exit",
    "friction",
    "circle_sliding",
    "two_surfaces",
    "stick_slip",
    "rlc_diode",
    "three_discs",
)
RIGHT = 1e-10  # of the largest value of a coordinate
DECADES = 15.0  # on both sides of one


def threshold_field(xp):
    return lambda t, x, s: xp.stack((1.0 - (1.0 + s[0]) / 4.0 - (1.0 + s[1]) / 5.0,))


def thresholds(xp):
    return lambda t, x: xp.stack((x[0] - 1.0, x[0] - 1.2))


def relay_field(xp):
    return lambda t, x, s: xp.stack((1.5 * xp.sin(t) - s[0],))


def relay_switch(xp):
    return lambda t, x: xp.stack((x[0] + 0.0,))


def coupled_field(xp):
    return lambda t, x, s: xp.stack((x[1] - 0.3 * s[0], xp.cos(2.0 * t) - x[0] - 0.8 * s[0]))


def coupled_switch(xp):
    return lambda t, x: xp.stack((x[1] + 0.4 * x[0],))


def belt_field(xp):
    return lambda t, x, s: xp.stack((x[1] + 0.0, 0.9 * xp.cos(1.3 * t) - x[0] - 0.7 * s[0]))


def belt_switch(xp):
    return lambda t, x: xp.stack((x[1] - 0.2,))


def two_field(xp):
    return lambda t, x, s: xp.stack(
        (1.2 * xp.cos(3.0 * t) - s[0], 0.3 * x[0] + 0.7 * xp.sin(2.0 * t) - 0.6 * s[1])
    )


def two_switch(xp):
    return lambda t, x: xp.stack((x[0] + 0.0, x[1] + 2.0))


def pushed(xp):
    return lambda t, x: xp.stack((-xp.cos(t) - 0.2 * x[0],))


def moving_floor(xp):
    return lambda t: xp.stack((-0.1 * xp.sin(3.0 * t),))


def turning(xp):
    return lambda t, x: xp.stack((xp.cos(1.7 * t) - 0.3 * x[0], xp.sin(1.7 * t) - 0.3 * x[1]))


def corner(xp):
    return lambda t: xp.stack((0.3 + 0.0 * t, 0.1 + 0.0 * t))


def drawn_beads(xp):
    return lambda t, x: xp.stack((xp.cos(t) - x[0], 0.8 + 0.6 * xp.sin(2.0 * t) - 2.0 * x[1]))


def spacing(xp):
    return lambda t: xp.stack((-0.3 + 0.0 * t, 0.2 + 0.05 * xp.cos(t)))


def feed(xp):
    return lambda t: xp.stack((0.5 * xp.cos(2.0 * t), 0.0 * t))


def voltage(xp):
    return lambda t: xp.stack((-xp.sin(2.0 * t),))


def charge(xp):
    return lambda t: xp.stack((0.3 - 0.4 * xp.sin(3.0 * t),))


OWN = (
    filippov("thresholds", threshold_field, thresholds, [0.0], 3.0),
    filippov("driven", relay_field, relay_switch, [0.3], 4.0),
    filippov("coupled", coupled_field, coupled_switch, [0.7, 0.5], 4.0),
    filippov("belt", belt_field, belt_switch, [0.3, -0.3], 8.0),
    filippov("two_relays", two_field, two_switch, [0.5, -1.4], 4.0),
    contacts("floor", pushed, [[1.0]], moving_floor, [0.5], 5.0),
    contacts("corner", turning, [[1.0, 0.3], [0.2, 1.0]], corner, [0.1, 0.2], 6.0),
    contacts("beads", drawn_beads, [[-1.0, 1.0], [1.0, 0.0]], spacing, [0.0, 0.9], 6.0),
    diode("rectifier", [[-0.5]], [1.0], [1.0], 0.2, None, voltage, [0.1], 6.0),
    diode(
        "circuit", [[0.0, -1.0], [1.0, 0.0]], [-1.0, 0.2], [-1.0, 0.1], 0.4, feed, charge,
        [-0.3, 0.5], 6.0,
    ),
)  # fmt: skip


def truths() -> dict[str, tuple[Case, np.ndarray]]:
    """Return (case, truth (k, n)) by name, of the catalogue and of the cases of the study."""
    out = {name: (get_case(name), reference(get_case(name)).x) for name in CATALOGUE}
    return out | {made.case.name: (made.case, made.truth()) for made in OWN}


def drawn_units(case, rng: np.random.Generator) -> dict:
    """Draw the arguments of changed_cases.units: as many units as the class of the case has."""
    many = case.n if isinstance(case.problem, (Filippov, LCS)) else 1
    out = {
        "time": 10.0 ** rng.uniform(-DECADES, DECADES),
        "length": 10.0 ** rng.uniform(-DECADES, DECADES, size=many),
    }
    fixed = isinstance(case.problem, LCS) or (
        isinstance(case.problem, Complementarity)
        and any(isinstance(c, Distance) for c in case.problem.constraints)
    )
    return out if fixed else out | {"gap": 10.0 ** rng.uniform(-DECADES, DECADES)}


def outcome(case, truth: np.ndarray, drawn: dict) -> tuple[str, float]:
    """Run the case in the drawn units: "right", "honest" or "silent", and its error."""
    changed = units(case, **drawn)
    try:
        found = run(changed.case, "event_driven")
    except Exception as e:
        return f"raised {type(e).__name__}: {e}", np.nan
    size = np.abs(truth).max(axis=0)
    size = np.where(size > 0.0, size, size.max() or 1.0)
    if isinstance(case.problem, Complementarity):
        size = np.full(case.n, size.max())
    error = float((np.abs(changed.back(found.x) - truth) / size).max())
    if not found.status.ok:
        return f"honest: {found.status}", error
    return ("right" if error <= RIGHT else "silent"), error


def main() -> int:
    """Run the study; print what is not right, then counts."""
    p = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    p.add_argument("--draws", type=int, default=5, help="units of each case")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--cases", nargs="*", help="only these")
    args = p.parse_args()
    warnings.simplefilter("ignore")
    counts: dict[str, int] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch_pointers(patch)
        for number, (name, (case, truth)) in enumerate(truths().items()):
            if args.cases and name not in args.cases:
                continue
            rng = np.random.default_rng((args.seed, number))
            worst = 0.0
            for drawn in [{}, *(drawn_units(case, rng) for _ in range(args.draws))]:
                said, error = outcome(case, truth, drawn)
                word = said.split(":")[0].split()[0]
                counts[word] = counts.get(word, 0) + 1
                worst = max(worst, error if word == "right" else 0.0)
                if word != "right":
                    print(f"{name} {drawn or 'as it is'}: {said} (error {error:.2g})", flush=True)
            print(f"{name}: right to {worst:.1e}", file=sys.stderr, flush=True)
    print(f"{sum(counts.values())} runs: " + ", ".join(f"{v} {k}" for k, v in counts.items()))
    return 1 if counts.keys() & {"silent", "raised"} else 0


if __name__ == "__main__":
    sys.exit(main())
