"""Equations as MathML, which browsers show by themselves: no script from another address."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def _mathml(node, as_block):
    return tex2mathml(node.astext().replace("°", r"^\circ"), as_block=as_block)


def _inline(writer, node):
    writer.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def _block(writer, node):
    writer.body.append(f'<div class="math">{_mathml(node, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app):
    """Registers the renderer that conf.py names."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True}
