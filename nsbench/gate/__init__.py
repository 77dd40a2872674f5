"""The gate: numbers of a study against a reviewed baseline, one number per line, each with its own
tolerance.

`facts` turns a folder of results into numbers with the configuration they were made under;
`baseline` reads and writes the file that people review; `judge` compares the two. Nothing here runs
a solver, and no second is ever compared.
"""
