"""Random scenes as the text of case files: every family of problems, degenerate on purpose."""

from __future__ import annotations

import numpy as np

from randomised.choices import Choices
from randomised.contacts import affine, discs, links, smooth_gaps
from randomised.draft import Draft, array
from randomised.switches import circuit, modes, relay, signs, smooth_ode

HEAD = '"""A random scene: {what}."""\nimport numpy as np\n\nfrom nsbench import {names}\n'
FAMILIES = {
    "affine": affine,
    "discs": discs,
    "links": links,
    "smooth": smooth_gaps,
    "ode": smooth_ode,
    "modes": modes,
    "signs": signs,
    "relay": relay,
    "circuit": circuit,
}


def scene(c: Choices, family: str) -> str:
    """The text of the case file of a scene of that family."""
    t0 = c.pick((0.0, 0.0, -1.0, 100.0))
    d = Draft(c, family, t0)
    if c.rarely(6):
        d.scale, d.offset = c.pick(((1e8, 0.0), (1e-8, 0.0), (1.0, 1e8)))
        d.note(f"scale {d.scale:g} offset {d.offset:g}")
    wild = c.rarely(3)
    x0, problem, start = FAMILIES[family](d, wild)
    x = d.offset + d.scale * np.asarray(x0, float)
    text = HEAD.format(what=", ".join([family, *d.notes]), names=", ".join(sorted(d.names))) + "\n"
    text += "".join(f"\n{part}\n" for part in d.parts)
    more = f', start="{start}"' if start != "error" else ""
    return text + (
        f'\nCASE = Case(\n    name="scene",\n    problem={problem},\n    x0={array(x)},\n'
        f"    t={_times(c, t0)}{more},\n)\n"
    )


def _times(c: Choices, t0: float) -> str:
    T = t0 + c.pick((1.0, 2.0, 0.7, 5.0, 1e-6))
    k = c.pick((11, 6, 21, 2))
    if k > 2 and c.rarely(6):
        inner = np.sort(np.random.default_rng(c.below(1000)).uniform(t0, T, k - 2))
        return array([t0, *inner, T])
    return f"np.linspace({t0!r}, {T!r}, {k})"
