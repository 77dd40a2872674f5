"""Operation codes of the programs that compiled kernels interpret, shared with the tracer.

An operation computes row e of a table from rows a and b and constants c and d. PAIRS are computed
together with their partner, which is the next row. No numba here: the tracer must not import it.
"""

CONST = 0  # c
ADD = 1  # a + b
SUB = 2  # a - b
MUL = 3  # a b
DIV = 4  # a / b
AFFINE = 5  # c a + d
RDIV = 7  # c / a
SQR = 8  # a a
POW = 9  # a ** c, a > 0
EXP = 10
LOG = 11  # b is a
ATAN = 12  # b is 1 + a a
# a pair
SIN = 13
COS = 14
# a pair
SINH = 15
COSH = 16
# a pair: tanh a and its slope 1 - tanh(a)^2
TANH = 17
SECH2 = 18
PAIRS = {SIN: COS, SINH: COSH, TANH: SECH2}
