"""What is measured on a state: observables and the margins to failure.

This room imports `path` and the rooms before it.
"""
