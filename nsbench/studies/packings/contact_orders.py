"""Named orders of the contacts of a packing, in which a sweep may project them."""

from __future__ import annotations

import numpy as np

from nsbench.studies.packings.contact_graphs import ContactGraph


def named_orders(graph: ContactGraph) -> dict[str, np.ndarray]:
    """Return the named orders of the contacts of a packing."""
    middle = graph.centres[graph.pairs].mean(axis=1) - graph.centres.mean(axis=0)
    radius = np.linalg.norm(middle, axis=1)
    along = np.lexsort(middle.T)
    outwards = np.lexsort((*middle.T, np.round(radius, 9)))
    return {
        "along the packing": along,
        "from the centre outwards": outwards,
        "from the rim inwards": outwards[::-1].copy(),
        "by colours": np.argsort(colour_contacts(graph.gram), kind="stable"),
    }


def colour_contacts(gram: np.ndarray) -> np.ndarray:
    """Colour contacts greedily so that no two of one body share a colour; (m,)."""
    colours = np.full(len(gram), -1)
    for k in range(len(gram)):
        taken = set(colours[(gram[k] != 0.0) & (colours >= 0)])
        colours[k] = next(c for c in range(len(gram)) if c not in taken)
    return colours
