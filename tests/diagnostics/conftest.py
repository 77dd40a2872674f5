"""What is said of runs depends on their states, not on how the physics of their cases were made."""

import pytest


@pytest.fixture(autouse=True)
def physics_interpreted(interpreted):
    """Nothing of the hundreds of cases here is compiled."""
