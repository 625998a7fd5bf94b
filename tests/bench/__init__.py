"""Counts and seconds of ten fixed scenes: a change in a count is a change of the code."""
