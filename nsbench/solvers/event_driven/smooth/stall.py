"""Detect integrations that no longer move: at a pole, where contacts lock, or in a thin layer."""

from __future__ import annotations

STALL_STEPS = 200  # in a row that lead no further than STALL_SPAN
# Part of the arc: as many steps again as a run may take would not end it. Steps towards a kink or a
# dip 1e-10 wide shrink and grow by factors: 30 of them do.
STALL_SPAN = 1e-9
STALL_MESSAGE = (
    f"{STALL_STEPS} steps led from t = {{}} no further than {STALL_SPAN:g} of the run: a pole, "
    "contacts that lock, or a layer too thin for doubles."
)
# of the distance of the steps before: sequences that shrink faster end by themselves
_SHRINKING = 0.05


class StallDetector:
    """Detect that the last STALL_STEPS steps hardly moved, and not much less than those before.

    Called after every step. t0: start of the arc. length: of the arc.
    """

    def __init__(self, t0: float, length: float):
        self._mark = (0, t0, 0.0)
        self._length = length

    def __call__(self, steps: int, t: float) -> bool:
        """Return whether the integration stalls, with the number of steps so far and the time."""
        begun, start, before = self._mark
        if steps - begun < STALL_STEPS:
            return False
        distance = t - start
        self._mark = steps, t, distance
        # LSODA goes on with steps below rounding: then the distance is zero
        stalls = _SHRINKING * before < distance < STALL_SPAN * self._length
        return distance == 0.0 or stalls
