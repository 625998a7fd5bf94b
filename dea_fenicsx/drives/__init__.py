"""Drives: loads as functions of time.  This room imports only `support`."""
