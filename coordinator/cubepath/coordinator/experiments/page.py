"""The page of a report: one HTML file with its tables and plots in it, on light and on dark.

Nothing is loaded from anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

from cubepath.coordinator.experiments.plots import INK, Plot
from cubepath.coordinator.experiments.tables import Table

_STYLE = """
:root { color-scheme: light dark;
  --ink: #1b1f24; --page: #ffffff; --rule: #d0d4da; --soft: #f3f5f7; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --page: #15181c; --rule: #3a4048; --soft: #1e2329; }
}
body { margin: 2rem auto; padding: 0 1.2rem; max-width: 75rem; color: var(--ink);
  background: var(--page); font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
.note { max-width: 50rem; } .wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th, td { padding: .25rem .6rem; text-align: left; border-bottom: 1px solid var(--rule);
  white-space: nowrap; }
th { background: var(--soft); position: sticky; top: 0; }
@media print { .wide { overflow: visible; } th, td { white-space: normal; padding: .15rem .3rem; }
  table { font-size: 9px; } }
td.number, th.number { text-align: right; }
figure { margin: 1.2rem 0; } figure svg { max-width: 100%; height: auto; color: var(--ink); }
svg text { font-family: system-ui, "DejaVu Sans", sans-serif !important; }
"""


def page_of(
    title: str, facts: Sequence[tuple[str, object]], tables: Iterable[Table], plots: Iterable[Plot]
) -> str:
    """Return the page as HTML."""
    told = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(str(each))}</td></tr>" for name, each in facts
    )
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1><table>{told}</table>",
        *map(_figure, plots),
        *map(_table, tables),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _figure(plot: Plot) -> str:
    text = plot.svg.decode()
    svg = text[text.index("<svg") :].replace(INK, "currentColor")
    # Behind the data is the page itself.
    svg = re.sub(r'(<g id="patch_1">\s*<path [^>]*style=")fill: #ffffff', r"\1fill: none", svg)
    svg = svg.replace("fill: #ffffff", "fill: none")
    # Names are of the whole page, and each plot begins to count anew.
    svg = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{plot.name}-", svg)
    head, _, rest = svg.partition(">")
    return f'<figure>{head} role="img" aria-label="{escape(plot.title)}">{rest}</figure>'


def _table(table: Table) -> str:
    if not table.rows:
        return ""
    texts = table.texts()
    numbers = [
        all(not isinstance(row[place], str) or not row[place] for row in table.rows)
        for place in range(len(table.columns))
    ]
    kinds = [' class="number"' if number else "" for number in numbers]
    head = "".join(
        f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, table.columns, strict=True)
    )
    body = "\n".join(
        "<tr>"
        + "".join(f"<td{kind}>{escape(text)}</td>" for kind, text in zip(kinds, row, strict=True))
        + "</tr>"
        for row in texts
    )
    return (
        f'<h2>{escape(table.title)}</h2><p class="note">{escape(table.note)}</p>'
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )
