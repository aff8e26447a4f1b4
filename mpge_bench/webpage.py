"""HTML pages that need nothing else: the templates and style that they share, and plots as elements of them."""

from __future__ import annotations

import io
import re
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

#: How plots within pages look, for `matplotlib.rc_context`.
STYLE: Any = {
    "axes.edgecolor": "#9aa5b1",
    "axes.labelcolor": "#1f2933",
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 11,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.7,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",  # text stays text: small, sharp, and found by a search
    "svg.hashsalt": "mpge_bench",  # the same plot gives the same page
    "text.parse_math": False,  # a joint may be called $x$
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
}


def render(template: str, **values: Any) -> str:
    """The page that a template of this package, called by its path in it, makes of `values`; ``style.css`` is there to be included.

    Everything is escaped unless it is Markup; what the template asks for and does not get is an error.
    """
    environment = Environment(loader=PackageLoader("mpge_bench", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.get_template(template).render(**values)


def svg(figure: Figure, prefix: str, label: str) -> Markup:
    """The figure as an element of a page, as wide as its place; `prefix` keeps its names apart from other figures', `label` is read out in its place."""
    file = io.StringIO()
    figure.savefig(file, format="svg", dpi=120, transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.S)
    box = re.search(r'viewBox="[^"]*"', text)
    assert box is not None
    head = f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(label)}" {box[0]}>'
    body = text[text.index(">") + 1 :]
    body = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{prefix}", body)
    return Markup(head + body)
