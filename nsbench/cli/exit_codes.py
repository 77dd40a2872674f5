"""Exit codes of the command line."""

FINE = 0
REGRESSION = 1  # a number is not as in the baseline (nsbench gate)
USAGE = 2  # an argument, a name or a file of the user is wrong
FAILED = 3  # some runs failed unexpectedly
NOTHING_COMPARED = 4  # nothing, or too little, could be compared
BROKEN = 5  # infrastructure: results, disk, cluster or installation
INTERRUPTED = 130
