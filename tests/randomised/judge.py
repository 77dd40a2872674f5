"""What a run that says ok is held to: what its method claims, against an event-driven answer, a second one, or itself.

The answer of a scene is that of event_driven at default settings, if another integrator at another tolerance agrees with it.
CONDITION is how much more the samples move than a start that is moved by 1e-9 of the unit, which is 1, or the largest state if
that is less (as in tests/independent). Errors are the largest of states at samples and of cumulative reactions, less 1e-11 of
the largest coordinate (and, of methods that claim a bound, 1e-11: tolerances are relative and absolute), over the larger of
the unit and what the state moves. Then, for a run that says ok, SILENT WRONG is

claimed bound   (event_driven) a difference above BOUND x condition, claims.exact being 1e-10;
claimed order p (steps h, 1/k of a penalty) at the finest of the LADDER an error above M = 4 times the largest constant
                e / h^p seen at the coarser ones, that stays where it is when the ladder is continued: still, 64 times finer,
                more than a quarter of what it was. (An order is a promise for small h; what comes down late is counted as
                "slow", not as wrong.) So for the depth of violated constraints. p is the claim without events, 1 with them,
                as the methods say of themselves;
own residuals   (event_driven, with samples at its events too) a residual of the equation above 1e-5 of the largest velocity
                that does not fall to half with four times the samples, and four times more; (methods that claim a bound) a
                depth above 1e-8; (all but extrapolated ones, which say that theirs are of no sign) a multiplier below -1e-8
                of its size; a state or impulse that is not finite.

Where there is no answer (event_driven says why), the finest runs of all methods of a scene are held against each other: both
ok, and further apart than four times the last changes of both. Not so where it says that several motions continue: then
methods may differ. The answer has a budget of 1500 steps (of some 10 ms), which bounds the time of a stiff scene.

Crashes are exceptions that are not raised on purpose at the border (a ValueError, TypeError or LookupError that a `raise` of
the package tells) and failures of measuring.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nsbench import solvers
from nsbench.problem import LCS, Complementarity, Smooth
from nsbench.study import misfit
from randomised.runs import Outcome, attempt, relative

LADDER = {"h": (3, 11, 43, 683), "k": (100.0, 400.0, 1600.0, 6400.0)}
LATER = {"h": (2731, 10923, 43691), "k": (25600.0, 102400.0)}
LATER_SLOW = {"h": (171, 683, 2731), "k": (6400.0, 25600.0, 102400.0)}     # of loops that take a hundred times as long
SLOW_LOOPS = ("kdtree", "nosnoc", "pbd_jax", "backend", "nonlinear", "method=catching_up,", "penalty")
M, BOUND, DEPTH, SIGN, RESIDUAL = 4.0, 1e-9, 1e-8, 1e-8, 1e-5
ABSOLUTE = 1e-11           # what absolute tolerances leave in states that are small themselves
WILD = 1e5                  # a condition above which no answer can be judged: rounding alone moves it visibly
ROUND = 2.3e-16
STEPS = "max_steps=1500"
FIRST = f"event_driven[{STEPS}]"
SECOND = tuple((f"event_driven[{option},{STEPS}]", tol) for option, tol in (
    ("method=rk45", 1e-10), ("method=lsoda", 1e-11), ("method=radau", 1e-10), ("max_step=0.02", 1e-11)))


@dataclass(frozen=True)
class Verdict:
    """word: fine, told (a status that is not ok, or a sentence at the border), refused, slow, open (nothing to judge it
    by), wrong, crash; status: of the finest run."""
    word: str
    status: str = ""
    why: str = ""


class Scene:
    """A case with its answer; `second` chooses how the answer is confirmed."""

    def __init__(self, case, second: int = 0, answered: bool = True):
        """answered=False: the answer is known not to come to an end."""
        self.case, self.second, self.answered = case, SECOND[second % len(SECOND)], answered
        self.finest: dict[str, tuple] = {}

    @cached_property
    def first(self) -> Outcome:
        return attempt(self.case, FIRST, 1e-12) if self.answered else Outcome(told="no end")

    @cached_property
    def again(self) -> Outcome:
        return attempt(self.case, *self.second)

    @cached_property
    def unit(self) -> float:
        x = self.first.traj.x if self.first.ok else self.case.x0
        return min(1.0, float(np.max(np.abs(x), initial=0.0)) or 1.0)

    def apart(self, a, b, absolute: float = 0.0) -> float:
        """Difference of two runs, less what tolerances allow: states, and reactions where both have them."""
        allowed = max(self.round_off, absolute)
        out = relative(a.x, b.x, self.unit, allowed)
        if a.reaction.shape == b.reaction.shape and np.isfinite(b.reaction).all():
            out = max(out, relative(a.reaction, b.reaction, self.unit, allowed))
        return out

    @cached_property
    def round_off(self) -> float:
        """1e-11 of the largest coordinate: tolerances are relative, and rounding adds up over steps and events."""
        x = self.first.traj.x if self.first.ok else self.case.x0
        return 1e-11 * float(np.abs(x).max(initial=0.0))

    @cached_property
    def condition(self) -> float:
        """At least 1; infinite where a start beside this one does not run."""
        rng, case, worst = np.random.default_rng(0), self.case, 1.0
        nudge = max(1e-9, self.round_off / self.unit)
        feasible = isinstance(case.problem, Complementarity) and case.problem.constraints
        for _ in range(2):
            away = rng.uniform(-1.0, 1.0, case.n)
            start = "project" if feasible and case.start == "error" else case.start
            other = attempt(case.replace(x0=case.x0 + nudge * self.unit * away, start=start), FIRST, 1e-12)
            worst = max(worst, relative(other.traj.x, self.first.traj.x, self.unit) / nudge if other.ok else np.inf)
        return worst

    @cached_property
    def bound(self) -> float:
        return BOUND * self.condition

    @cached_property
    def answer(self):
        """The trajectory that others are held against, or None."""
        trusted = self.first.ok and self.again.ok and self.condition < WILD
        return self.first.traj if trusted and self.apart(self.again.traj, self.first.traj, ABSOLUTE) <= self.bound else None

    def judge(self, spec: str) -> Verdict:
        method = solvers.get(spec)
        why = method.refuses(self.case)
        if why:
            return Verdict("refused", "refused", why)
        if spec in ("event_driven", FIRST):
            return self._first(self.first)
        if spec.startswith("event_driven"):
            return self._bounded(spec)
        return self._ladder(spec, method)

    # -------------------------------------------------------------- a claimed bound
    def _first(self, run) -> Verdict:
        bad = self._faults(run, True)
        if bad:
            return bad
        if not self.condition < WILD:
            return Verdict("open", "ok", f"condition {self.condition:.1e}")
        residuals, circuit = [], isinstance(self.case.problem, LCS)        # whose w has means over intervals, as a residual
        for parts in (4, 16, 64):               # a residual must fall with more samples, or be small
            more, at = self._sampled(run.traj, parts)
            bad = self._faults(more, True, self.case.replace(t=at))
            if bad:
                return bad if bad.word == "crash" else Verdict("open", "ok", f"with more samples: {bad.status} {bad.why}")
            d = relative(more.traj.x[np.searchsorted(at, self.case.t)], run.traj.x, self.unit,
                         max(self.round_off, ABSOLUTE))
            if d > self.bound:
                return Verdict("wrong", "ok", f"more samples move it by {d:.1e}, condition {self.condition:.1e}")
            steps = np.abs(np.diff(more.traj.x, axis=0) / np.diff(at)[:, None])
            size = max(self.unit, float(steps.max()))
            residuals.append(max(more.measured["residual"], more.measured["feasibility"] if circuit else 0.0))
            if not residuals[-1] > RESIDUAL * size + 2.0 * self.round_off / np.diff(at).min():
                return Verdict("fine", "ok")
        if residuals[-1] > 0.5 * residuals[-2]:
            return Verdict("wrong", "ok", "residuals " + ", ".join(f"{r:.1e}" for r in residuals) + " with ever more samples")
        return Verdict("fine", "ok")

    def _sampled(self, traj, parts: int):
        """event_driven with samples at its events too, and `parts` times as many of all: then no interval holds an event
        inside. The run and its times."""
        t, events = self.case.t, []
        for e in sorted(e.t for e in traj.events):
            if np.abs(np.append(t, events) - e).min() > 1e-7 * (t[-1] - t[0]):
                events.append(e)
        coarse = np.sort(np.append(t, events))
        at = np.unique(np.concatenate([coarse, *(coarse[:-1] + j / parts * np.diff(coarse) for j in range(1, parts))]))
        return attempt(self.case.replace(t=at), f"event_driven[max_steps={1500 + len(at)}]", 1e-12), at

    def _bounded(self, spec) -> Verdict:
        run = self.again if spec == self.second[0] else attempt(self.case, spec, 1e-11)
        bad = self._faults(run, True)
        if bad:
            return bad
        if not (self.first.ok and self.condition < WILD):
            return Verdict("open", "ok", self._why_open())
        d = self.apart(run.traj, self.first.traj, ABSOLUTE)
        if d > self.bound:
            return Verdict("wrong", "ok", f"apart from event_driven by {d:.1e}, condition {self.condition:.1e}")
        return Verdict("fine", "ok")

    def _why_open(self) -> str:
        if not self.first.ok:
            return "no answer: " + (str(self.first.traj.status.code) if self.first.traj is not None else "border")
        return f"condition {self.condition:.1e}"

    def _faults(self, run: Outcome, exact: bool, case=None, spec: str = "") -> Verdict | None:
        """What is wrong with a run (of `case`) by itself; None if it says ok and nothing is."""
        case = case or self.case
        if run.crash:
            return Verdict("crash", "", run.crash)
        if run.traj is None:
            return Verdict("told", "border", run.told)
        if not run.ok:
            return Verdict("told", run.traj.status.code, str(run.traj.status))
        if wrong := misfit(case, run.traj):
            return Verdict("wrong", "ok", wrong)
        lam = np.diff(run.traj.impulse, axis=0) / np.diff(case.t)[:, None]
        signed = "richardson" not in spec and "extrapolate" not in spec
        if signed and run.measured["sign"] < -SIGN * max(1.0, float(np.abs(lam).max(initial=0.0))):
            return Verdict("wrong", "ok", f"multiplier {run.measured['sign']:.1e}")
        size = max(self.unit, float(np.abs(run.traj.x).max()))
        if exact and not isinstance(case.problem, LCS) and run.measured["feasibility"] > DEPTH * size * self._slope:
            return Verdict("wrong", "ok", f"depth {run.measured['feasibility']:.1e}")
        return None

    @cached_property
    def _slope(self) -> float:
        """Largest gradient of rows: a depth is in units of the gap."""
        p = self.case.problem
        rows = [np.abs(c.data).max() for c in getattr(p, "constraints", ()) if hasattr(c, "data")]
        rows += [float(np.abs(p.C).max())] if hasattr(p, "C") else []
        return max([1.0, *rows])

    # -------------------------------------------------------------- a claimed order
    def _values(self, spec, method, ladder):
        if method.accuracy == "k":
            soft = [np.abs(c.data).min() ** -2 for c in self.case.problem.constraints if hasattr(c, "data")] \
                if isinstance(self.case.problem, Complementarity) else []
            T = float(self.case.t[-1] - self.case.t[0])
            return [k * max([1.0, *soft]) / min(T, 1.0) for k in ladder["k"]]
        spacing = float(np.diff(self.case.t).min())
        if spec == "nosnoc":                    # a nonlinear program for each step
            return [spacing / n for n in (1, 2)] if ladder is LADDER else [spacing / n for n in (5, 17)]
        steps = (self.case.t[-1] - self.case.t[0]) / spacing          # so that a ladder takes as many steps in all, about
        scale = max(1.0, 30.0 / steps)
        return [spacing / max(1, round(n * scale)) for n in ladder["h"]]

    def _ladder(self, spec, method) -> Verdict:
        # what is slow stops earlier
        slow = any(word in spec for word in SLOW_LOOPS) or any(
            isinstance(c, Smooth) for c in getattr(self.case.problem, "constraints", ()))
        values, rest = self._values(spec, method, LADDER), self._values(spec, method, LATER_SLOW if slow else LATER)
        values = values[:3] if slow else values
        runs = []
        for v in values:
            runs.append((v, attempt(self.case, spec, v)))
            if runs[-1][1].crash:
                return Verdict("crash", "", f"at {v:g}: {runs[-1][1].crash}")
        bad = self._faults(runs[-1][1], False, spec=spec)
        if bad:
            return bad
        good = [(1.0 / v if method.accuracy == "k" else v, run) for v, run in runs if run.ok]
        last, before = good[-1][1].traj, good[-2][1].traj if len(good) > 1 else None
        self.finest[spec] = (last, self.apart(before, last) if before is not None else np.inf)
        if self.answer is None:
            return self._against_others(spec)
        steps = float(np.diff(self.case.t).sum()) / min(h for h, _ in good) if method.accuracy == "h" else 1e4
        floor = 10.0 * self.bound + ROUND * steps * self.condition
        p = self._order(method)
        for name, e in (("error", lambda r: self.apart(r.traj, self.answer)), ("depth", self._depth)):
            found = [(h, e(run)) for h, run in good]
            if not _slower(found, p, floor):
                continue
            verdict = self._later(spec, method, rest, found, e, floor, name)
            if verdict.word != "fine":
                return verdict
        return Verdict("fine", "ok")

    def _depth(self, run) -> float:
        v = run.measured["feasibility"] if not isinstance(self.case.problem, LCS) else 0.0
        return 0.0 if np.isnan(v) else v / max(self.unit, float(np.abs(run.traj.x).max())) / self._slope

    def _order(self, method) -> float:
        quiet = not self.answer.events and not self.answer.contacts
        return method.claims.state if quiet else min(1.0, method.claims.state)

    def _later(self, spec, method, rest, found, e, floor, name) -> Verdict:
        """The ladder goes on: does it come down?"""
        for v in rest:
            run = attempt(self.case, spec, v)
            if run.crash:
                return Verdict("crash", "", f"at {v:g}: {run.crash}")
            if not run.ok:
                return Verdict("told", "border" if run.traj is None else run.traj.status.code, "finer")
            found.append((1.0 / v if method.accuracy == "k" else v, e(run)))
        text = f"{name} " + ", ".join(f"{err:.1e} at {h:.1e}" for h, err in found)
        (_, err), coarse = found[-1], [err for g, err in found if g > 60.0 * found[-1][0]] or [found[0][1]]
        if err <= floor or err <= 0.25 * coarse[-1]:
            return Verdict("slow", "ok", text)
        return Verdict("wrong", "ok", text)

    def _against_others(self, spec) -> Verdict:
        mine, change = self.finest[spec]
        if self.first.traj is not None and self.first.traj.status.code == "degenerate":
            return Verdict("open", "ok", self._why_open())
        for other, (theirs, moved) in self.finest.items():
            if other == spec or not np.isfinite(change + moved):
                continue
            d = self.apart(theirs, mine)
            if d > 1e-6 + M * (change + moved) and change + moved < 0.1:
                return Verdict("wrong", "ok", f"{d:.1e} apart from {other}; last changes {change:.1e}, {moved:.1e}; "
                                              + self._why_open())
        return Verdict("open", "ok", self._why_open())


def _slower(found, p, floor) -> bool:
    """Is the finest error above M times what the largest constant of the coarser ones allows?"""
    h, err = found[-1]
    allowed = max((e * (h / g) ** p for g, e in found[:-1]), default=np.inf)
    return not (err <= floor or err <= M * allowed)
