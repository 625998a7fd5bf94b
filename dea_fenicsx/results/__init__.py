"""The results of a run on disk, written and read: fields, history, summary, checkpoints.

This room imports `measure` and the rooms before it.
"""
