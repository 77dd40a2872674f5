"""Linear complementarity problems  0 <= lam _|_ w = r + M lam >= 0  of moderate size.

`gram_lcp` for Gram matrices M = G G^T of any rank, as contacts have: an active-set method that
returns a basic solution. `lemke` for a general square M, as circuits have: Lemke's method with
lexicographic pivoting, least-norm solutions, and a test whether the motion is unique.
"""
