"""The event found is the first dip of the function that counts, wherever rounding puts the roots of
its series."""

import numpy as np
import pytest

from nsbench.solvers.event_driven.smooth.crossings import TOUCH, EventFunctions
from nsbench.solvers.event_driven.smooth.pieces import single_piece


def dense(t):
    return np.atleast_2d(np.asarray(t, float)) if np.ndim(t) else np.array([float(t)])


def product(roots):
    """Zero at the roots and positive before the first."""
    sign = 1.0 if len(roots) % 2 == 0 else -1.0
    return lambda t: sign * np.prod(np.asarray(t)[..., None] - roots, axis=-1)


def functions(rng):
    """(roots, touch, first crossing): beyond doubt is which dips are deeper than the touch, and
    that crossings are apart.

    The touch is from a tenth of the function down to 1e-16 of it: there the roots at zero and a
    touch below it are one.
    Every second function has grazed zero before, some 1e-9 to 1e-7 wide and less deep than a touch.
    """
    while True:
        roots = rng.uniform(0.05, 0.95, rng.integers(1, 5))
        if rng.random() < 0.5:
            roots = np.append(
                roots,
                rng.uniform(0.05, 0.95) + 10.0 ** rng.uniform(-9.0, -7.0) * np.array([0.0, 1.0]),
            )
        roots = np.sort(roots)
        touch = 10.0 ** rng.uniform(-16.0, -1.0)
        ends = np.append(roots, 1.0) if len(roots) % 2 else roots
        begins = ends[::2]
        widths = np.diff(ends)[::2]
        depths = np.array(
            [
                -product(roots)(np.linspace(a, a + w, 201)).min()
                for a, w in zip(begins, widths, strict=True)
            ]
        )
        counts = depths > 5.0 * touch
        between = np.diff(roots)[1::2].min(initial=1.0)
        if between > 1e-3 and np.all(np.where(counts, widths > 1e-3, depths < 0.2 * touch)):
            yield roots, touch, min(begins[counts], default=np.inf)


@pytest.mark.long
def test_the_first_dip_that_is_deep_enough_is_the_event():
    rng = np.random.default_rng(3)
    seen = set()
    draw = functions(rng)
    for _ in range(3000):
        (roots, touch, crossed), (others, less, later) = next(draw), next(draw)
        if abs(crossed - later) < 1e-3:
            continue
        scale = 10.0 ** rng.uniform(-3.0, 6.0, 2)
        f = product(roots)
        g = product(others)
        crossings = EventFunctions(
            lambda t, y, f=f, g=g, scale=scale: scale * [f(t), g(t)],
            scale * [touch, less] / TOUCH,
            [True, True],
            0.0,
            dense(0.0),
        )
        found = crossings.first(dense, [single_piece(dense, 0.0, 1.0)])
        seen.add((min(crossed, later) < np.inf, crossed > roots[0], later > others[0]))
        assert (found is not None) == (min(crossed, later) < np.inf), (
            roots,
            others,
            touch,
            less,
            scale,
        )
        if found is not None:
            assert abs(found[0] - min(crossed, later)) < 1e-11, (
                roots,
                others,
                touch,
                less,
                scale,
                found,
            )
            assert found[1] == (later < crossed) and found[2] < 0.0
    assert len(seen) == 5  # the first dip or a later one of both, and none


def test_a_crossing_of_third_order_is_found_to_the_last_digits():
    # its three roots, and the two of the slope, are noise about it; the function itself is not
    rng = np.random.default_rng(5)
    for _ in range(300):
        root = rng.uniform(0.2, 0.8)
        f = product(np.array([root] * 3 + [root + 0.3, 1.7][: rng.integers(0, 3)]))
        found = EventFunctions(
            lambda t, y, f=f: np.array([f(t)]),
            10.0 ** rng.uniform(-12.0, -4.0),
            [True],
            0.0,
            dense(0.0),
        ).first(dense, [single_piece(dense, 0.0, 1.0)])
        assert found is not None and abs(found[0] - root) < 1e-15, (root, found)
