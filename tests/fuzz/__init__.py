"""Random trials by the thousand, each from a seed that is told: ``make fuzz``."""
