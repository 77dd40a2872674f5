"""Study of multipliers: how fast they settle, what sweeps and substeps buy, error bars."""
