"""nsbench/dynamics/contacts/kernels"""
