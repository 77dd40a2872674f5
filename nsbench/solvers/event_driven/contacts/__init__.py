"""Event-driven method for gradient systems with constraints: arcs with fixed active contacts.

host_loop: arcs and active sets in Python. compiled_loop: driver of the compiled loop in kernels,
for constraints at rest. active_set: the velocity LCP with look-ahead, for both. gram_matrix: its
matrix. evaluation: drift, gaps and gradients. affine_drift: proof that a drift is affine.
drift_program: its traced operations otherwise. kinked_drift: a drift in fixed states of its kinks.
preparation: which of them a case takes.

A contact has these forms:

    id         (family, i) or (family, i, j), in trajectories and events
    key        one integer per id; compares lists of candidates (CandidateContacts.key)
    entry      index among the m candidates; changes when the candidates are rebuilt
    mask       is_active, is_closed (closed): booleans over the candidates
    position   index among some entries: `active` (ascending entries), or the closed contacts
    column     of the impulses: one for every contact that ever acted, in order of first action
    role       OPEN, LEAVING, DEPENDENT or ACTIVE, while kernels choose the next active set

Conversions: entry to id by ContactRows.listed.ids; entry to entry of new candidates by key in
ContactIntegrator.rebuild_candidates; entry to column by id in Python and by Accumulated.column in
kernels, which KernelDriver fills by key; position to entry by indexing `active`, entry to position
by sorted_index; role to masks when the kernel logs the events of a choice.
"""
