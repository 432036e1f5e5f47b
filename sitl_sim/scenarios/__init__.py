"""Scenarios as data, and the configurations of their companions."""
