"""The published numbers of J. Park's thesis (2019), one by one, beside this package's.

``python -m dea_fenicsx.thesis --out DIR`` writes DIR/thesis.csv, DIR/thesis.md and the pictures.
Each file in `systems` answers for the systems it names: a function ``rows()`` and, if there is
something to draw, a function ``draw(out)``.  A new file is found by itself.
"""

from dea_fenicsx.thesis.table import Row, collect, printed_numbers

__all__ = ["Row", "collect", "printed_numbers"]
