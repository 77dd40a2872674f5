"""nsbench/lcp"""
