"""Smoothed penalty method: constraints as stiff springs, switches as thin layers.

The resulting smooth system is integrated by the Runge-Kutta methods of diffrax in float64.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.compilation.user_forms.jax_errors import NotTraceable, refusal
from nsbench.dynamics.scaling.scaled_case import scaled_case
from nsbench.problem import LCS, Complementarity, Distance, Filippov, Hybrid
from nsbench.solvers.base import Claims, Expect, Run, check_positive
from nsbench.solvers.common.extrapolation import combined, weights
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.penalty.limits import largest_gradient, limits_of, smallest_switch
from nsbench.solvers.penalty.outcome import EXPLICIT, HIDDEN, build_trajectory
from nsbench.trajectory import Status, Trajectory

IMPLICIT = ("kvaerno3", "kvaerno5")
# by extrapolations: k of an order study, which an explicit method takes in seconds, and where
# layers have died out; default k
LADDERS = ((30.0, 3840.0), (60.0, 7680.0), (30.0, 1920.0))
# k from which kvaerno5 takes less time than tsit5 for few states; 2e4 for 60, as factors cost n^3
STIFF = 2e3
MIN_TOLERANCE = 1e-13  # rounding of 10^5 steps is a tenth of it
DEFAULTS = (1e4, 1e4, 1e3)
UNITS = 10.0  # log2 of the ratio of two units of k: round numbers in scenes of ordinary units
LISTED = 6000  # listed constraints (all but hard pairs) whose impulses are integrated
MEMORY = 1e9  # bytes of samples of one run
MANY = 40  # hard particles up to which all pairs are visited
PAIRS = ("auto", "all", "near")
EXPECTS = (
    Expect(
        ("zeno",), None, None, "no rate is known for a smoothed sign at an accumulation of events"
    ),
    Expect(
        ("infeasible_start",),
        None,
        None,
        "what a method makes of an infeasible start is its meaning, not its error",
    ),
)
LAYERS = tuple(
    Expect(
        (word,),
        "open",
        "open",
        "its error in 1/k is a constant per mode, which extrapolation removes: what is "
        "left are layers that die out, and no power",
    )
    for word in ("exact_at_grid", "constant_force")
)


@dataclass(frozen=True)
class Penalty:
    """x' = f + sum_k lam_k grad g_k with lam_k = k max(-g_k, 0); the error is O(1/k), the stiffness
    O(k). k has the unit 1 / time; of Filippov systems, 1 / unit of the switch. Default and ladder
    are multiples of `accuracy_unit`.

    Filippov systems: the sign of a surface c becomes clip(k c, -1, 1), a layer of half-width eps =
    1/k. Impulses and reaction are integrated as further states. method: explicit "tsit5", "dopri8",
    "bosh3" (about k T / 3 steps), or implicit "kvaerno3", "kvaerno5" (dearer steps and 4 times the
    compile time, but their number grows little with k), or "auto": tsit5 or kvaerno5 by k and the
    number of states, named in stats["integrator"].
    rtol and atol are those of the step control (1e-9, less where extrapolated; atol in the user's
    units where it is given, else times the size of each coordinate, nsbench.Scale), max_steps
    counts refused steps; of an implicit method, whose steps cost ten times as much, a tenth of it
    is taken.

    extrapolate: 1 gives 2 x(2k) - x(k), 2 also x(4k): powers 1/k and 1/k^2 of the error cancel, in
    states, impulses and reaction alike. Between events the error has an expansion in powers of 1/k,
    because an impact is forgotten like exp(-k t) and an event that is crossed at an angle moves
    smoothly with 1/k. So the claim is for samples away from events, many 1/k after each impact;
    where events are dense or grazed it does not hold.

    pairs: "all" pairs of hard particles in every right-hand side, "near" ones (lists with a margin
    of `reach` mean radii, made again when a particle has travelled as far as they allow: same
    forces, other order of sums), or "auto".
    Source: Moreau-Yosida regularisation of a projected system; integrators by Kidger (2021),
    Tsitouras (2011), Prince & Dormand (1981), Bogacki & Shampine (1989), Kvaerno (2004).
    """

    method: str = "tsit5"
    rtol: float | None = None
    atol: float | None = None
    max_steps: int = 1_000_000
    extrapolate: int = 0
    pairs: str = "auto"
    reach: float = 0.3

    accuracy = "k"
    has_error_bars = True

    @property
    def expects(self) -> tuple[Expect, ...]:
        return (*EXPECTS, *LAYERS) if self.extrapolate else EXPECTS

    @property
    def claims(self) -> Claims:
        return Claims(state=1.0 + self.extrapolate, impulse=1.0 + self.extrapolate)

    @property
    def default(self) -> float:
        return DEFAULTS[self.extrapolate]

    @property
    def step_limit(self) -> int:
        """The number of steps that a run may take, refused ones included."""
        return max(1, self.max_steps // 10) if self.method in IMPLICIT else self.max_steps

    @property
    def ladder(self) -> tuple[float, float]:
        """The range of k of an order study."""
        return LADDERS[self.extrapolate]

    def accuracy_unit(self, case: Case) -> float:
        """Return the unit of k that a default and a ladder are stated in, a power of 2^10.

        It is the one nearest to 1 over the time of the run, over that times the squared gradient of
        a constraint, or to 1 over the smallest switch, whose units k has: so a scene in nanoseconds
        or nanometres gets stiffnesses of its own.
        """
        if isinstance(case.problem, Filippov):
            size = smallest_switch(case)
        else:
            size = float(case.t[-1] - case.t[0]) * largest_gradient(case) ** 2
        return 2.0 ** (-UNITS * round(np.log2(size) / UNITS))

    def tolerance(self, name: str, k: float) -> float:
        """Return rtol or atol: as given, or 1e-9; k: in units of `accuracy_unit`.

        Where extrapolated, the largest tolerance that does not hide the claimed error k^-2 or k^-3.
        """
        given = getattr(self, name)
        if given is not None:
            return given
        visible = (
            0.99
            * HIDDEN
            * k ** -(1.0 + self.extrapolate)
            / float(np.abs(weights(self.extrapolate)).sum())
        )
        return float(np.clip(visible, MIN_TOLERANCE, 1e-9)) if self.extrapolate else 1e-9

    def __post_init__(self):
        if self.method not in (*EXPLICIT, *IMPLICIT, "auto"):
            raise ValueError(
                f"method is {self.method!r}; one of {', '.join((*EXPLICIT, *IMPLICIT, 'auto'))}"
            )
        for name in ("rtol", "atol"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name))
        check_positive("reach", self.reach)
        if self.extrapolate not in (0, 1, 2) or isinstance(self.extrapolate, bool):
            raise ValueError(f"extrapolate is {self.extrapolate!r}; 0, 1 or 2 times")
        if self.pairs not in PAIRS:
            raise ValueError(f"pairs is {self.pairs!r}; one of {', '.join(PAIRS)}")
        if not (isinstance(self.max_steps, int) and self.max_steps >= 1):
            raise ValueError(f"max_steps is {self.max_steps!r}; a positive whole number is needed")

    def refuses(self, case: Case) -> str | None:
        p = case.problem
        if isinstance(p, Hybrid):
            return (
                "A penalty smooths a sign or a constraint; a hybrid system has neither: its mode "
                "is a memory that no function of the state replaces. Use event_driven or euler."
            )
        if isinstance(p, LCS):
            return (
                "A penalty needs constraints with gradients or switches; this one is a linear "
                "complementarity system."
            )
        if isinstance(p, Complementarity) and not p.constraints:
            return (
                "A penalty needs constraints; this case has none (only its integrator would "
                "remain)."
            )
        return self._too_many(case)

    def _too_many(self, case: Case) -> str | None:
        from nsbench.solvers.penalty.forces import count

        listed = count(p := case.problem, case.n)
        hard = _hard_particles(p, case.n)
        pairs = sum(N * (N - 1) // 2 for N in hard)
        near = _uses_neighbor_lists(self, case)
        m = listed - pairs if near else listed
        if m > LISTED:
            return (
                f"A penalty integrates an impulse for every listed constraint, here {m}, in every "
                f"stage of every step "
                f"({m * len(case.t) * 8 / 1e6:.0f} MB of samples); at most {LISTED} are taken: "
                f"use pbd or "
                "catching_up."
            )
        size = (m + 2 * case.n + (16 * sum(hard) if near else 0)) * len(case.t) * 8
        if size > MEMORY:
            return (
                f"A penalty would keep samples of {size / 1e9:.1f} GB here; at most "
                f"{MEMORY / 1e9:.0f} GB are taken."
            )
        return None

    def prepare(self, case: Case, k: float) -> Run:
        k = check_positive("k", k)
        if self.method == "auto":
            own = k / self.accuracy_unit(case)
            stiff = own * 2.0**self.extrapolate >= STIFF * (1.0 + (case.n / 20.0) ** 2)
            return replace(self, method="kvaerno5" if stiff else "tsit5").prepare(case, k)
        x0 = _start(case)
        if effect := _rounding_exceeds_layer(case, x0, k * 2.0**self.extrapolate):
            return lambda: _nothing(
                case,
                f"Rounding of the coordinates alone {effect} at k = {k:g}: lower k, or take a "
                "frame in which the state is not so large.",
                "maxiter",
            )
        try:
            march = _march(self, case, x0, k)
        except NotTraceable as e:
            why = refusal(case.key, e)
            return lambda: _nothing(case, why)
        levels = [k * 2.0**level for level in range(self.extrapolate + 1)]

        def at(level: float) -> Trajectory:
            return build_trajectory(self, case, level, k, march(level))

        def run() -> Trajectory:
            runs = [at(level) for level in levels]
            finer = functools.partial(at, 2.0 * levels[-1])
            return combined(runs, 1.0 / k, case, finer) if runs[1:] else runs[0]

        return run


def _rounding_exceeds_layer(case: Case, x0: np.ndarray, k: float) -> str:
    """Describe the effect of rounding the start on springs or layers, if it is more than they are.

    That is, if it makes forces larger than the drift, or changes a switch by more than its layer;
    else "".
    """
    rounded = np.spacing(np.abs(x0))
    p = case.problem
    with np.errstate(all="ignore"):
        if isinstance(p, Complementarity):
            from nsbench.dynamics.contacts.constraint_set import ConstraintSet

            scene = ConstraintSet(p, case.n)
            held = np.zeros(case.n, bool)
            for _, c, m in scene.hard:
                held[c.start : c.start + m * c.dim] = True
            held[scene.gradient_entries(float(case.t[0]), x0, scene.all_static())[1]] = True
            force = k * float((rounded * held).max(initial=0.0))
            speed = float(np.abs(as_numpy(p.drift)(float(case.t[0]), x0.copy())).max(initial=0.0))
            own = scaled_case(case)
            large = force > max(own.length / own.time, speed)
            return f"makes forces of {force:.2g}" if large else ""
        switch = as_numpy(p.switch)
        sides = np.where(np.arange(case.n) % 2, 1.0, -1.0)
        c = lambda x: np.asarray(switch(float(case.t[0]), x), float)
        moved = np.max([np.abs(c(x0 + rounded * s) - c(x0.copy())) for s in (1.0, sides)])
        return f"changes a switch by {moved:.2g}, beyond its layer," if k * moved > 1.0 else ""


def _hard_particles(problem, n: int) -> list[int]:
    """Return the number of particles of each family of hard particles."""
    return [
        c.particles(n)
        for c in getattr(problem, "constraints", ())
        if isinstance(c, Distance) and c.all_pairs
    ]


def _uses_neighbor_lists(penalty: Penalty, case: Case) -> bool:
    most = max(_hard_particles(case.problem, case.n), default=0)
    return most > 1 and (penalty.pairs == "near" or (penalty.pairs == "auto" and most > MANY))


def _march(penalty: Penalty, case: Case, x0: np.ndarray, asked: float):
    """Return k -> samples and counts of a run, by the compiled program. Raises NotTraceable."""
    from nsbench.solvers.penalty.program import compiled

    limits = limits_of(penalty, case, asked)
    if _uses_neighbor_lists(penalty, case):
        from nsbench.solvers.penalty.neighbor_segments import NeighborSegments

        segments = NeighborSegments(case, x0, penalty.method, penalty.reach)
        return lambda k: segments.run(k, limits)
    program = compiled(case.problem, case.n, len(case.t), penalty.method, "pairs")
    n = case.n
    z0 = np.concatenate([x0, np.zeros(program.size)])
    forces = isinstance(case.problem, Complementarity)

    atol = limits.absolute(program.size)

    def march(k: float) -> dict:
        first = limits.first_step(case, k)
        arguments = (limits.rtol, atol, limits.steps, ())
        out = program(z0, 1, case.t[0], first, case.t, k, *arguments)
        z = out.pop("samples")
        way = out.pop("way")
        way = way[np.isfinite(way).all(axis=1)]
        between = (
            None if forces else (way[:, 0], way[:, 1 : 1 + n], way[:, 1 + n + program.columns])
        )
        return out | {
            "x": z[:, :n].copy(),
            "impulse": z[:, n + program.columns],
            "ids": program.ids,
            "between": between,
            "reaction": z[:, -n:].copy() if forces else np.empty((len(z), 0)),
        }

    return march


def _start(case: Case) -> np.ndarray:
    if not isinstance(case.problem, Complementarity):
        return case.x0.copy()
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    return initial_state(case, ConstraintSet(case.problem, case.n))


def _nothing(case: Case, why: str, code: str = "refused") -> Trajectory:
    return Trajectory(
        np.empty(0),
        np.empty((0, case.n)),
        (),
        np.empty((0, 0)),
        np.empty((0, case.n)),
        Status(code, why),
    )


SOLVER = Penalty
