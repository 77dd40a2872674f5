"""Size of a case, also before it is built: states, contacts and memory of one run.

The size of a case with a giant parameter is extrapolated from two small cases of its kind: every
size is taken to grow like a power of the parameter.
"""

from __future__ import annotations

import inspect
import math
import tracemalloc
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case, case_module, get_case, parse_spec
from nsbench.problem import Affine, Complementarity, Distance

# From this integer value on, a size is predicted before the case is built, which may take long
LARGE_PARAMETER = 20_000
# Pairs of small values to build it with; the first pair that the case accepts is taken
TRIAL_VALUES = ((128, 256), (100, 200), (50, 100), (10, 20), (4, 8))
# Most contacts per particle for equal particles, by dimension: half the kissing number
CONTACTS_PER_PARTICLE = {1: 1, 2: 3, 3: 6}
# Arrays of (samples, states) and (samples, contacts) that a run and its measures hold, fitted to
# peaks of resident memory of hard discs in a full box, 6 000 to 60 000 states: within 1.3 of each
ARRAYS_OF_STATES = 12
ARRAYS_OF_CONTACTS = 12
LIBRARY_BYTES = 190 << 20  # Python with numpy, scipy and compiled kernels


@dataclass(frozen=True)
class Size:
    """Count what a run of a case holds.

    states n; sample times; contacts that can act at once (at most); hard particles; build_bytes:
    peak memory of building the case and calling its drift once (0: not measured).
    """

    states: float
    samples: float
    contacts: float
    particles: float
    build_bytes: float = 0.0

    @property
    def pairs(self) -> float:
        """Return the number of pairs of hard particles."""
        return self.particles * (self.particles - 1) / 2 if self.particles > 1 else 0.0

    @property
    def memory(self) -> float:
        """Return the predicted peak memory of one run with its measures, in bytes."""
        arrays = ARRAYS_OF_STATES * self.states + ARRAYS_OF_CONTACTS * self.contacts
        return LIBRARY_BYTES + max(self.build_bytes, 8.0 * self.samples * arrays)

    def __str__(self) -> str:
        hard = f"{number(self.pairs)} pairs of particles, " if self.pairs else ""
        return (
            f"{number(self.states)} states, {hard}at most {number(self.contacts)} contacts at "
            f"once, {memory(self.memory)} of memory for one run"
        )


def size_of(case: Case) -> Size:
    """Return the size of a case that has been built."""
    contacts = particles = 0.0
    families = case.problem.constraints if isinstance(case.problem, Complementarity) else ()
    for c in families:
        if isinstance(c, Distance) and c.all_pairs:
            m = c.particles(case.n)
            particles += m
            contacts += min(m * (m - 1) / 2, m * CONTACTS_PER_PARTICLE.get(c.dim, 6))
        elif isinstance(c, Affine):
            contacts += c.shape[0]
        elif isinstance(c, Distance):
            contacts += sum(0 if v is None or callable(v) else len(v) for v in (c.pairs, c.anchors))
    return Size(float(case.n), float(len(case.t)), contacts, particles)


def predicted_size(text: str) -> Size | None:
    """Predict the size of the case that a spec such as ``discs[n=1000000000]`` would build.

    None if no parameter is large, or if no pair of small values is accepted. A size that grows
    from low to high between the values v / 2 and v grows like value^p with p = log2(high / low).
    """
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
        and LARGE_PARAMETER <= v < math.inf
    }
    if not large:
        return None
    sizes = None
    for k, value in large.items():
        trial = _two_small_sizes(name, params | dict.fromkeys(large, TRIAL_VALUES[1][0]), k)
        if trial is None:
            return None
        low, high, at = trial
        power = np.log2(np.maximum(high, 1e-300) / np.maximum(low, 1e-300))
        growth = (value / at) ** np.maximum(power, 0.0)
        sizes = high * growth if sizes is None else sizes * growth
    return None if sizes is None else Size(*map(float, sizes))


def _two_small_sizes(name, params, k):
    """Measure the sizes for two small values of parameter k, the second twice the first.

    Returns both sizes and the second value; None if the case accepts no pair.
    """
    for small in TRIAL_VALUES:
        try:
            low, high = (_measured_size(name, params | {k: v}) for v in small)
        except (ValueError, LookupError):
            continue
        return low, high, small[1]
    return None


def _measured_size(name, params):
    """Build a small case; return its size as an array, with the peak of traced memory."""
    tracemalloc.start()
    try:
        s = size_of(get_case(name, **params))
        return np.array(
            [s.states, s.samples, s.contacts, s.particles, tracemalloc.get_traced_memory()[1]]
        )
    finally:
        tracemalloc.stop()


def number(v: float) -> str:
    """Format a count: 12 345 below a million, else 1.23e+06."""
    return f"{v:,.0f}".replace(",", " ") if v < 1e6 else f"{v:.3g}"


def memory(size: float) -> str:
    """Format a number of bytes, such as 1.5 GiB."""
    for unit, power in (("TiB", 40), ("GiB", 30)):
        if size >= 1 << power:
            return f"{size / (1 << power):,.1f} {unit}".replace(",", " ")
    return f"{size / (1 << 20):.0f} MiB"
