"""Benchmarks: speed and quality of the solver and of perception."""
