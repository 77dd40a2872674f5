"""Option `order` of PBD: from its name to a number, cell ranks and sorted constraint lists.

The keys of an order depend on the scene and never on a list. The orders are numbered as in
dynamics/contacts/kernels/constraint_order.
"""

from __future__ import annotations

import numpy as np

from nsbench.dynamics.contacts.candidates import CandidateContacts, ListedContacts
from nsbench.dynamics.contacts.constraint_set import ConstraintSet

ORDERS = ("sorted", "reverse", "random", "cell", "coloured")


def order_number(order: str) -> int:
    """Return the number of an order, as constraint_order counts them."""
    return ORDERS.index(order)


def hard_ranks(scene: ConstraintSet, order: str, x0: np.ndarray) -> np.ndarray:
    """Return the numbers by which pairs of hard particles are ordered, family after family.

    x0 (n,): the start, whose cells number the particles. Empty where their labels order them.
    """
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


def ordered_arrays(near: CandidateContacts, order: str, seed: int) -> ListedContacts:
    """Return the arrays of listed constraints in the order of the sweep."""
    if order == "sorted":
        return near.arrays()
    from nsbench.dynamics.contacts.kernels.constraint_order import static_keys

    keys = static_keys(near.family, order_number(order), seed)
    return near.take(np.argsort(keys)).arrays()


def constraint_keys(
    scene: ConstraintSet, near: CandidateContacts, order: str, seed: int, x0: np.ndarray
) -> np.ndarray:
    """Return the keys (m,) of all constraints listed in `near`, hard pairs among them.

    Hard pairs have keys by the numbers of their particles, as in the compiled loops.
    """
    from nsbench.dynamics.contacts.kernels.constraint_order import static_keys, sweep_key

    number = order_number(order)
    keys = static_keys(near.family, number, seed)
    ranks = hard_ranks(scene, order, x0)
    at = 0
    for k, _, m in scene.hard:
        rank = ranks[at : at + m] if ranks.size else np.arange(m)
        at += m
        for c in np.flatnonzero(near.family == k):
            a, b = sorted((rank[near.i[c]], rank[near.j[c]]))
            keys[c] = sweep_key(number, seed, k, a, b)
    return keys
