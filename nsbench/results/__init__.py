"""A results folder: journal, tables, keys of runs, and which rows may be reused.

journal        DIR/journal.jsonl: one synced line per run
run_key        the key of a run: digests of all it depends on
row_reuse      which stored rows are reused, and under which key a row is stored
tables         DIR/runs.csv and DIR/runs.parquet
environment    DIR/env.json: versions and machine
consistency    do tables, journal and report belong together?
packed_rows    rows in memory
atomic_write   files that are written whole or not at all
"""
