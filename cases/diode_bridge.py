"""LC oscillator that feeds a resistor through a bridge of four diodes.

    v' = -(i + lam3 - lam4)/C,   i' = v/L,   v(0) = 10 V, i(0) = 0
    w1 = (lam1 + lam2)/R - lam3,   w2 = (lam1 + lam2)/R - lam4,   w3 = lam1 - v,   w4 = lam2 + v,   0 <= w _|_ lam >= 0

lam1, lam2 (V) block, lam3, lam4 (A) conduct; D has no inverse and is positive semidefinite only, its skew part joins
voltages to currents. For v > 0: w3 = 0 gives lam1 = v, w1 = 0 gives lam3 = v/R, the others vanish; for v < 0 the same
with the other pair. So lam3 - lam4 = v/R at all times: the state is a smooth damped oscillation, all four diodes switch
at each zero of v.
Exact: v = v0 e^(-a t) (cos om t - (a/om) sin om t), i = v0/(L om) e^(-a t) sin om t, a = 1/(2 R C),
om^2 = 1/(L C) - a^2; switches at arctan(om/a)/om + k pi/om. Impulses from the coil: int v dt = L (i(t) - i(s)).
What it is for: a trapezoid must be of order two in the state, switches or not.
"""
import numpy as np

from nsbench import LCS, Case


def make(L: float = 1e-2, C: float = 1e-6, R: float = 1e3, v0: float = 10.0, T: float = 5e-3) -> Case:
    """L (H), C (F), R (ohm): coil, capacitor, resistor; v0 (V): first voltage; T (s): end. 4 R^2 C > L: it oscillates."""
    for name, value in (("L", L), ("C", C), ("R", R), ("v0", v0), ("T", T)):
        if not value > 0:
            raise ValueError(f"{name} is {value!r}; a positive number is needed")
    a, om0 = 1 / (2 * R * C), 1 / np.sqrt(L * C)
    if not a < om0:
        raise ValueError(f"R is {R!r}; more than {np.sqrt(L / C) / 2:g} ohm is needed for an oscillation")
    om = np.sqrt(om0**2 - a**2)
    zeros = (np.arctan2(om, a) + np.pi * np.arange(int(T * om / np.pi) + 2)) / om

    def current(t):
        return v0 / (L * om) * np.exp(-a * t) * np.sin(om * t)

    def exact(t):
        v = v0 * np.exp(-a * t) * (np.cos(om * t) - a / om * np.sin(om * t))
        return np.stack((v, current(t)), axis=1)

    knots = np.concatenate(([0.0], current(zeros)))           # the current where each arc begins
    gains = L * np.abs(np.diff(knots))                        # |int v dt| over each arc
    sums = np.zeros((2, len(zeros) + 1))
    for side in (0, 1):                                       # v > 0 on arcs of even number
        sums[side, 1:] = np.cumsum(np.where(np.arange(len(zeros)) % 2 == side, gains, 0.0))

    def exact_impulse(t):
        k = np.searchsorted(zeros, t, side="right")
        now = L * np.abs(current(t) - knots[k])
        plus, minus = (sums[side, k] + np.where(k % 2 == side, now, 0.0) for side in (0, 1))
        return np.stack((plus, minus, plus / R, minus / R), axis=1)

    return Case(
        name="diode_bridge",
        problem=LCS(A=[[0, -1 / C], [1 / L, 0]],
                    B=[[0, 0, -1 / C, 1 / C], [0, 0, 0, 0]],
                    C=[[0, 0], [0, 0], [-1, 0], [1, 0]],
                    D=[[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]]),
        x0=np.array([v0, 0.0]),
        t=np.linspace(0.0, T, 201),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(zeros[zeros < T]),
        also=("theta[theta=0.5]",),
        tags=("lcs", "circuit"),
    )
