"""Formulas as pictures, drawn while the site is built, so that a reader's browser needs neither a script nor a font."""

import functools
from html import escape

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

SIZE = 18.0  # pixels of the em in which a formula is drawn; the page scales it with its text
EM = 16.0

ziamath.config.svg2 = False  # glyphs are drawn where they stand: identifiers would be those of another formula too


@functools.cache
def picture(formula: str, inline: bool) -> str:
    """The formula as SVG in the colour of the text, its baseline on that of the line."""
    drawn = ziamath.Latex(formula, size=SIZE, color="currentColor", inline=inline)
    svg = drawn.svgxml()
    width, height = (float(svg.attrib[side]) / EM for side in ("width", "height"))
    svg.attrib.update(
        {
            "width": f"{width:.4f}em",
            "height": f"{height:.4f}em",
            "role": "img",
            "aria-label": formula,
            "class": "formula",
            "style": f"vertical-align: {drawn.getyofst() / EM:.4f}em",
        }
    )
    return ziamath.zmath.ET.tostring(svg, encoding="unicode")


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(picture(node.astext(), inline=True))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    label = node.get("label")
    number = f'<span class="number">({escape(str(node["number"]))})</span>' if node.get("number") else ""
    identity = f' id="equation-{escape(label)}"' if label else ""
    translator.body.append(f'<div class="formula"{identity}>{picture(node.astext(), inline=False)}{number}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("pictures", (visit_inline, None), (visit_block, None))
    app.config.html_math_renderer = "pictures"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
