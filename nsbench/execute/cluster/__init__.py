"""Runs on the workers of a Dask cluster: the client's side and the worker's side."""
