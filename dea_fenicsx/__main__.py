"""``python -m dea_fenicsx`` is the command ``dea``."""

import sys

from dea_fenicsx.cli import main

if __name__ == "__main__":
    sys.exit(main())
