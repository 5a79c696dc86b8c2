"""The HTML page: one file with everything in it, so that it opens anywhere without a network."""

import base64
import html
import io
import re

import matplotlib.pyplot as plt

from tables import Table, as_html

CSS = """
:root { --ink:#1d2733; --soft:#5b6875; --line:#dfe4ea; --paper:#fff; --tint:#f5f7f9; --mark:#b4431c; }
* { box-sizing:border-box; }
body { margin:0; color:var(--ink); background:var(--paper); font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif; }
main { max-width:980px; margin:0 auto; padding:0 20px 60px; }
header { background:var(--tint); border-bottom:1px solid var(--line); }
header > div { max-width:980px; margin:0 auto; padding:26px 20px 18px; }
h1 { font-size:26px; margin:0 0 4px; } h2 { font-size:20px; margin:44px 0 8px; padding-top:8px; border-top:1px solid var(--line); }
h3 { font-size:16px; margin:26px 0 4px; }
p { margin:6px 0 10px; } .note, figcaption, .lead { color:var(--soft); font-size:13.5px; }
nav { position:sticky; top:0; z-index:1; background:rgba(255,255,255,.95); border-bottom:1px solid var(--line); }
nav > div { max-width:980px; margin:0 auto; padding:7px 20px; font-size:13.5px; display:flex; flex-wrap:wrap; gap:2px 16px; }
a { color:#0b62a4; text-decoration:none; } a:hover { text-decoration:underline; }
.facts { display:flex; flex-wrap:wrap; gap:8px 30px; margin:14px 0 0; padding:0; list-style:none; }
.facts b { display:block; font-size:21px; line-height:1.15; font-variant-numeric:tabular-nums; } .facts span { color:var(--soft); font-size:13px; }
figure { margin:12px 0 20px; } figure img { width:100%; height:auto; display:block; } figcaption { margin-top:4px; }
.wide { overflow-x:auto; margin:8px 0 4px; } table { border-collapse:collapse; font-size:13.5px; font-variant-numeric:tabular-nums; }
th,td { padding:4px 12px 4px 0; text-align:left; border-bottom:1px solid var(--line); vertical-align:top; }
th { font-weight:600; border-bottom:1.5px solid #9aa6b2; } .n { text-align:right; } td.n { white-space:nowrap; }
.warn { border-left:4px solid var(--mark); background:#fdf4f0; padding:8px 14px; margin:14px 0; }
details > summary { cursor:pointer; color:#0b62a4; } code { font-size:.92em; }
@media print { nav { display:none; } figure, tr { break-inside:avoid; } }
"""


class Page:
    """Collects sections; text is escaped here, so that no name of a run becomes markup."""

    def __init__(self, title: str):
        self.title = title
        self.parts: list[str] = []
        self.links: list[tuple[str, str]] = []
        self.header = ""
        self.figures = 0

    def head(self, lead: str, facts: list[tuple[str, str]]) -> None:
        items = "".join(
            f"<li><b>{html.escape(value)}</b><span>{html.escape(name)}</span></li>" for value, name in facts
        )
        self.header = (
            f"<h1>{html.escape(self.title)}</h1><p class=lead>{html.escape(lead)}</p><ul class=facts>{items}</ul>"
        )

    def section(self, title: str, text: str = "") -> None:
        name = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
        self.links.append((name, title))
        self.parts.append(f'<h2 id="{name}">{html.escape(title)}</h2>')
        self.text(text)

    def heading(self, title: str) -> None:
        self.parts.append(f"<h3>{html.escape(title)}</h3>")

    def text(self, text: str, kind: str = "") -> None:
        if text:
            self.parts.append(f"<p{f' class={kind}' if kind else ''}>{html.escape(text)}</p>")

    def table(self, table: Table) -> None:
        self.parts.append(as_html(table))

    def figure(self, figure, caption: str, kind: str = "svg") -> None:
        """Takes the figure over and closes it. `kind` is svg, or png where there are many cells."""
        if figure is None:
            return
        self.figures += 1
        picture = io.BytesIO()
        figure.savefig(picture, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else None)
        plt.close(figure)
        mime = "image/svg+xml" if kind == "svg" else "image/png"
        source = f"data:{mime};base64,{base64.b64encode(picture.getvalue()).decode()}"
        width, height = (round(96 * size) for size in figure.get_size_inches())
        caption = html.escape(caption)
        self.parts.append(
            f'<figure><img src="{source}" width="{width}" height="{height}" alt="{caption}">'
            f"<figcaption>Figure {self.figures}: {caption}</figcaption></figure>"
        )

    def render(self) -> str:
        links = "".join(f'<a href="#{name}">{html.escape(title)}</a>' for name, title in self.links)
        return (
            "<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8>"
            '<meta name=viewport content="width=device-width,initial-scale=1">'
            '<link rel=icon href="data:,">'
            f"<title>{html.escape(self.title)}</title><style>{CSS}</style></head><body>\n"
            f"<header><div>{self.header}</div></header>\n<nav><div>{links}</div></nav>\n<main>\n"
            + "\n".join(self.parts)
            + "\n</main></body></html>\n"
        )
