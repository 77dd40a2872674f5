"""Describe the hard particles of a constraint set by the arrays that time loops receive."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.dynamics.contacts.constraint_set import ConstraintSet


class HardParticles(NamedTuple):
    """All hard families of a constraint set, one after the other.

    families (k, 4): family, first coordinate, number of particles, dimension. radii: of all
    particles. owner (n, 2): first coordinate and dimension of the particle that a coordinate
    belongs to, -1 if none.
    """

    families: np.ndarray
    radii: np.ndarray
    owner: np.ndarray


def hard_particles(scene: ConstraintSet) -> HardParticles:
    """Return the arrays of the hard families; without any, they are empty and owner is -1."""
    families = np.array([(k, c.start, m, c.dim) for k, c, m in scene.hard], np.int64).reshape(-1, 4)
    owner = np.full((scene.n, 2), -1, np.int64)
    for _, start, m, dim in families:
        first = start + dim * np.arange(m)
        owner[start : start + m * dim, 0] = np.repeat(first, dim)
        owner[start : start + m * dim, 1] = dim
    radii = np.concatenate([np.empty(0), *(scene.radii[k] for k in families[:, 0])])
    return HardParticles(families, radii, owner)


def mean_radius(scene: ConstraintSet) -> float:
    """Return the mean radius of all hard particles, 1.0 if there are none."""
    if not scene.hard:
        return 1.0
    return float(np.mean(np.concatenate(list(scene.radii.values()))))
