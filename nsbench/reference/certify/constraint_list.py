"""Constraints of a small scene as a list of rows, all pairs of hard particles included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.problem import Affine, Distance


@dataclass(frozen=True)
class Row:
    """Describe one constraint: its id, its family's number, kind, and what the kind needs (columns,
    values, sign, distance).
    """

    id: tuple
    family: int
    kind: str
    index: int
    cols: tuple = ()
    vals: tuple = ()
    other: tuple = ()
    d: float = 0.0
    sign: int = 1


def rows_of(case: Case) -> list[Row]:
    """List every constraint of a small scene in the stated order, all pairs included."""
    scene = ConstraintSet(case.problem, case.n)
    out = []
    for k, c in enumerate(case.problem.constraints):
        if isinstance(c, Affine):
            for i in range(c.shape[0]):
                e = slice(c.indptr[i], c.indptr[i + 1])
                out.append(
                    Row(
                        (k, i),
                        k,
                        "affine",
                        i,
                        tuple(c.indices[e].tolist()),
                        tuple(c.data[e].tolist()),
                    )
                )
        elif isinstance(c, Distance):
            out += _distances(k, c, case.n, scene)
        else:
            count = len(np.atleast_1d(as_numpy(c.g)(float(case.t[0]), case.x0)))
            out += [Row((k, i), k, "smooth", i) for i in range(count)]
    return out


def _distances(k, c, n, scene):
    """List the constraints of a Distance family: pairs, links, anchors."""
    count = c.particles(n)
    place = lambda i: tuple(range(c.start + i * c.dim, c.start + (i + 1) * c.dim))
    if c.all_pairs:
        r = scene.radii[k]
        size = (
            (lambda i, j: 2 * float(r[i]))
            if c.radii is None
            else (lambda i, j: (float(r[i]), float(r[j])))
        )
        return [
            Row((k, i, j), k, "pair", -1, place(i), (), place(j), size(i, j), 1)
            for i in range(count)
            for j in range(i + 1, count)
        ]
    pairs = c.pairs
    if pairs is None:
        pairs = np.stack(
            np.indices(
                (count, len(np.asarray(as_numpy(c.anchors)(0.0) if c.moving else c.anchors)))
            ),
            -1,
        )
        pairs = pairs.reshape(-1, 2)
    d = np.broadcast_to(c.d, len(pairs))
    kind = "pair" if c.anchors is None else "anchor"
    return [
        Row(
            (k, int(i), int(j)),
            k,
            kind,
            int(j),
            place(int(i)),
            (),
            place(int(j)) if kind == "pair" else (),
            float(d[m]),
            c.sign,
        )
        for m, (i, j) in enumerate(pairs)
    ]
