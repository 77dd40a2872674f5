"""What the order of a sweep takes from the scene: numbers of hard particles."""

from __future__ import annotations

import numpy as np


def hard_ranks(scene, order, x0):
    """Numbers by which the pairs of hard particles are ordered, family after family; empty: their
    labels."""
    from nsbench.dynamics.contacts.kernels.constraint_order import cell_ranks

    if order != "cell" or not scene.hard:
        return np.empty(0, np.int64)
    return np.concatenate(
        [
            cell_ranks(
                x0[c.start : c.start + m * c.dim],
                c.dim,
                2.0 * float(scene.radii[k].max(initial=0.5)),
            )
            for k, c, m in scene.hard
        ]
    )
