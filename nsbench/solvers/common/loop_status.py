"""Status of a run by the code with which its time loop ended."""

from __future__ import annotations

from collections.abc import Mapping

from nsbench.case.scale import time_text
from nsbench.solvers.common.kernels.step_code import StepCode
from nsbench.trajectory import Status


def status_of(code: int, reached: float, own: Mapping[StepCode, Status] | None = None) -> Status:
    """Return the status of a run whose time loop returned `code` at the time `reached`.

    own: the statuses of a method for codes whose sentence is its own; they come first.
    """
    if own and code in own:
        return own[code]
    if code == StepCode.NAN:
        return Status("nan", f"The drift is not a number at t = {time_text(reached, 6)}.")
    if code == StepCode.BLOWN:
        return Status(
            "diverged",
            f"The state passed 1e150 at t = {time_text(reached, 6)}; a smaller step may help.",
        )
    if code != StepCode.OK:
        raise ValueError(f"a time loop ended with {code!r}, which has no sentence here")
    return Status()
