"""Hard cases: what each must end in, and whether it does.  `make hard` runs them all."""
