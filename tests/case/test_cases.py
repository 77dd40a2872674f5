"""Every case builds, starts where it says it may, and its physics is the same in numpy, numba and
JAX."""

import functools
import time
import tracemalloc

import numpy as np
import pytest

from nsbench import LCS, Complementarity, Filippov, get_case
from nsbench.case import broken_cases, case_module, case_names
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers import get, grid

SETS = {name: getattr(case_module(name), "SUITES", {"standard": [{}]}) for name in case_names()}
SPECS = [
    pytest.param(name, params, id=f"{name}{sorted(params.items()) or ''}")
    for name, suites in SETS.items()
    for params in {str(p): p for suite in suites.values() for p in suite}.values()
]


def test_no_case_file_is_broken():
    assert broken_cases() == {}


@pytest.mark.parametrize("name, suites", SETS.items(), ids=SETS)
def test_suites_have_known_names(name, suites):
    assert set(suites) <= {"smoke", "standard", "hard", "full"}


@pytest.mark.parametrize("name, params", SPECS)
def test_case_builds_and_says_what_it_is(name, params):
    case = get_case(name, **params)
    assert case.name == name
    assert len(case.doc) > 100 and len(case.doc.splitlines()) > 3, (
        "a case is described by its module's docstring"
    )
    assert get_case(case.key).key == case.key
    for spec in case.also:
        get(spec)


@pytest.mark.parametrize("name, params", SPECS)
def test_the_ladder_of_steps_stays_affordable(name, params):
    case = get_case(name, **params)
    finest = grid(case.t, np.diff(case.t).min() / (64 * case.substeps))
    coarsest = grid(case.t, np.diff(case.t).min() / case.substeps)
    assert coarsest.aligned and finest.aligned
    if params in SETS[name].get("standard", []):  # full lengths are in "full" because they are long
        assert finest.substeps.sum() <= 60000


@pytest.mark.long
@pytest.mark.parametrize("name, params", SPECS)
def test_the_start_is_feasible_unless_the_case_says_otherwise(name, params):
    case = get_case(name, **params)
    if not isinstance(case.problem, Complementarity):
        return
    scene = ConstraintSet(case.problem, case.n)
    t = float(case.t[0])
    near = scene.near(case.x0, 1e-3, t)
    least = scene.gaps(t, case.x0, near).min(initial=np.inf)
    assert least >= -1e-12 if case.start == "error" else least < 0.0


def functions(case):
    """(name, factory, its compiled form or None, sizes of its arguments after t) of all physics in
    the case."""
    from nsbench.compilation.factories import rhs_cfunc, signed_rhs_cfunc

    p = case.problem
    if isinstance(p, Complementarity):
        return [("drift", p.drift, rhs_cfunc(p.drift, case.n), (case.n,))]
    if isinstance(p, Filippov):
        d = len(p.switch(np)(0.0, case.x0.copy()))
        return [
            ("field", p.field, signed_rhs_cfunc(p.field, case.n, d), (case.n, d)),
            ("switch", p.switch, None, (case.n,)),
        ]
    assert isinstance(p, LCS)
    from nsbench.dynamics.lcs import drift_of

    return [("A x + u", drift_of(p), rhs_cfunc(drift_of(p), case.n), (case.n,))]


@functools.cache
def caller(count):
    """A compiled function that calls a function pointer, as kernels do."""
    import numba

    return numba.njit(
        (lambda f, t, x, out: f(t, x, out))
        if count == 1
        else (lambda f, t, x, s, out: f(t, x, s, out))
    )


def kinds():
    """One of the parameter sets for each set of names of parameters that physics see: compiling is
    slow, and a number is only a number."""
    unseen = {"T", "seed", "r_hard"}
    return {(p.values[0], *sorted({*p.values[1]} - unseen)): p for p in reversed(SPECS)}.values()


