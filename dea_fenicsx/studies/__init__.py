"""Studies: one script run over many values of its parameters, on all ranks, kept and resumable."""
