"""Truths computed anew, by an integrator of their own (extrapolated midpoint rule at 45 digits),
against the stored ones.

    python tests/independent/recompute.py NAME ...     (or --all; needs mpmath)

One line each: seconds, largest differences of states, impulses and reactions relative to max(1,
size), and of event times.
Exit status 1 if one differs by more than the stored digits.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

import numpy as np
from engine import SYSTEMS
from mpmath import mpf
from truths import case, truth

DIGITS = 2.0**-52  # of a stored state
TIME_DIGITS = mpf(10) ** -19  # of a stored time: 20 digits

for _path in sorted((Path(__file__).parent / "systems").glob("*.py")):
    importlib.import_module(f"systems.{_path.stem}")


def apart(exact, stored) -> float:
    """Largest difference of exact rows from stored ones, relative to max(1, size)."""
    rows = zip(exact, stored, strict=True)
    return float(
        max(
            (
                abs(a - mpf(float(b))) / max(1, abs(a))
                for r, s in rows
                for a, b in zip(r, s, strict=True)
            ),
            default=0,
        )
    )


def differences(name: str) -> tuple[float, float]:
    """(of values, of event times) between the truth computed now and the stored one; infinite if
    events differ in kind."""
    new = SYSTEMS[name].path()
    old = truth(name)
    system = SYSTEMS[name]
    weights = (
        None
        if system.weights is None
        else np.array(system.weights, float).reshape(-1, len(new.ids))
    )
    same = (
        np.array_equal(np.array(new.t, float), case(name).t)
        and tuple(new.ids) == old.ids
        and [e[1:] for e in new.events] == [e[1:] for e in old.events]
        and (system.events, system.optional) == (old.unique, old.optional)
        and (weights is None) == (old.weights is None)
        and (weights is None or np.array_equal(weights, old.weights))
    )
    if not same:
        return float("inf"), float("inf")
    pairs = [(new.x, old.x), (new.impulse, old.impulse)] + (
        [] if old.reaction is None else [(new.reaction, old.reaction)]
    )
    times = [
        abs(a[0] - mpf(b[0])) / max(1, abs(a[0]))
        for a, b in zip(new.events, old.events, strict=True)
    ]
    return max(apart(a, b) for a, b in pairs), float(max(times, default=0))


def main(argv=None) -> int:
    """Number of truths that differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--all", action="store_true")
    o = parser.parse_args(argv)
    if unknown := sorted(set(o.names) - set(SYSTEMS)):
        parser.error(f"no system {', '.join(unknown)}; there are {', '.join(sorted(SYSTEMS))}")
    wrong = 0
    for name in sorted(SYSTEMS) if o.all else o.names:
        start = time.perf_counter()
        values, times = differences(name)
        good = values <= DIGITS and times <= TIME_DIGITS
        wrong += not good
        seconds = time.perf_counter() - start
        print(
            f"{name:18s} {seconds:7.1f} s {values:9.1e} {times:9.1e}{'' if good else '  DIFFERS'}",
            flush=True,
        )
    return wrong


if __name__ == "__main__":
    sys.exit(1 if main() else 0)
