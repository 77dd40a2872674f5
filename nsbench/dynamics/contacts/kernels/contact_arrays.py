"""Named tuples of arrays by which kernels receive candidate contacts and data of constraints.

A contact k has the gap

    ROW      g = A[p] x + b[p]
    PAIR     g = sign (|x_p - x_q| - d)     p, q: first coordinates of two particles
    ANCHOR   g = sign (|x_p - a_q| - d)     q: first coordinate of an anchor
    SMOOTH   evaluated by the caller; kernels skip it

numba compiles a NamedTuple to the same code as a tuple.
"""

from typing import NamedTuple

import numpy as np

ROW = 0
PAIR = 1
ANCHOR = 2
SMOOTH = 3


class Contacts(NamedTuple):
    """Candidate contacts: arrays of length m.

    kind: ROW, PAIR, ANCHOR or SMOOTH. p, q: see the gaps above. d: distance, in units of length.
    sign: +1 for a least, -1 for a greatest distance. dim: coordinates of a particle.
    """

    kind: np.ndarray
    p: np.ndarray
    q: np.ndarray
    d: np.ndarray
    sign: np.ndarray
    dim: np.ndarray


class Layout(NamedTuple):
    """Data of the constraints at one time.

    anchors: coordinates of all anchors, one after the other. ptr, cols, vals: rows A as CSR. b:
    their constants.
    """

    anchors: np.ndarray
    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray
    b: np.ndarray


class ListedContacts(NamedTuple):
    """Candidate contacts with their ids: arrays of length m, in the order of a sweep or by id.

    family, i, j: the id (j = -1 where it has no second index); the rest as in Contacts.
    """

    kind: np.ndarray
    family: np.ndarray
    i: np.ndarray
    j: np.ndarray
    p: np.ndarray
    q: np.ndarray
    d: np.ndarray
    sign: np.ndarray
    dim: np.ndarray


class AffineRows(NamedTuple):
    """Rows of all affine families.

    A as CSR: ptr, cols, vals; and 1/|A_r|^2 of each row r.
    """

    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray
    inv2: np.ndarray
