"""Study of stability: status and error of every method over step and difficulty; held stacks."""
