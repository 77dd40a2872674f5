"""Study of the sweep lemma: one sweep of PBD multiplies the largest violation by C at most.

C' is the same of the sum of all violations. For the linearised sweep (packings.linear_sweep) over
all gaps g >= -1 and all orders,

    C  = max of max_k v'_k,        C' = max of |v'|_1 / |v|_1:

`proven_bound` from above, `exact_constant` by mixed-integer programming, `adversarial_search` from
below, `random_packings` for how likely large values are, `rare_constants` for their tail,
`sweep_orders` for the best order.
"""
