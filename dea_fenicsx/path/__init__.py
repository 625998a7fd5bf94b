"""Paths through equilibrium states: ramps, traces by arc length, stability and events.

This room imports `solvers` and the rooms before it, and writes no files.
"""
