"""Scenarios as data, and what each companion is told of them."""
