"""LC oscillator that feeds a resistor through one diode.

    v' = -(i + lam)/C,   i' = v/L,   w = R lam - v,   0 <= w _|_ lam >= 0,   v(0) = 10 V, i(0) = 0

v is the voltage of the capacitor, i the current of the coil, lam that of the diode, w the voltage it blocks. The diode
conducts while v > 0: lam = v/R, and the circuit is damped; while v < 0 nothing is lost.
Exact: with a = 1/(2 R C), om0^2 = 1/(L C), om^2 = om0^2 - a^2 a conducting arc is v = e^(-a s) times a combination of
cos om s and sin om s, a blocking one the undamped oscillation. The first arc starts at rest and ends at
om t1 = arctan(om/a); each later one starts at v = 0, so conducting arcs last pi/om and blocking ones pi/om0: 16 switches
in 5 ms. The impulse follows from the coil: int v dt = L (i(t) - i(s)), so a conducting arc adds L/R (i(t) - i(s)).
What it is for: D > 0, the multiplier is continuous with kinks, so a trapezoid keeps order two in the state.
"""
import numpy as np

from nsbench import LCS, Case


def positive(**values):
    for name, v in values.items():
        if not v > 0:
            raise ValueError(f"{name} is {v!r}; a positive number is needed")


def damped(s, v, i, a, L, C):
    """(v, i) after the time s of v' = -i/C - 2 a v, i' = v/L, from (v, i)."""
    om = np.sqrt(1 / (L * C) - a * a)
    decay, c, sn = np.exp(-a * s), np.cos(om * s), np.sin(om * s)
    return decay * (v * c - (i / C + a * v) / om * sn), decay * (i * c + (v / L + a * i) / om * sn)


def make(L: float = 1e-2, C: float = 1e-6, R: float = 1e3, v0: float = 10.0, T: float = 5e-3) -> Case:
    """L (H), C (F), R (ohm): coil, capacitor, resistor; v0 (V): first voltage; T (s): end. 4 R^2 C > L: it oscillates."""
    positive(L=L, C=C, R=R, v0=v0, T=T)
    a, om0 = 1 / (2 * R * C), 1 / np.sqrt(L * C)
    if not a < om0:
        raise ValueError(f"R is {R!r}; more than {np.sqrt(L / C) / 2:g} ohm is needed for an oscillation")
    om = np.sqrt(om0**2 - a**2)
    times, states, sums = [0.0], [(v0, 0.0)], [0.0]           # start of each arc; conducting ones have even numbers
    while times[-1] < T:
        on = len(times) % 2 == 1
        length = np.arctan2(om, a) / om if len(times) == 1 else np.pi / (om if on else om0)
        _, i = damped(length, *states[-1], a if on else 0.0, L, C)
        sums.append(sums[-1] + (L / R * (i - states[-1][1]) if on else 0.0))
        times.append(times[-1] + length)
        states.append((0.0, i))
    times, states, sums = np.array(times), np.array(states), np.array(sums)

    def arcs(t):
        k = np.searchsorted(times, t, side="right") - 1
        on = k % 2 == 0
        return k, on, damped(t - times[k], *states[k].T, np.where(on, a, 0.0), L, C)

    def exact(t):
        return np.stack(arcs(t)[2], axis=1)

    def exact_impulse(t):
        k, on, (_, i) = arcs(t)
        return (sums[k] + np.where(on, L / R * (i - states[k][:, 1]), 0.0))[:, None]

    return Case(
        name="rlc_diode",
        problem=LCS(A=[[0, -1 / C], [1 / L, 0]], B=[[-1 / C], [0]], C=[[-1, 0]], D=[[R]]),
        x0=np.array([v0, 0.0]),
        t=np.linspace(0.0, T, 201),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(times[1:][times[1:] < T]),
        also=("theta[theta=0.5]",),
        tags=("lcs", "circuit"),
    )
