"""Entry point of ``python -m dea_fenicsx.pictures``."""

import sys

from dea_fenicsx.pictures.command import main
from dea_fenicsx.support.errors import install_hook

install_hook()
sys.exit(main())
