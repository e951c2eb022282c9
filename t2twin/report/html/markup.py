"""HTML elements of the pages. All texts are escaped here."""

import base64
from collections.abc import Sequence
from html import escape

SIDEWAYS = "Wider than this screen: scroll sideways →"

MANY_COLUMNS = 5
"""Number of columns from which a table is wider than a phone."""

MEDIA_TYPES = {"png": "image/png", "svg": "image/svg+xml", "jpeg": "image/jpeg"}


def paragraph(text: str, kind: str = "") -> str:
    return f"<p{_class(kind)}>{escape(text)}</p>"


def items(texts: Sequence[str]) -> str:
    """A list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in texts) + "</ul>"


def facts(pairs: Sequence[tuple[str, str]]) -> str:
    """A table of two columns, names and values."""
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in pairs
    )
    return f'<table class="facts"><tbody>{rows}</tbody></table>'


def embed(
    content: bytes, kind: str, alt: str, caption: str = "", width: str = "wide", note: str = ""
) -> str:
    """A figure with an embedded image file.

    kind: "png", "svg" or "jpeg". width: "wide" scrolls sideways on a phone, "narrow" shrinks,
    "small" is limited to half a page. caption: in bold; note: text after it.
    """
    data = base64.b64encode(content).decode("ascii")
    image = f'<img src="data:{MEDIA_TYPES[kind]};base64,{data}" alt="{escape(alt)}">'
    bold = f"<b>{escape(caption)}</b> " if caption else ""
    text = f"<figcaption>{bold}{escape(note)}</figcaption>" if caption or note else ""
    box = _sideways(image) if width == "wide" else f"<div{_class(width)}>{image}</div>"
    return f"<figure>{box}{text}</figure>"


def grid(figures: Sequence[str], kind: str = "grid") -> str:
    """Figures in rows, as many as fit; at most two for the kind "grid halves"."""
    return f"<div{_class(kind)}>" + "".join(figures) + "</div>"


def section(name: str, title: str, parts: Sequence[str]) -> str:
    body = "\n".join(parts)
    return f'<section id="{escape(name)}">\n<h2>{escape(title)}</h2>\n{body}\n</section>'


def table(
    heads: Sequence[Sequence[tuple[str, int]]],
    groups: Sequence[tuple[str, Sequence[Sequence[str]]]],
) -> str:
    """A table of numbers.

    heads: rows of (text, spanned columns). groups: title ("" for none) and rows; a row is a name
    and its cells. A row without a name is drawn paler, as an addition to the row above.
    """
    columns = sum(span for _, span in heads[0])
    head = "".join(
        "<tr>" + "".join(_head(text, span) for text, span in row) + "</tr>" for row in heads
    )
    bodies = []
    for title, rows in groups:
        lines = []
        if title:
            lines.append(
                f'<tr class="group"><th scope="rowgroup" colspan="{columns}">{escape(title)}</th>'
                "</tr>"
            )
        for name, *cells in rows:
            kind = "" if name else ' class="span"'
            lines.append(
                f'<tr{kind}><th scope="row">{escape(name)}</th>'
                + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
                + "</tr>"
            )
        bodies.append("<tbody>" + "".join(lines) + "</tbody>")
    kind = "figures many" if columns >= MANY_COLUMNS else "figures"
    content = f'<table class="{kind}"><thead>{head}</thead>{"".join(bodies)}</table>'
    return _sideways(content) if columns >= MANY_COLUMNS else f'<div class="wide">{content}</div>'


def _sideways(content: str) -> str:
    """A scrollable box, with a note on screens that are narrower."""
    return f'<p class="sideways">{SIDEWAYS}</p><div class="wide" tabindex="0">{content}</div>'


def _head(text: str, span: int) -> str:
    scope = "colgroup" if span > 1 else "col"
    return f'<th scope="{scope}" colspan="{span}">{escape(text)}</th>'


def _class(kind: str) -> str:
    return f' class="{escape(kind)}"' if kind else ""
