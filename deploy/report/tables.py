"""Tables of a report, and how they are written as HTML, Markdown, LaTeX and CSV."""

import csv
import dataclasses
import html
import io
import math


@dataclasses.dataclass
class Table:
    """Texts in rows under a head; columns from `numbers_from` on are aligned to the right."""

    head: list[str]
    rows: list[list[str]]
    numbers_from: int = 1
    note: str = ""


def plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def rounded(value: float, digits: int = 4) -> str:
    """Few digits, no exponent from a millionth to ten million; "-" for what is no number."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    if abs(value) >= 1e7 or abs(value) < 1e-6:
        return f"{value:.{digits - 1}g}"
    text = f"{value:.{min(places, 6)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def with_interval(mean: float, low: float, high: float) -> str:
    """ "12.3 [10.1, 14.2]" with the digits that the interval's width leaves meaning, and two of the mean at least, so that a
    small score is not shown as 0; without an interval the mean alone."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return rounded(mean)
    if not low < high:
        return f"{rounded(mean)} [{rounded(low)}, {rounded(high)}]"
    smallest = min(high - low, abs(mean)) if mean else high - low
    places = min(6, max(0, 1 - math.floor(math.log10(smallest))))
    return f"{mean:.{places}f} [{low:.{places}f}, {high:.{places}f}]"


def millions(frames: float) -> str:
    return "-" if not math.isfinite(frames) else f"{rounded(frames / 1e6, 3)} M"


def duration(seconds: float) -> str:
    if not math.isfinite(seconds):
        return "-"
    return f"{seconds / 3600:.2f} h" if seconds >= 3600 else f"{seconds / 60:.1f} min"


def as_html(table: Table) -> str:
    cell = lambda tag, at, text: f"<{tag}{' class=n' if at >= table.numbers_from else ''}>{html.escape(text)}</{tag}>"
    head = "".join(cell("th", at, text) for at, text in enumerate(table.head))
    rows = "".join(
        "<tr>" + "".join(cell("td", at, text) for at, text in enumerate(row)) + "</tr>\n" for row in table.rows
    )
    note = f"<p class=note>{html.escape(table.note)}</p>" if table.note else ""
    return f"<div class=wide><table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>{note}\n"


def as_markdown(table: Table) -> str:
    escape = lambda text: text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("&lt;br>", "<br>")
    align = ["---" if at < table.numbers_from else "---:" for at in range(len(table.head))]
    lines = [table.head, align] + [[escape(text) for text in row] for row in table.rows]
    note = f"\n{table.note}\n" if table.note else ""
    return "".join("| " + " | ".join(line) + " |\n" for line in lines) + note


LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def latex_text(text: str) -> str:
    return "".join(LATEX_SPECIAL.get(letter, letter) for letter in text)


def as_latex(table: Table, caption: str) -> str:
    """A table of booktabs."""
    columns = "".join("l" if at < table.numbers_from else "r" for at in range(len(table.head)))
    line = lambda texts: " & ".join(latex_text(text) for text in texts) + r" \\" + "\n"
    return (
        "\\begin{table}\n\\centering\\small\n\\begin{tabular}{"
        + columns
        + "}\n\\toprule\n"
        + line(table.head)
        + "\\midrule\n"
        + "".join(line(row) for row in table.rows)
        + "\\bottomrule\n\\end{tabular}\n\\caption{"
        + latex_text(caption)
        + "}\n\\end{table}\n"
    )


def as_csv(head: list[str], rows: list[list]) -> str:
    """Numbers in full; what is no number is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow(["" if isinstance(value, float) and not math.isfinite(value) else value for value in row])
    return text.getvalue()
