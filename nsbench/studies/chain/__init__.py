"""Study of chain reactions: how far one violation travels in one sweep of projections."""
