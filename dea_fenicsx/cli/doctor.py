"""Check this machine."""
HELP = "is this machine set up, and if not, how to mend it"
def add(parser): pass
def run(options): return 0
