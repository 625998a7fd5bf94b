"""One solve from start to end: arguments, session, resuming, and a script's command line.

This room imports `results` and the rooms before it.
"""