@pytest.mark.long
@pytest.mark.parametrize("name, params", kinds())
def test_numpy_numba_and_jax_agree(name, params):
    from nsbench.compilation.factories import as_jax

    case = get_case(name, **params)
    rng = np.random.default_rng(1)
    for what, factory, compiled, sizes in functions(case):
        host = factory(np)
        jaxed = as_jax(factory)
        for t in (0.0, 0.7):
            x = case.x0 + 0.01 * rng.standard_normal(case.n)
            args = [x, *(rng.uniform(-1, 1, k) for k in sizes[1:])]
            want = host(t, *args)
            scale = np.abs(want).max() + np.abs(x).max() + 1e-300
            others = [np.asarray(jaxed(t, *args))]
            if compiled is not None:
                others.append(np.full(case.n, np.nan))
                caller(len(args))(compiled, t, *args, others[-1])
            for other in others:
                assert other.dtype == np.float64 and np.abs(other - want).max() <= 1e-14 * scale, (
                    what
                )


def nearest(x):
    from scipy.spatial import cKDTree

    p = x.reshape(-1, 2)
    return cKDTree(p).query(p, k=2)[0][:, 1].min()


@pytest.mark.parametrize("n", [2, 3, 7, 30, 100, 1000])
@pytest.mark.parametrize("params", [{}, {"box": True}, {"labels": "rows"}], ids=str)
def test_random_discs_do_not_overlap(n, params):
    for seed in range(20):
        case = get_case("discs", n=n, seed=seed, **params)
        assert nearest(case.x0) >= 2.0 + (1e-3 if params.get("box") else 1e-2)
        if params.get("box"):
            wall = case.problem.constraints[1]
            assert (wall.data * case.x0[wall.indices] + wall.b).min() >= 0.0


def test_many_discs_are_built_quickly_and_without_a_list_of_pairs():
    n = 100_000
    tracemalloc.start()
    begun = time.perf_counter()
    case = get_case("discs", n=n, box=True)
    seconds = time.perf_counter() - begun
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seconds < 10.0  # about 0.3; five thousand million pairs would take minutes
    assert peak < 1500 * n  # bytes: state, walls and what is sorted, but nothing like n^2
    assert nearest(case.x0) > 2.0
    assert case.problem.constraints[0].all_pairs


@pytest.mark.parametrize("n, contacts, rank", [(7, 12, 11), (19, 42, 35), (37, 90, 71)])
def test_closed_hexagons_have_redundant_contacts(n, contacts, rank):
    case = get_case("hex", n=n)
    scene = ConstraintSet(case.problem, case.n)
    x = case.exact(case.t[-1:])[0]
    near = scene.near(x, 1e-9, 0.0)
    assert len(near) == contacts
    assert np.linalg.matrix_rank(scene.gradients(0.0, x, near).toarray(), rtol=1e-10) == rank


def test_the_hanging_chain_is_in_equilibrium_to_rounding():
    case = get_case("chain", hanging="rest")
    beads = np.vstack(([0.0, 0.0], case.x0.reshape(-1, 2), [0.6 * 31, 0.0]))
    links = np.diff(beads, axis=0)
    assert np.abs(np.linalg.norm(links, axis=1) - 1.0).max() < 1e-13
    load = case.exact_impulse(np.array([0.0, 1.0]))[1]
    tension = np.concatenate((load[:1], load[2:], load[1:2]))
    force = tension[1:, None] * links[1:] - tension[:-1, None] * links[:-1] + [0.0, -1.0]
    assert np.abs(force).max() < 1e-12


@pytest.mark.parametrize(
    "spec",
    [
        "wedge[psi=5]",
        "wedge[swell=1]",
        "rods[n=1]",
        "hex[n=8]",
        "discs[n=0]",
        "discs[packing=0.95]",
        "discs[labels=x]",
        "chain[pull=x]",
        "chain[zigzag=0.5]",
        "chain[slack=0]",
        "stack[n=0]",
        "three_discs[overlap=x]",
    ],
)
def test_a_bad_parameter_is_named(spec):
    parameter = spec.split("[")[1].split("=")[0]
    with pytest.raises(ValueError, match=parameter):
        get_case(spec)
