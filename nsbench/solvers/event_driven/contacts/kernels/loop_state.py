"""Places in the arrays that kernels.walk and its caller share; codes of what it returns and writes
down."""

(T, END, TOL, EPS, SIZE, MAX_STEP, BOX, REACH, H, DOUBT, STRICT, DEPENDENT, UNIT, FLOATS) = range(
    14
)
(
    SAMPLE,
    STEPS,
    EVENTS,
    COLUMNS,
    FIRED,
    ENTRY,
    TOUCHES,
    ARCS,
    SOLVED,
    PEAK,
    ORDERS,
    MAX_STEPS,
    PACES,
    INTS,
) = range(14)
DONE, CHOOSE, RELIST, FAIL, PAUSE = range(5)
# kinds of events; FIRST is added to the first of an instant
CLOSED = 0
OPENED = 1
PIVOT = 2
FIRST = 4
