"""Study of budgets: many small steps of PBD or few large ones of catching-up, at equal error."""
