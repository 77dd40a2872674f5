"""Random scenes as case files, runs of them by any method, and what a run that says ok is held
to."""
