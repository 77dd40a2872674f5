"""Statuses for arcs that failed, and for choices of active contacts that failed."""

from __future__ import annotations

import numpy as np

from nsbench.trajectory import Status

LOCKING = 1e6  # multipliers over the drift beyond which contacts are said to lock


def describe_infeasible(contact: tuple, flat: bool, now: str) -> Status:
    """Describe why no velocity satisfies a contact; flat: its gradient vanishes. now: the time."""
    if flat:
        return Status(
            "degenerate",
            f"Constraint {contact}: the gradient is zero or undefined at t = {now}, "
            "where it is active: no direction leads away from it.",
        )
    return Status(
        "infeasible",
        f"No velocity keeps constraint {contact} and those it depends on, at "
        f"t = {now}: the constraints leave no way on.",
    )


def describe_locking(lam: np.ndarray, drift_size: float, ids: list, now: str) -> Status | None:
    """Describe contacts whose multipliers lam (m,), in units of the drift, grow without bound; None
    if they do not."""
    if np.all(np.abs(lam) < LOCKING * drift_size):
        return None
    k = int(np.argmax(np.where(np.isfinite(lam), np.abs(lam), np.inf)))
    return Status(
        "infeasible",
        f"Contacts lock at t = {now}: the multiplier of {ids[k]} grows without bound.",
    )
