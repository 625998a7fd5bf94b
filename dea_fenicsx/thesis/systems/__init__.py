"""The systems of the thesis, one file for each group."""
