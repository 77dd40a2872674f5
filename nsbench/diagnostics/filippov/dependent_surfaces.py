"""Check: velocity of a regularised run outside Filippov's set where surface normals are dependent.

Around a common zero of m switches with independent gradients there are 2^m sectors, and the fields
of all meet there. If the gradients are dependent, as of surfaces that are one, or that meet in
fewer dimensions than their number allows, some sectors do not exist (Gordan's theorem), and
Filippov's set is the convex hull of the fields of those that do. The layers c = clip(switch /
width) have weights of their own: of surfaces that are one, the layer of the steeper switch is
thinner, and the weights of both are those of no point off the surface. The same holds for fields
that are not affine in their signs.
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.filippov.convex_hull import distance_to_hull
from nsbench.dynamics.filippov.modes import sign_patterns

MAX_SURFACES = 4  # through one point, of which all sectors are examined
LAYERS_OFF = 10.0  # times the layer by which a wrong velocity may displace a run in all
VANISHES = 1e-9  # length of a convex combination of unit vectors that counts as zero


def sector_signs(gradients: np.ndarray) -> np.ndarray:
    """Return (s, m) the sign patterns of the sectors around a common zero of m switches.

    gradients (m, n): of the switches there. By Gordan's theorem no sector has the signs s if a
    convex combination of the vectors s_i gradient_i vanishes.
    """
    unit = gradients / np.linalg.norm(gradients, axis=1)[:, None]
    origin = np.zeros(unit.shape[1])
    signs = sign_patterns(len(unit))
    return signs[[distance_to_hull(origin, s[:, None] * unit) > VANISHES for s in signs]]


def check_dependent_surfaces(run: RunView) -> Finding | None:
    """Find a state in the layers of surfaces with dependent normals whose velocity is none there.

    The velocity of the layers is compared with Filippov's set, the convex hull of the fields of the
    sectors that exist, at two known states in a row: what is only crossed is not in them twice.
    """
    width = run.resolution.layer
    if not width:
        return None
    span = float(run.t[-1] - run.t[0])
    before = False
    for at, x in zip(run.t, run.x, strict=True):
        rows, off = _distance_to_sectors(run.vector_field, width, float(at), x)
        here = off * span > LAYERS_OFF * width
        if here and before:
            return Finding(
                "unverified",
                f"At t = {time_text(at, 6)} the layers of surfaces {', '.join(map(str, rows))}, "
                "whose "
                "normals are dependent, mix fields that do not meet: no error of size 1 / k is "
                "claimed there.",
            )
        before = here
    return None


def _distance_to_sectors(motion, width, t, x) -> tuple:
    """Return the surfaces of a corner at x, and the distance of its velocity to their sectors.

    The corner is made of the surfaces within the thickest of the layers that x is in. The distance,
    to the convex hull of the fields of the sectors that exist, is in units of the flattest switch;
    0.0 if there are all 2^m sectors.
    """
    c = motion.switch(t, x)
    if not (np.abs(c) < width).any():
        return (), 0.0
    slopes = np.linalg.norm(motion.gradients(t, x, np.arange(c.size)), axis=1)
    thickness = np.max(width / slopes[np.abs(c) < width])
    rows = np.flatnonzero(np.abs(c) < slopes * thickness)
    if not (2 <= rows.size <= MAX_SURFACES and np.isfinite(thickness)):
        return (), 0.0
    sectors = sector_signs(motion.gradients(t, x, rows))
    if len(sectors) in (0, 2**rows.size):
        return (), 0.0
    signs = np.clip(c / width, -1.0, 1.0)
    fields = []
    for sides in sectors:
        s = signs.copy()
        s[rows] = sides
        fields.append(motion.field(t, x, s))
    off = distance_to_hull(motion.field(t, x, signs), np.array(fields))
    return rows, float(off * slopes[rows].min()) if np.isfinite(off) else 0.0
