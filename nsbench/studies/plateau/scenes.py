"""Scenes of the study `plateau`: cases of the catalogue, and a corner of any angle.

The corner is that of the case `wedge` down to one degree: two walls through the origin under the
angle psi, n_1 . n_2 = -cos psi, and a unit force u that varies as 1 + swell sin t and presses on
both, with loads l_2 = (1 - lean (1 - cos psi)) l_1. In the clock s(t) = t + swell (1 - cos t) the
point falls to wall 1, which it meets at s = S_WALL, slides along it, and rests in the corner from
s = S_CORNER on. For acute angles sweeps leave violations of about h l_2 |cot psi|; for psi near 180
degrees the walls are nearly parallel constraints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench import Affine, Case, Complementarity
from nsbench.case import get_case

S_WALL = 0.43  # off the sample times, as S_CORNER, so that both are met inside steps
S_CORNER = 1.27
CORNER_SAMPLES = np.linspace(0.0, 2.0, 9)
FOREVER = 100.0  # of the clock: beyond the end of the run
CORNER = "corner"


@dataclass(frozen=True)
class Scene:
    """A scene of the ladder: group, key (of a case, or corner[psi=..]), coarsest step count."""

    group: str
    key: str
    first: int


SMALL = (
    Scene("long chains", "chain[growth=1.0]", 16),
    Scene("long chains", "chain[links=20,growth=1.0]", 64),
    Scene("long chains", "rods[n=10]", 64),
    Scene("long chains", "buckling_row[n=6]", 40),
    Scene("acute wedges", "corner[psi=30.0]", 16),
    Scene("acute wedges", "corner[psi=5.0]", 128),
    Scene("acute wedges", "corner[psi=1.0]", 1024),
    Scene("nearly parallel", "corner[psi=170.0]", 32),
    Scene("nearly parallel", "corner[psi=179.0]", 2048),
    Scene("redundant", "duplicate", 8),
    Scene("redundant", "hex[n=7]", 8),
    Scene("redundant", "hex[n=19]", 16),
    Scene("redundant", "discs[n=10,seed=0]", 16),
    Scene("kissing discs", "kissing", 16),
    Scene("kissing discs", "kissing[n=30,loops=0.9]", 32),
    Scene("overlapping starts", "overlap_start[meaning=project]", 16),
    Scene("overlapping starts", "three_discs[overlap=project]", 16),
    Scene("epithelium", "epithelium[n=3]", 40),
)
FULL = (
    *SMALL,
    Scene("long chains", "chain[links=40,growth=1.0]", 256),
    Scene("long chains", "rods[n=30]", 256),
    Scene("long chains", "buckling_row", 512),
    Scene("acute wedges", "corner[psi=2.0]", 512),
    Scene("redundant", "hex[n=37]", 32),
    Scene("redundant", "discs[n=30,seed=0]", 32),
    Scene("redundant", "discs[n=100,seed=0]", 64),
    Scene("redundant", "teaser", 16),
    Scene("kissing discs", "kissing[n=60,seed=1]", 64),
    Scene("epithelium", "epithelium", 80),
    Scene("epithelium", "epithelium[r_hard=0.7]", 80),
)


def find_scene(key: str) -> Case:
    """Build the scene of a key: corner[psi=..,swell=..,lean=..] or a case of the catalogue."""
    from nsbench.case import parse_spec

    name, params = parse_spec(key)
    return make_corner(**params) if name == CORNER else get_case(key)


def make_corner(psi: float, swell: float = 0.5, lean: float = 0.0) -> Case:
    """Build the corner of angle psi in degrees, 0 < psi < 180; lean: 0 up to 1 / 2 for any angle.

    Raises ValueError where the force does not press on both walls.
    """
    cos = np.cos(np.radians(psi))
    half = np.radians(psi) / 2
    normals = np.array([[np.cos(half), np.sin(half)], [-np.cos(half), np.sin(half)]])
    loads = np.array([1.0, 1.0 - lean * (1.0 - cos)])
    loads /= np.linalg.norm(loads @ normals)
    push = -loads @ normals
    inward = float(loads[0] - loads[1] * cos)  # -u . n_1
    if not (0.0 < psi < 180.0 and inward > 0.0 and loads[1] > max(0.0, loads[0] * cos)):
        raise ValueError(f"psi = {psi:g}, lean = {lean:g}: both walls must be met")
    slide = push + inward * normals[0]
    hit = -(S_CORNER - S_WALL) * slide
    knots = np.array([0.0, S_WALL, S_CORNER, FOREVER])
    corners = np.array([hit - S_WALL * push, hit, np.zeros(2), np.zeros(2)])
    slid = np.array([(S_CORNER - S_WALL) * inward, 0.0])
    pressed = np.array([np.zeros(2), np.zeros(2), slid, slid + (FOREVER - S_CORNER) * loads])

    def drift(xp):
        def f(t, x):
            return push * (1.0 + swell * xp.sin(t))

        return f

    def follow(values):
        def at(t):
            clock = t + swell * (1.0 - np.cos(t))
            return np.stack([np.interp(clock, knots, v) for v in values.T], axis=1)

        return at

    return Case(
        name=CORNER,
        problem=Complementarity(drift, (Affine(normals, np.zeros(2)),)),
        x0=corners[0],
        t=CORNER_SAMPLES,
        exact=follow(corners),
        exact_impulse=follow(pressed),
        params={"psi": psi, "swell": swell, "lean": lean},
    )
