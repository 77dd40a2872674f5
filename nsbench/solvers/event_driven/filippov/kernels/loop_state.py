"""Named tuples and codes that the compiled Filippov loop shares with its driver.

No numba here: the tracer lays programs out as `Programs` and must not import it.
"""

from typing import NamedTuple

import numpy as np

# why `integrate_modes` returns
END = 0  # the last sample time is reached
MEET = 1  # a surface was reached and the next mode is not certain
HARD = 2  # a step could not be certified
STEPS = 3  # as many steps as are allowed were taken
FULL = 4  # the event log is full
START = 5  # the mode at the start is not certain
KINK = 6  # the drift jumps at a kink, and both sides lead to it
APART = 7  # the drift jumps at a kink at the start, and both sides lead away from it
STEP_VANISHES = -3  # value of FIRED, with HARD: the step length is below rounding of the time

# indices of the integer counters of a run
CODE, DONE, COUNT, ARCS, CALLS, EVENTS, MEETINGS, FIRED, CARRY = range(9)
COUNTERS = 9
# indices of the float values of a run
TIME, LONGEST = range(2)
FLOATS = 2

# columns of Programs.first: first operation, and the ends of the leading ones and of all
BEGIN, LEADING_END, ALL_END = range(3)
# columns of Records.logged: surface, modes before and after
SURFACE, MODE_BEFORE, MODE_AFTER = range(3)

WINDOW = 3  # events per window of the test for accumulation
RING = 2 * WINDOW + 1  # times of the latest events, as many as that test needs


class Kinks(NamedTuple):
    """Kinks of several programs: arguments a with breaks b_1 < ... < b_m (see tracing.kinks).

    state (K,): how many breaks lie below a. spans (K, 4): first entry and number of its breaks, and
    of its patches. patches (P, 3): operation that depends on the state, its column (0: constant c,
    1: row a), first of its entries; entries[that + state] is what the column holds. Programs are
    those for the present states.
    """

    state: np.ndarray
    spans: np.ndarray
    breaks: np.ndarray
    patches: np.ndarray
    entries: np.ndarray


class Programs(NamedTuple):
    """Operations of several programs, one after the other.

    ops (e, 3): operation code, rows a and b. nums (e, 2): constants c and d (see opcodes).
    Program m consists of operations first[m, BEGIN] : first[m, ALL_END]; those up to
    first[m, LEADING_END] compute its leading outputs, the state's derivatives. Operation e of
    program m computes row n + 1 + e - first[m, BEGIN] of a table; rows 0 .. n - 1 are the state
    and row n is the time.
    outs[m, j]: the row of output j, -1 for none. rows: the largest number of rows. kinks: of all.
    """

    ops: np.ndarray
    nums: np.ndarray
    first: np.ndarray
    outs: np.ndarray
    rows: int
    kinks: Kinks


class Modes(NamedTuple):
    """Programs of the modes. table (3^d,): program of a mode, -1 for none; the mode is read as a
    number with the digits mode_i + 1 to the base 3. slides (programs,): the surface that a program
    slides on, or -1."""

    table: np.ndarray
    slides: np.ndarray


class Settings(NamedTuple):
    """order: of the Taylor series. span: the own time of the case. local_error: allowed per step.
    longest_step, steps, events: limits of the length of a step and of the numbers of both."""

    order: int
    span: float
    local_error: float
    longest_step: float
    steps: int
    events: int


class Motion(NamedTuple):
    """Where a motion is: state x (n,), integrals of the weights theta (d,), mode (d,), and which
    watched functions are armed (d + 2 K + 1,), that is, far enough above zero to fall through it:
    those of the surfaces, of the kinks and of the weight."""

    x: np.ndarray
    theta: np.ndarray
    mode: np.ndarray
    armed: np.ndarray


class Records(NamedTuple):
    """What a run writes. At the sample times (K,): states X (K, n) and weight integrals W (K, d).
    log (cap, 2): time and weight integral of each event; logged (cap, 3): its surface and the modes
    before and after. ring (RING,): times of the latest events, the last one latest."""

    times: np.ndarray
    X: np.ndarray
    W: np.ndarray
    log: np.ndarray
    logged: np.ndarray
    ring: np.ndarray


class Workspace(NamedTuple):
    """Work arrays of a run; w = d + 2 K + 1 functions are watched.

    C (rows, p + 1): Taylor coefficients of all operations on a step. Q (n + w, p + 1):
    polynomials of the state and of the watched functions on a piece of it. M, R (rows, ORDER + 1):
    midpoints and radii of the enclosure there. V (rows, ORDER): values at points. error (w,):
    what those polynomials miss of the watched functions. lift (w,): time after which a watched
    function that is not armed is above its band. band (w,): what rounding leaves of each.
    stack, shifted: for `first_fall`. G (d + K, n + 2): gradient, time derivative and value of each
    switch function and each argument of a kink. F (2, n): fields on both sides of a surface.
    y (n,): a state. D (rows, p + 1): Taylor coefficients of a trial motion.
    """

    C: np.ndarray
    Q: np.ndarray
    M: np.ndarray
    R: np.ndarray
    V: np.ndarray
    error: np.ndarray
    lift: np.ndarray
    band: np.ndarray
    stack: np.ndarray
    shifted: np.ndarray
    G: np.ndarray
    F: np.ndarray
    y: np.ndarray
    D: np.ndarray


class Run(NamedTuple):
    """All that a run of `integrate_modes` works on. counters (COUNTERS,), floats (FLOATS,): by the
    indices above."""

    programs: Programs
    modes: Modes
    settings: Settings
    motion: Motion
    records: Records
    counters: np.ndarray
    floats: np.ndarray
    work: Workspace
