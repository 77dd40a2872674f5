"""Control of the Verlet skins of cell_loop: how far lists and active candidates reach.

A wide skin lasts many steps but makes a long list. The active skin follows the pace of the
particles (active_candidates.inner_skin); a part of it, the reserve, is left to what the sweep
itself moves. Where a new selection was still too narrow, the skin is widened until the sweeps are
calm again.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import fused_kernel, inner_kernel

HALF = 0.4999  # of a skin that a particle may move, less rounding
CALM_STEPS = 8  # steps without a broken certificate after which skins that were widened shrink


class Skins(NamedTuple):
    """Skins, all in units of length.

    pairs: of the list. active: asked for the active candidates. rows: displacement for which
    near_rows is still valid. certified: what the active candidates are certified for.
    """

    pairs: float
    active: float
    rows: float
    certified: float


class SkinControl(NamedTuple):
    """Control of the skins by what the sweeps did.

    least: smallest skin of a list. radius: mean radius. reserve: part of the certified skin that is
    kept for the sweep. widened: skin demanded by violent sweeps, 0 if there are none. pace: largest
    displacement per step. age: steps since the selection. calm: steps since a sweep was undone.
    """

    least: float
    radius: float
    reserve: float
    widened: float
    pace: float
    age: int
    calm: int


@fused_kernel
def needs_selection(
    far: float, attempts: int, rebuilds: int, control: SkinControl, certified: float
) -> bool:
    """Return whether the active candidates must be selected anew before the sweep.

    far: largest squared displacement since they were; attempts: sweeps of this step undone.
    """
    # a widened skin is there for the sweep: it needs no reserve besides
    reserve = control.reserve if control.widened == 0.0 else 0.0
    return rebuilds == 0 or attempts > 0 or far > ((HALF - reserve) * certified) ** 2


@inner_kernel
def adapt_to_pace(control: SkinControl, far: float, rebuilds: int) -> SkinControl:
    """Measure the pace since the last selection, and shrink the reserve: it sufficed."""
    return SkinControl(
        control.least,
        control.radius,
        max(0.05, 0.97 * control.reserve) if rebuilds > 0 else control.reserve,
        control.widened,
        np.sqrt(far) / max(control.age, 1),
        control.age,
        control.calm,
    )


@fused_kernel
def adapt_to_undone_sweep(control: SkinControl, active_skin: float) -> SkinControl:
    """Widen the skin if a new selection was too narrow, else enlarge the reserve."""
    is_new = control.age == 0
    return SkinControl(
        control.least,
        control.radius,
        control.reserve if is_new else min(0.3, 1.25 * control.reserve),
        1.5 * max(control.least, active_skin) if is_new else control.widened,
        control.pace,
        control.age,
        control.calm,
    )


@fused_kernel
def with_age(control: SkinControl, age: int) -> SkinControl:
    """Return the control with the age of the selection set."""
    return SkinControl(
        control.least,
        control.radius,
        control.reserve,
        control.widened,
        control.pace,
        age,
        control.calm,
    )


@fused_kernel
def adapt_after_step(
    control: SkinControl, skins: Skins, attempts: int
) -> tuple[SkinControl, Skins]:
    """Shrink a widened skin after enough calm steps; returns control and skins."""
    # back by the factor 1.5 by which adapt_to_undone_sweep widens
    calm = control.calm + 1 if attempts == 0 else 0
    widened = control.widened
    certified = skins.certified
    if calm > CALM_STEPS and widened > 0.0:
        widened = widened / 1.5 if widened > 1.5 * control.least else 0.0
        calm = 0
        certified = 0.0 if widened == 0.0 else certified
    return (
        SkinControl(
            control.least,
            control.radius,
            control.reserve,
            widened,
            control.pace,
            control.age,
            calm,
        ),
        Skins(skins.pairs, skins.active, skins.rows, certified),
    )
