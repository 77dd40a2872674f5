"""Bisection of a function of time."""

HALVINGS = 50


def zero_between(f, low: float, high: float) -> float:
    """A zero of f between two times at which it has different signs; above 0.0 or not is all that
    is asked of f."""
    positive = f(low) > 0.0
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if (f(mid) > 0.0) == positive else (low, mid)
    return 0.5 * (low + high)
