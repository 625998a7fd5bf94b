"""Side by side: the same scenes here, in NGSolve and as a plain FEniCSx script."""
