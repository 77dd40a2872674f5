"""How large a case is, and how large one would be that has not been made: states, contacts, memory
of one run.

A case with a giant parameter is foreseen from two small ones of its kind: every size grows like a
power of the parameter.
"""

from __future__ import annotations

import inspect
import math
import tracemalloc
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case, case_module, get_case, parse_spec
from nsbench.problem import Affine, Complementarity, Distance

LARGE = 20_000  # a whole number from here on is foreseen before the case is made, which takes long
SMALL = (
    (128, 256),
    (100, 200),
    (50, 100),
    (10, 20),
    (4, 8),
)  # values to make it with; the first pair that it takes
TOUCHING = {
    1: 1,
    2: 3,
    3: 6,
}  # contacts per particle at most, of equal ones: half of how many can touch one
# Arrays of (samples, states) and (samples, contacts) that a run and its measuring hold, fitted to
# peaks of resident memory of hard discs in a full box, 6 000 to 60 000 states: within 1.3 of each
STATES = 12
CONTACTS = 12
LIBRARIES = 190 << 20  # bytes: Python with numpy, scipy and compiled kernels


@dataclass(frozen=True)
class Size:
    """states n, sample times, contacts that can act at once (at most), hard particles; making:
    bytes at the peak of making the case and calling its drift once (0: not measured)."""

    states: float
    samples: float
    contacts: float
    particles: float
    making: float = 0.0

    @property
    def pairs(self) -> float:
        return self.particles * (self.particles - 1) / 2 if self.particles > 1 else 0.0

    @property
    def memory(self) -> float:
        """Bytes that one run is foreseen to need at its peak, with its measuring."""
        return LIBRARIES + max(
            self.making, 8.0 * self.samples * (STATES * self.states + CONTACTS * self.contacts)
        )

    def __str__(self) -> str:
        hard = f"{number(self.pairs)} pairs of particles, " if self.pairs else ""
        return (
            f"{number(self.states)} states, {hard}at most {number(self.contacts)} contacts at "
            f"once, "
            f"{memory(self.memory)} of memory for one run"
        )


def size_of(case: Case) -> Size:
    """Of a case that has been made."""
    contacts = particles = 0.0
    families = case.problem.constraints if isinstance(case.problem, Complementarity) else ()
    for c in families:
        if isinstance(c, Distance) and c.all_pairs:
            m = c.particles(case.n)
            particles += m
            contacts += min(m * (m - 1) / 2, m * TOUCHING.get(c.dim, 6))
        elif isinstance(c, Affine):
            contacts += c.shape[0]
        elif isinstance(c, Distance):
            contacts += sum(0 if v is None or callable(v) else len(v) for v in (c.pairs, c.anchors))
    return Size(float(case.n), float(len(case.t)), contacts, particles)


def foreseen(text: str) -> Size | None:
    """Of the case that ``discs[n=1000000000]`` would make; None where no parameter is large, or
    nothing can be said."""
    name, params = parse_spec(text)
    make = getattr(case_module(name), "make", None)
    if make is None:
        return None
    defaults = {k: p.default for k, p in inspect.signature(make).parameters.items()}
    large = {
        k: float(v)
        for k, v in params.items()
        if isinstance(v, (int, float))
        and not isinstance(v, bool)
        and type(defaults.get(k)) is int
        and LARGE <= v < math.inf
    }
    if not large:
        return None
    sizes = None
    for k, value in large.items():
        two = _two(name, params | dict.fromkeys(large, SMALL[1][0]), k)
        if two is None:
            return None
        low, high, at = two
        growth = (value / at) ** np.maximum(
            np.log2(np.maximum(high, 1e-300) / np.maximum(low, 1e-300)), 0.0
        )
        sizes = high * growth if sizes is None else sizes * growth
    return Size(*map(float, sizes))


def _two(name, params, k):
    """Sizes for two small values of the parameter, the second one twice the first, and that
    value."""
    for small in SMALL:
        try:
            low, high = (_made(name, params | {k: v}) for v in small)
        except (ValueError, LookupError):
            continue
        return low, high, small[1]
    return None


def _made(name, params):
    tracemalloc.start()
    try:
        s = size_of(get_case(name, **params))
        return np.array(
            [s.states, s.samples, s.contacts, s.particles, tracemalloc.get_traced_memory()[1]]
        )
    finally:
        tracemalloc.stop()


def number(v: float) -> str:
    """A count for people."""
    return f"{v:,.0f}".replace(",", " ") if v < 1e6 else f"{v:.3g}"


def memory(size: float) -> str:
    """Bytes for people, such as 1.5 GiB."""
    for unit, power in (("TiB", 40), ("GiB", 30)):
        if size >= 1 << power:
            return f"{size / (1 << power):,.1f} {unit}".replace(",", " ")
    return f"{size / (1 << 20):.0f} MiB"
