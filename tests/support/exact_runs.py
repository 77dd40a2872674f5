"""Closed forms as trajectories, for tests of what is measured on them."""

import numpy as np

from nsbench.reference import closed_form
from nsbench.trajectory import Trajectory


def exact_run(case, **changes):
    """The closed form as if a solver had returned it."""
    ref = closed_form(case)
    fields = {
        "t": case.t,
        "x": ref.x,
        "contacts": ref.contacts,
        "impulse": ref.impulse,
        "events": ref.events,
        "stats": {"events": len(ref.events)} if ref.events else {},
        "reaction": ref.reaction if ref.reaction is not None else np.empty((len(case.t), 0)),
    }
    return Trajectory(**{**fields, **changes})
