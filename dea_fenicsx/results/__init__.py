"""What a run leaves on disk, and how it is read again: fields, history, summary, checkpoints.

This room imports `measure` and the rooms before it.
"""
