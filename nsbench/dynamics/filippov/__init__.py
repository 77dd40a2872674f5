"""Evaluate Filippov systems: modes, sliding velocity, switch rates, distance to Filippov's set."""
