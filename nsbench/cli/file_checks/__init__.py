"""What `nsbench check` asks of a case file and of a solver file."""
