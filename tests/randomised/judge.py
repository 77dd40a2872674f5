"""What a run that says ok is held to: what its method claims, against an event-driven answer, a
second one, or itself.

The answer of a scene, its unit and its condition stand in `answer`. Errors are the largest of
states at samples and of cumulative reactions, less 1e-11 of the largest coordinate (and, of methods
that claim a bound, 1e-11: tolerances are relative and absolute), over the larger of the unit and
what the state moves. Then, for a run that says ok, SILENT WRONG is

claimed bound   (event_driven) a difference above BOUND x condition, claims.exact being 1e-10,
beside rounding of the state;
claimed order p (steps h, 1/k of a penalty) at the finest of the LADDER an error above M = 4 times
the largest constant
                e / h^p seen at those 8 times coarser or more, that stays where it is when the
                ladder is continued: still, 64 times finer, more than a quarter of what it was. (An
                order is a promise for small h, in which the drift goes less than 0.005 of the unit,
                and than a tenth of a diameter or link; what comes down late is counted as "slow",
                not as wrong.) So for the depth of violated constraints. p is the claim without
                events, 1 with them, as the methods say of themselves;
own residuals   (event_driven, with samples at its events too) a residual of the equation above 1e-5
of the largest velocity
                with up to 64 times the samples, if what it lacks (see own) stays with ever more
                where it is large;
                (methods that claim a bound) a depth above 1e-8; (all but extrapolated ones, which
                say that theirs are of no sign) a multiplier below -1e-8 of its size; a state or
                impulse that is not finite.

Where there is no answer (event_driven says why), the finest runs of all methods of a scene are held
against each other: both ok, and further apart than four times the last changes of both. Not so
where it says that several motions continue, or where the condition is beyond WILD, or an infeasible
start is kept, or two surfaces are one and the same, on which their signs may differ: then methods
may differ. And each is held against its equation alone: see own. The answer has a budget of 1500
steps (of some 10 ms), which bounds the time of a stiff scene.

Crashes are exceptions that are not raised on purpose at the border (a ValueError, TypeError or
LookupError that a `raise` of the package tells) and failures of measuring.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nsbench import solvers
from nsbench.diagnostics.rounding import largest_speed
from nsbench.problem import LCS
from nsbench.study.result_contract import contract_violation
from randomised.answer import ABSOLUTE, FIRST, STEPS, WILD, Answer
from randomised.ladder import LADDER, LATER, LATER_SLOW, floors, is_slow, jumps, slower, values
from randomised.own import FAST, MISSING, NARROW, coincide, filled, settled, shortest, slope
from randomised.runs import Outcome, Verdict, attempt, relative

M = 4.0
DEPTH = 1e-8
SIGN = 1e-8
RESIDUAL = 1e-5
AT_LAST = 0.5  # the order that the last two refinements show where the fall begins late
# with 64 times finer steps; the layer of a switch as flat as x^3 is k^(-1/3) wide, and falls to 1/4
FALLS = 0.3
MANY = 1000  # samples that are not taken everywhere: some methods take 10 ms for each
LEFT = 1e-8  # ten tolerances of a penalty's integrator, in one step


class Scene(Answer):
    """A case whose runs are judged; `second` chooses how its answer is confirmed."""

    def __init__(self, case, second: int = 0, answered: bool = True):
        super().__init__(case, second, answered)
        self.finest: dict[str, tuple] = {}

    def judge(self, spec: str) -> Verdict:
        method = solvers.get(spec)
        if why := method.refuses(self.case):
            return Verdict("refused", "refused", why)
        if spec in ("event_driven", FIRST):
            return self._first(self.first)
        if spec.startswith("event_driven"):
            return self._bounded(spec)
        return self._ladder(spec, method)

    def _first(self, run) -> Verdict:
        return self._faults(run, True) or self._by_itself(FIRST, 1e-12, run)

    def _by_itself(self, spec, tol, run) -> Verdict:
        """What the residuals of a run with more samples say; and whether these move it."""
        # whose w has means over intervals, as a residual
        at = self.case.t
        circuit = isinstance(self.case.problem, LCS)
        good = Verdict(
            "fine" if spec == FIRST and self.condition < WILD else "own", "ok", self._why_open()
        )
        for parts in (4, 16, 64):  # a residual must fall with more samples, or be small
            if parts > 4 and len(at) * 4 > MANY:
                break  # where it does not, more of them will do
            at = self._times(run.traj, parts)
            more = self._at(spec, tol, at)
            bad = self._faults(more, True, self.case.replace(t=at))
            if bad:
                more_ = f"with more samples: {bad.status} {bad.why}"
                return (
                    Verdict("open", "ok", more_)
                    if bad.word == "told"
                    else Verdict(bad.word, bad.status, more_)
                )
            d = relative(
                more.traj.x[np.searchsorted(at, self.case.t)],
                run.traj.x,
                self.unit,
                max(self.round_off * self.growth, ABSOLUTE, 10.0 * tol),
            )
            if good.word == "fine" and d > self.bound:
                return Verdict(
                    "wrong",
                    "ok",
                    f"more samples move it by {d:.1e}, condition {self.condition:.1e}",
                )
            steps = np.abs(np.diff(more.traj.x, axis=0) / np.diff(at)[:, None])
            size = max(self.unit, float(steps.max()))
            residual = max(
                more.measured["residual"], more.measured["feasibility"] if circuit else 0.0
            )
            if not residual > RESIDUAL * size + 2.0 * self.round_off / np.diff(at).min():
                return good
        return self._filled(spec, tol, at, more, size, good)

    def _filled(self, spec, tol, t, run, size, good) -> Verdict:
        """A run with samples t whose residual stays with more everywhere: a kink of the drift, or
        something that is missing?"""
        allowed = MISSING * size * float(t[-1] - t[0]) + 2.0 * self.round_off * len(t) + ABSOLUTE
        again = lambda at: run if at is t else self._at(spec, tol, at)
        found, traj = filled(
            lambda at: o.traj if (o := again(at)).ok else None, self.case, t, allowed
        )
        text = ", ".join(f"{v:.1e}" for v in found) + " with ever more samples"
        if traj is None:
            return Verdict("open", "ok", "with more samples: no run; missing " + text)
        return good if found[-1] <= allowed else Verdict("wrong", "ok", "missing " + text)

    def _times(self, traj, parts: int):
        """Samples at the events of a run too, and `parts` times as many of all: then no interval
        holds an event inside."""
        t = self.case.t
        events = []
        for e in sorted(e.t for e in traj.events):
            if np.abs(np.append(t, events) - e).min() > 1e-7 * (t[-1] - t[0]):
                events.append(e)
        coarse = np.sort(np.append(t, events))
        return np.unique(
            np.concatenate(
                [coarse, *(coarse[:-1] + j / parts * np.diff(coarse) for j in range(1, parts))]
            )
        )

    def _at(self, spec, tol, t) -> Outcome:
        """The same with samples t."""
        return attempt(
            self.case.replace(t=t), spec.replace(STEPS, f"max_steps={1500 + len(t)}"), tol
        )

    def _bounded(self, spec) -> Verdict:
        tol = self.tol(self.second[1] if spec == self.second[0] else 1e-11)
        run = self.again if spec == self.second[0] else attempt(self.case, spec, tol)
        if bad := self._faults(run, True):
            return bad
        if not (self.first.ok and self.condition < WILD):
            return self._by_itself(spec, tol, run)
        d = self.apart(run.traj, self.first.traj, ABSOLUTE)
        if d > self.bound:
            return Verdict(
                "wrong", "ok", f"apart from event_driven by {d:.1e}, condition {self.condition:.1e}"
            )
        return Verdict("fine", "ok")

    def _why_open(self) -> str:
        if not self.first.ok:
            return "no answer: " + (
                str(self.first.traj.status.code) if self.first.traj is not None else "border"
            )
        return f"condition {self.condition:.1e}" if self.condition >= WILD else ""

    def _faults(self, run: Outcome, exact: bool, case=None, spec: str = "") -> Verdict | None:
        """What is wrong with a run (of `case`) by itself; None if it says ok and nothing is."""
        case = case or self.case
        if run.crash:
            return Verdict("crash", "", run.crash)
        if run.traj is None:
            return Verdict("told", "border", run.told)
        if not run.ok:
            return Verdict("told", run.traj.status.code, str(run.traj.status))
        if wrong := contract_violation(case, run.traj):
            return Verdict("wrong", "ok", wrong)
        lam = np.diff(run.traj.impulse, axis=0) / np.diff(case.t)[:, None]
        signed = "richardson" not in spec and "extrapolate" not in spec
        noise = SIGN * max(1.0, float(np.abs(lam).max(initial=0.0)))
        # means of what has an absolute tolerance, and of what changes at events, which are found to
        # the rounding of a state
        left = (
            max(ABSOLUTE, self.round_off) if exact else LEFT if spec.startswith("penalty") else 0.0
        )
        noise += left / np.diff(case.t).min()
        if signed and run.measured["sign"] < -noise:
            return Verdict("wrong", "ok", f"multiplier {run.measured['sign']:.1e}")
        size = max(self.unit, float(np.abs(run.traj.x).max()))
        deep = (DEPTH * size + ABSOLUTE) * slope(self.case)
        if exact and not isinstance(case.problem, LCS) and run.measured["feasibility"] > deep:
            return Verdict("wrong", "ok", f"depth {run.measured['feasibility']:.1e}")
        return None

    def _ladder(self, spec, method) -> Verdict:
        slow = is_slow(self.case, spec)  # what is slow stops earlier
        steps = values(self.case, spec, method, LADDER)
        steps = steps[:3] if slow else steps
        rest = [
            v
            for v in values(self.case, spec, method, LATER_SLOW if slow else LATER)
            if v not in steps
        ]
        runs = []
        for v in [
            steps[-1],
            *steps[:-1],
        ]:  # where the finest needs too many steps, the others tell nothing
            run = attempt(self.case, spec, v)
            if run.crash:
                return Verdict("crash", "", f"at {v:g}: {run.crash}")
            if not runs and run.traj is not None and run.traj.status.code == "maxiter":
                return self._faults(run, False, spec=spec)
            runs.append((v, run))
        runs = [*runs[1:], runs[0]]
        if bad := self._faults(runs[-1][1], False, spec=spec):
            return bad
        good = [(1.0 / v if method.accuracy == "k" else v, run) for v, run in runs if run.ok]
        last = good[-1][1].traj
        before = good[-2][1].traj if len(good) > 1 else None
        self.finest[spec] = (last, self.apart(before, last) if before is not None else np.inf)
        if self.answer is None:
            return self._against_others(spec) or settled(
                self.case, spec, method, self.unit, self._why_open()
            )
        floor = floors(
            self.case,
            method,
            self.answer,
            self.digits,
            self.bound,
            self.condition,
            self.unit,
            self.jump,
        )
        p = self._order(method)
        for name, e in (
            ("error", lambda r: self.apart(r.traj, self.answer)),
            ("depth", self._depth),
        ):
            found = [(h, e(run)) for h, run in good]
            if not slower(found, p, floor):
                continue
            verdict = self._later(method, rest, found, e, floor, name, spec)
            if verdict.word != "fine":
                return verdict
        return Verdict("fine", "ok")

    def _depth(self, run) -> float:
        """Over the size of the state; of an LCS, whose w is known to a quadrature, what it is
        beyond that of the answer."""
        v = run.measured["feasibility"]
        if isinstance(self.case.problem, LCS):
            v = max(0.0, v - self.first.measured["feasibility"])
        return (
            0.0
            if np.isnan(v)
            else v / max(self.unit, float(np.abs(run.traj.x).max())) / slope(self.case)
        )

    def _order(self, method) -> float:
        quiet = not self.answer.events and not self.answer.contacts
        return method.claims.state if quiet else min(1.0, method.claims.state)

    def _later(self, method, rest, found, e, floor, name, spec) -> Verdict:
        """The ladder goes on: does it come down?"""
        for v in rest:
            run = attempt(self.case, spec, v)
            if run.crash:
                return Verdict("crash", "", f"at {v:g}: {run.crash}")
            if not run.ok:
                return Verdict(
                    "told", "border" if run.traj is None else run.traj.status.code, "finer"
                )
            found.append((1.0 / v if method.accuracy == "k" else v, e(run)))
        text = f"{name} " + ", ".join(f"{err:.1e} at {h:.1e}" for h, err in found)
        if (
            spec == "nosnoc" and found[-1][0] > np.diff(self._times(self.answer, 1)).min()
        ):  # steps end at events: all of one
            return Verdict("open", "ok", text)
        if found[0][0] < 4.0 * found[-1][0]:  # uneven samples leave no room for a ladder
            return Verdict("open", "ok", text)
        (h, err), coarse = (
            found[-1],
            [err for g, err in found if g > 60.0 * found[-1][0]] or [found[0][1]],
        )
        # or it begins to fall late, from a peak: steps that a stiff drift makes large errors of are
        # not all the coarsest
        late = all(
            e <= b * (s / g) ** AT_LAST
            for (g, b), (s, e) in zip(found[-3:], found[-2:], strict=False)
        )
        if (
            err <= floor(h)
            or err <= FALLS * coarse[-1]
            or (late and err <= FALLS * max(e for _, e in found))
        ):
            return Verdict("slow", "ok", text)
        # it throws particles over one another, or a state far from a narrow set, before they are
        # put back
        if h * self.pace > min(NARROW * shortest(self.case), FAST * self.unit):
            return Verdict("open", "ok", text)
        return Verdict("wrong", "ok", text)

    @cached_property
    def jump(self) -> float:
        """How much the drift jumps in time along the answer."""
        return jumps(self.case, self.answer)

    @cached_property
    def pace(self) -> float:
        """Largest speed of the drift along the answer."""
        return max(
            largest_speed(self.case.problem, float(t), x)
            for t, x in zip(self.answer.t, self.answer.x, strict=True)
        )

    def _against_others(self, spec) -> Verdict | None:
        """wrong, if others that say ok are elsewhere; not where motions part (several continue, or
        a huge condition), or where what an infeasible start becomes is each method's own
        meaning."""
        mine, change = self.finest[spec]
        degenerate = self.first.traj is not None and self.first.traj.status.code == "degenerate"
        if self.first.ok or degenerate or self.solved.start == "keep" or coincide(self.case):
            return None
        for other, (theirs, moved) in self.finest.items():
            if other == spec or not np.isfinite(change + moved):
                continue
            d = self.apart(theirs, mine)
            if d > 1e-6 + M * (change + moved) and change + moved < 0.1:
                return Verdict(
                    "wrong",
                    "ok",
                    f"{d:.1e} apart from {other}; last changes {change:.1e}, {moved:.1e}; "
                    + self._why_open(),
                )
        return None
