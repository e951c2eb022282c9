"""The few pieces of HTML that the page is built from; every text is escaped here."""

import base64
from collections.abc import Sequence
from html import escape

MEDIA_TYPES = {"png": "image/png", "svg": "image/svg+xml", "jpeg": "image/jpeg"}


def paragraph(text: str, kind: str = "") -> str:
    return f"<p{_class(kind)}>{escape(text)}</p>"


def items(texts: Sequence[str]) -> str:
    """A list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in texts) + "</ul>"


def facts(pairs: Sequence[tuple[str, str]]) -> str:
    """Names and values, two columns."""
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in pairs
    )
    return f'<div class="wide"><table class="facts"><tbody>{rows}</tbody></table></div>'


def picture(
    content: bytes, kind: str, alt: str, caption: str = "", width: str = "wide", note: str = ""
) -> str:
    """A figure with its picture embedded.

    kind: "png", "svg" or "jpeg". width: "wide" keeps it legible on a phone by scrolling sideways,
    "narrow" shrinks it. caption: bold; note: what follows it.
    """
    data = base64.b64encode(content).decode("ascii")
    image = f'<img src="data:{MEDIA_TYPES[kind]};base64,{data}" alt="{escape(alt)}">'
    bold = f"<b>{escape(caption)}</b> " if caption else ""
    text = f"<figcaption>{bold}{escape(note)}</figcaption>" if caption or note else ""
    return f"<figure><div{_class(width)}>{image}</div>{text}</figure>"


def grid(figures: Sequence[str]) -> str:
    """Figures side by side, as many as fit."""
    return '<div class="grid">' + "".join(figures) + "</div>"


def section(name: str, title: str, parts: Sequence[str]) -> str:
    body = "\n".join(parts)
    return f'<section id="{escape(name)}">\n<h2>{escape(title)}</h2>\n{body}\n</section>'


def table(
    heads: Sequence[Sequence[tuple[str, int]]],
    groups: Sequence[tuple[str, Sequence[Sequence[str]]]],
) -> str:
    """A table of figures.

    heads: rows of (text, columns it spans). groups: a title over its rows ("" for none), each row
    a name and its cells; a row without a name belongs to the one above and is drawn paler.
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
    return (
        f'<div class="wide"><table class="figures"><thead>{head}</thead>{"".join(bodies)}</table>'
        "</div>"
    )


def _head(text: str, span: int) -> str:
    scope = "colgroup" if span > 1 else "col"
    return f'<th scope="{scope}" colspan="{span}">{escape(text)}</th>'


def _class(kind: str) -> str:
    return f' class="{escape(kind)}"' if kind else ""
