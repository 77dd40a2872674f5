"""Synthetic ladders of errors with known truth, for the estimator of orders. No estimator is
imported here.

A family makes one `Ladder` from a random generator: steps, errors, what the caller would know
(keyword arguments of `fit_order`), and the truth. Orders p are drawn from 0.5 to 5, levels of noise
from 1 to 30 %; steps either at irrational ratios (4 per octave and more) or as a study takes them:
whole divisors of a spacing, 19 per 6 octaves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

ORDERS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
NOISE = (0.01, 0.03, 0.1, 0.2, 0.3)  # standard deviation of log err


@dataclass(frozen=True)
class Ladder:
    """h, err (k,); kind: order (p is the limit of the slope), plateau (C the limit), diverges,
    exact or open (nothing can be known from these points); known: keyword arguments for the
    estimator; note: the level within the family."""

    h: np.ndarray
    err: np.ndarray
    kind: str
    p: float = np.nan
    C: float = np.nan
    known: dict = field(default_factory=dict)
    note: str = ""


def steps(rng, octaves: float | None = None, top: float = 0.1) -> np.ndarray:
    """Steps as a person or a study would choose them, never dyadic."""
    octaves = octaves or rng.choice([6.3, 6.5, 8.0])
    if rng.random() < 0.5:
        return top * 2.0 ** -np.linspace(0.0, octaves, int(rng.choice([4, 8]) * octaves) + 1)
    first = int(rng.integers(1, 4))
    out = []
    ratio = 2.0 ** (octaves / 18) * 1.003
    out = [first]
    while out[-1] < first * 2**octaves or len(out) < 19:
        out.append(max(out[-1] + 1, round(out[-1] * ratio)))
    return top / np.array(out, float)


def white(rng, n, sigma):
    return sigma * rng.normal(size=n)


def power(rng, make=white, sigma=None, p=None) -> Ladder:
    """M h^p with M of 1 to 1000; the finest errors of the highest orders lie below rounding."""
    h = steps(rng)
    p = p or rng.choice(ORDERS)
    sigma = sigma or rng.choice(NOISE)
    return Ladder(
        h,
        10.0 ** rng.uniform(0, 3) * h**p * np.exp(make(rng, len(h), sigma)),
        "order",
        p,
        note=f"noise {sigma:g}",
    )


def heavy(rng, n, sigma):
    return sigma / np.sqrt(3.0) * rng.standard_t(3, size=n)  # same standard deviation as `white`


def correlated(rng, n, sigma):
    """First-order autoregression from step to step, correlation 0.5."""
    e = rng.normal(size=n)
    for k in range(1, n):
        e[k] = 0.5 * e[k - 1] + np.sqrt(0.75) * e[k]
    return sigma * e


def outlier(rng) -> Ladder:
    """One error is wrong by a factor of 20 to 1000, either way."""
    base = power(rng, sigma=rng.choice(NOISE[:4]))
    err = base.err.copy()
    err[rng.integers(len(err))] *= 10.0 ** (rng.choice([-1, 1]) * rng.uniform(1.3, 3))
    return Ladder(base.h, err, "order", base.p, note=base.note)


def swell(rng) -> Ladder:
    """1 + a sin(w log h): a phase that turns with the logarithm of the step, 0.4 to 2 octaves a
    turn."""
    base = power(rng, sigma=rng.choice(NOISE[:3]))
    w = 2 * np.pi / (rng.uniform(0.4, 2.0) * np.log(2.0))
    a = rng.uniform(0.1, 0.7)
    return Ladder(
        base.h, base.err * (1 + a * np.sin(w * np.log(base.h) + rng.uniform(0, 7))), "order", base.p
    )


def beat(rng) -> Ladder:
    """The phase of an event within its step: frac, |sin| or 1.2 + sin of (a + b / h)."""
    h = steps(rng)
    p = rng.choice([0.5, 1.0, 2.0])
    turn = rng.uniform() + rng.uniform(1, 3) / (h * rng.uniform(0.9, 1.1))
    kind = rng.choice(["frac", "sine", "swell"])
    shape = {
        "frac": turn % 1.0,
        "sine": np.abs(np.sin(np.pi * turn)),
        "swell": 1.2 + np.sin(np.pi * turn),
    }[kind]
    return Ladder(h, h**p * (shape + 1e-6), "order", p, note=str(kind))


def head(rng, gaps=(1.0,), sign=1.0) -> Ladder:
    """h^p + a h^(p + q): the second term reaches 0.3 to 10 times the first at the coarsest step."""
    h = steps(rng)
    p = rng.choice([0.5, 1.0, 1.5, 2.0, 3.0])
    q = rng.choice(gaps)
    sigma = rng.choice([0.001, *NOISE[:4]])
    at = 10.0 ** rng.uniform(-0.5, 1.0)
    shape = np.abs(1 + sign * at * (h / h.max()) ** q)
    return Ladder(
        h, h**p * shape * np.exp(white(rng, len(h), sigma)), "order", p, note=f"noise {sigma:g}"
    )


def saturated(rng) -> Ladder:
    """h^p / (1 + h / c)^q: flatter at coarse steps, as where no event is resolved yet or h^(1/2)
    comes before h."""
    h = steps(rng)
    p = rng.choice([1.0, 2.0])
    q = p * rng.choice([0.5, 1.0])
    sigma = rng.choice([0.001, *NOISE[:4]])
    shape = (1 + 10.0 ** rng.uniform(-0.5, 1.0) * h / h.max()) ** -q
    return Ladder(
        h, h**p * shape * np.exp(white(rng, len(h), sigma)), "order", p, note=f"noise {sigma:g}"
    )


def rounded(rng) -> Ladder:
    """h^p that meets rounding: additions that go astray like eps / h, and 1e-13 from roots."""
    h = steps(rng, top=0.4)
    p = rng.choice([3.0, 4.0, 5.0])
    astray = (2e-16 / h + 1e-13) * rng.uniform(-1, 1, len(h))
    M = 10.0 ** rng.uniform(-3.0, -1.0)
    sigma = rng.choice(NOISE[:3])
    return Ladder(h, np.abs(M * h**p * np.exp(white(rng, len(h), sigma)) + astray), "order", p)


def referred(rng) -> Ladder:
    """h^p against a reference that is off by up to a known bound, in one direction."""
    h = steps(rng)
    p = rng.choice([1.0, 2.0, 3.0])
    sigma = rng.choice(NOISE[:4])
    bound = float(h.min() ** p * 10.0 ** rng.uniform(-2.5, 0.5))
    err = np.abs(h**p * np.exp(white(rng, len(h), sigma)) + bound * rng.uniform(-1, 1))
    return Ladder(h, err, "order", p, known={"reference_error": bound})


def level(rng, times=None, orders=(0.5, 1.0, 1.5, 2.0, 3.0), noise=NOISE[:4], n=25) -> Ladder:
    """C + M h^p with C a multiple of the smallest M h^p: `times`, or 1 to 30."""
    h = 0.1 * 2.0 ** -np.linspace(0, 6.3, n)
    p = rng.choice(orders)
    sigma = rng.choice(noise)
    times = times or float(rng.choice([1.0, 2.0, 8.0, 30.0]))
    M = 10.0 ** rng.uniform(0, 2)
    C = times * M * h.min() ** p
    return Ladder(
        h,
        (C + M * h**p) * np.exp(white(rng, n, sigma)),
        "plateau",
        p,
        C,
        note=f"{times:g} x, p {p:g}, noise {sigma:g}",
    )


def flat(rng) -> Ladder:
    """No convergence at all."""
    h = steps(rng)
    return Ladder(
        h,
        10.0 ** rng.uniform(-6, 0) * np.exp(white(rng, len(h), rng.choice(NOISE))),
        "plateau",
        0.0,
        1.0,
    )


def hidden(rng) -> Ladder:
    """A floor that nobody told: an iterative solver's tolerance, random from step to step, 3 to 100
    times the rest."""
    h = steps(rng)
    p = rng.choice([1.0, 2.0])
    C = h.min() ** p * 10.0 ** rng.uniform(0.5, 2.0)
    return Ladder(h, np.hypot(h**p, C * rng.uniform(0.5, 1.0, len(h))), "plateau", p, C)


def diverging(rng) -> Ladder:
    """h^-q, clean or noisy, also with a head that converges first."""
    h = steps(rng)
    q = rng.uniform(0.3, 2.0)
    sigma = rng.choice(NOISE)
    late = rng.choice([0.0, 0.0, 1.0]) * 10.0 ** rng.uniform(-1, 0)
    return Ladder(
        h,
        1e-4 * (h**-q + late * h.max() ** -q * (h / h.max())) * np.exp(white(rng, len(h), sigma)),
        "diverges",
        -q,
    )


def dyadic(rng) -> Ladder:
    """How deep explicit Euler falls past a floor, seen at h = c 2^-k alone: the same phase at every
    step, or nearly."""
    h = rng.uniform(0.5, 1.0) * 2.0 ** -np.arange(int(rng.integers(7, 20)))
    fall = rng.choice([1.0, rng.uniform(0.5, 2.0)])
    return Ladder(h, h * np.ceil(fall / h) - fall, "open", 1.0)


def short(rng) -> Ladder:
    """Three octaves, or five points, of a power law or a plateau."""
    base = power(rng) if rng.random() < 0.5 else level(rng)
    h = base.h
    err = base.err
    keep = (
        h <= 8 * h.min()
        if rng.random() < 0.5
        else np.isin(np.arange(len(h)), rng.choice(len(h), 5, replace=False))
    )
    return Ladder(h[keep], err[keep], "open", base.p)


def exact(rng) -> Ladder:
    """Rounding at every step, or zero at all."""
    h = steps(rng)
    how = rng.integers(3)
    err = (0.0 * h, 1e-13 * rng.uniform(size=len(h)), 1e-16 / h * rng.uniform(size=len(h)))[how]
    return Ladder(h, err, "exact")


def sometimes(rng) -> Ladder:
    """Exact at some steps, of order one at the others (explicit Euler on a sliding mode); a fifth
    to four fifths exact."""
    h = steps(rng)
    err = h * rng.uniform(0.3, 1.0, len(h))
    lucky = rng.random(len(h)) < rng.uniform(0.2, 0.8)
    err[lucky] = 1e-15 * rng.integers(0, 100, lucky.sum())
    return Ladder(h, err, "open", 1.0)


def torn(rng) -> Ladder:
    """A power law with rows that failed: NaN, inf, zero or repeated steps."""
    base = power(rng, sigma=rng.choice(NOISE[:4]))
    h = base.h.copy()
    err = base.err.copy()
    for bad in (np.nan, np.inf, 0.0):
        err[rng.integers(len(err))] = bad
    twin = int(rng.integers(len(h)))
    return Ladder(np.append(h, h[twin]), np.append(err, err[twin]), "order", base.p, note=base.note)


# share: of the ladders of a study. fair: the interval's assumptions hold (independent scatter about
# a power law with at most one further power), so that the coverage itself is promised and not only
# that no wrong order is told.
FAMILIES: dict[str, tuple[Callable, int, bool]] = {
    "power": (power, 14, True),
    "head q=1": (head, 8, True),
    "heavy tails": (lambda rng: power(rng, heavy), 5, True),
    "outlier": (outlier, 4, True),
    "failed rows": (torn, 3, True),
    "rounding floor": (rounded, 4, True),
    "reference floor": (referred, 4, True),
    "correlated": (lambda rng: power(rng, correlated), 4, False),
    "swell": (swell, 4, False),
    "beat": (beat, 4, False),
    "head q=1/2, 2, 3": (lambda rng: head(rng, (0.5, 2.0, 3.0)), 5, False),
    "head of other sign": (lambda rng: head(rng, sign=-1.0), 4, False),
    "saturated head": (saturated, 4, False),
    "plateau 4x": (lambda rng: level(rng, 4.0, (1.0, 1.5, 2.0, 3.0), NOISE[:3]), 7, True),
    "plateau 4x, p=1/2": (lambda rng: level(rng, 4.0, (0.5,), NOISE[:3]), 3, True),
    "plateau 2x": (lambda rng: level(rng, 2.0), 3, True),
    "plateau 1 to 30x": (level, 4, True),
    "flat": (flat, 3, True),
    "hidden floor": (hidden, 3, True),
    "diverging": (diverging, 4, True),
    "dyadic": (dyadic, 3, True),
    "short": (short, 2, True),
    "exact": (exact, 2, True),
    "sometimes exact": (sometimes, 2, True),
}


def ladders(n: int, seed: int, families=tuple(FAMILIES)):
    """(family, Ladder) n times in all, in the shares of FAMILIES; each family has a stream of its
    own."""
    total = sum(FAMILIES[f][1] for f in families)
    for k, name in enumerate(FAMILIES):
        if name in families:
            make, share, _ = FAMILIES[name]
            rng = np.random.default_rng([seed, k])
            for _ in range(max(1, round(n * share / total))):
                yield name, make(rng)
