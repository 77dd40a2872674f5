"""PBD on several threads gives the bytes of one thread, and says where threads make no sense."""

import itertools

import numpy as np
import pytest
from test_pbd import box_of_discs
from test_pbd_packed import scene

import nsbench
from nsbench import Affine, Complementarity, Distance, solvers
from nsbench.solvers.pbd.kernels.conflict_schedule import divide, schedule


def bytes_of(traj):
    counted = tuple(traj.stats[k] for k in ("projections", "rebuilds", "contacts_peak", "loop"))
    return (
        traj.x.tobytes(),
        traj.reaction.tobytes(),
        traj.impulse.tobytes(),
        tuple(traj.contacts),
        traj.status,
        counted,
    )


def same_for_all(case, spec, h, most=4):
    one = bytes_of(nsbench.solve(case, f"pbd[{spec}]", h=h))
    for threads in range(2, most + 1):
        assert bytes_of(nsbench.solve(case, f"pbd[{spec},threads={threads}]", h=h)) == one, threads


@pytest.mark.parametrize("order", ["coloured", "random"])
def test_dense_discs_give_the_same_bytes_on_one_to_four_threads(order):
    same_for_all(nsbench.get_case("discs", n=900, box=True), f"order={order}", 0.02)


def test_more_threads_than_rows_of_discs_give_the_same_bytes():
    same_for_all(nsbench.get_case("discs", n=9), "order=coloured", 0.05, 11)


@pytest.mark.parametrize("kind", ["plane", "line", "space", "radii", "moving"])
def test_several_sweeps_that_break_their_certificate_give_the_same_bytes(kind):
    case = scene({"line": 1, "space": 3}.get(kind, 2), 1, kind == "radii", kind == "moving")
    same_for_all(case, "order=coloured,sweeps=2,reach=0.05", 0.02)


def test_lists_that_outgrow_their_arrays_give_the_same_bytes():
    case = box_of_discs(1000, 0.8, "overlapping").replace(t=np.linspace(0.0, 0.06, 3))
    same_for_all(case, "order=coloured,reach=5", 0.02, 3)


def test_a_strip_waits_for_nobody_and_a_border_for_strips_alone():
    """Over random constraints, those of a class depend on earlier ones of that class and, on
    borders, of strips."""
    rng = np.random.default_rng(5)
    n = 400
    m = 900
    i = rng.integers(0, n - 9, m).astype(np.int32)
    j = np.where(rng.random(m) < 0.1, -1, i + rng.integers(1, 9, m)).astype(np.int32)
    keys = rng.permutation(m).astype(np.uint64)
    row = (np.arange(n) // 20).astype(np.int32)
    after = np.empty(2 * m, np.int32)
    place = np.empty(m, np.int32)
    room = np.empty(2 * m, np.int32)
    need = np.empty(m, np.int8)
    schedule(i, j, keys, row, np.empty(n + 1, np.int32), room, after, need, place)
    for threads in (2, 3, 5, 25):  # of 25 strips, some constraints wait for two borders
        divided = place.copy()
        ends = np.zeros(2 * threads + 3, np.int64)
        divide(i, j, after, divided, room[:m], need, n, ends)
        assert sorted(divided) == list(range(m)) and ends[-1] == m
        kind = np.searchsorted(ends, divided, side="right") - 1
        for a in range(n):  # constraints on a particle, by key: each waits for the one before
            own = sorted(np.flatnonzero((i == a) | (j == a)), key=lambda c: keys[c])
            for c, d in itertools.pairwise(own):
                assert divided[c] < divided[d]
                assert (
                    kind[c] == kind[d] or kind[c] < threads <= kind[d] or kind[d] == 2 * threads + 1
                )
        assert threads == 25 or ends[threads] > m / 2, "strips have most of the work"
        assert threads < 25 or ends[-1] > ends[-2], "and there is a rest"


def test_threads_are_refused_where_they_make_no_sense():
    case = nsbench.get_case("discs", n=30)

    def host(xp):
        table = {"rate": -1.0}  # a dictionary: numba compiles no closure over one

        def f(t, x):
            return table["rate"] * x

        return f

    linked = Complementarity(
        case.problem.drift, (*case.problem.constraints, Distance(3.0, sign=-1, pairs=[(0, 1)]))
    )
    for wrong, spec, word in (
        (case, "sorted", "coloured"),
        (case.replace(problem=linked), "coloured", "other constraints"),
        (
            case.replace(problem=Complementarity(host, case.problem.constraints)),
            "coloured",
            "Python",
        ),
        (nsbench.get_case("tide"), "coloured", "hard particles"),
    ):
        assert word in solvers.get(f"pbd[order={spec},threads=2]").refuses(wrong)
        assert solvers.get(f"pbd[order={spec}]").refuses(wrong) is None
    for bad in (0, 33, "2.5"):
        with pytest.raises(ValueError, match="threads"):
            solvers.get(f"pbd[order=coloured,threads={bad}]")


def test_an_end_in_nan_is_the_same_on_threads():
    def ends(xp):
        def f(t, x):
            return xp.sqrt(0.2 - t) * x

        return f

    walls = (Distance(2.0), Affine(np.eye(60), np.full(60, 40.0)))
    base = nsbench.get_case("discs", n=30)
    case = base.replace(problem=Complementarity(ends, walls), t=np.linspace(0.0, 0.4, 5))
    with np.errstate(invalid="ignore"):
        a, b = (nsbench.solve(case, f"pbd[order=coloured,threads={k}]", h=0.02) for k in (1, 3))
    assert a.status == b.status and a.status.code == "nan"
    assert np.array_equal(a.x, b.x, equal_nan=True) and np.array_equal(
        a.impulse, b.impulse, equal_nan=True
    )
