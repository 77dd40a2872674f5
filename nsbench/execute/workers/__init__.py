"""Supervised worker processes on this machine (no imports: see nsbench.execute.workers.start)."""
