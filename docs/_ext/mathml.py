"""Formulas as MathML, made by docutils from LaTeX while the site is built.

Browsers of 2023 and newer draw MathML by themselves, with the font docs/_static/formulas.woff.
"""

from __future__ import annotations

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def inline(writer, node: nodes.math) -> None:
    """Write a formula within a sentence."""
    writer.body.append(f'<span class="math">{tex2mathml(node.astext())}</span>')
    raise nodes.SkipNode


def displayed(writer, node: nodes.math_block) -> None:
    """Write a formula on a line of its own; it can be scrolled where the screen is narrow."""
    formula = tex2mathml(node.astext(), as_block=True)
    writer.body.append(f'<div class="math formula">{formula}</div>')
    raise nodes.SkipNode


def setup(app) -> dict[str, bool]:
    """Make the renderer "mathml" known to Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
