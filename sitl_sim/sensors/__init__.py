"""Sensors: rendered pictures, depth, and a perfect detector's reports."""
