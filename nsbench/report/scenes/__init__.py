"""nsbench/report/scenes"""
