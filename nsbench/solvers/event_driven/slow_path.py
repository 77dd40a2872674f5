"""Say why a run was followed in Python, and why some of its steps are not proven to hide no event.

The sentences are stats["note"], the column `note`; compiled and proven runs have none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nsbench.compilation.case_functions import in_python
from nsbench.solvers.event_driven.filippov.kernels import loop_state as codes
from nsbench.solvers.event_driven.filippov.tracing.refusals import UNTRACEABLE, describe_refusal
from nsbench.dynamics.interval_taylor import Jet, as_jet

class HostNotes(NamedTuple):
    """Why a run may be in Python, and why the kinks of its drift are not found by tracing; "" if
    neither is so."""

    reason: str
    untraced: str


HAND_OVERS = {
    codes.START: "the mode at the start is not certain",
    codes.MEET: "the mode after an event is not certain",
    codes.HARD: "a step could not be certified",
}


def describe_slow_path(
    reason: str, hand_overs: list[int], unproven: int, data: Callable, untraced: str = ""
) -> dict:
    """Return {"note": sentences} on a run, or {} if it was compiled and proven.

    reason: why there is no compiled loop, "" if there is one. hand_overs: codes with which it
    stopped for help. unproven: steps with an unproven part. data() -> what the proof evaluates.
    untraced: why kinks of the drift are not found by tracing.
    """
    sentences = []
    if reason:
        sentences.append(in_python(reason)["note"])
    if hand_overs:
        causes = ", or ".join(HAND_OVERS[c] for c in dict.fromkeys(hand_overs) if c in HAND_OVERS)
        count = len(hand_overs)
        times = "once" if count == 1 else f"{count} times"
        sentences.append(f"The compiled loop handed over to Python {times}, because {causes}.")
    if unproven:
        doubt = _doubt(data, untraced)
        steps = "1 step is" if unproven == 1 else f"{unproven} steps are"
        sentences.append(f"{steps} not proven to hide no event: {doubt}.")
    return {"note": " ".join(sentences)} if sentences else {}


def _doubt(data: Callable, untraced: str) -> str:
    """Say why a proof failed: what cannot be enclosed, with its line, or a kink within a step."""
    try:
        with np.errstate(all="ignore"):
            data()
    except UNTRACEABLE as e:
        return describe_refusal(e).replace("no Jet of", "no enclosure of")
    return untraced or "a function has a kink, a jump or a singularity within them"


def points(t: float, x: np.ndarray) -> tuple[Jet, Jet]:
    """Return a time and a state (n,) as Jets."""
    return as_jet(np.float64(t), 1), as_jet(x, 1)
