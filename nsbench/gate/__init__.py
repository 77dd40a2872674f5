"""The gate: numbers of a study against a reviewed baseline, each number with its own tolerance.

A baseline has one number per line.

`facts` turns a folder of results into numbers with the configuration they were made under;
`baseline` reads and writes the file that people review; `comparison` compares the two; `calibrate`
makes the runs again from perturbed starts, whose `spreads` become tolerances; `update` brings a
baseline up to date. `compared_numbers` and `comparison_page` show several versions side by side.
Only `calibrate` runs solvers, and no second is ever held against a baseline.
"""
