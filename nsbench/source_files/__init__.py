"""nsbench/source_files"""
