"""Execution of a study: plan, workers, cluster, progress (no imports: see workers.start)."""
