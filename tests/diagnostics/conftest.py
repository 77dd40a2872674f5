"""What is said of runs depends on their states, not on how the physics of their cases were made."""

import pytest


@pytest.fixture(autouse=True)
def physics_interpreted(request):
    """Nothing of the hundreds of cases here is compiled, but where a test asks for it."""
    if "compiled" not in request.keywords:
        request.getfixturevalue("interpreted")
