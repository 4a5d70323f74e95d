"""A report as one HTML file that asks nothing of the network: text, tables, pictures."""

import base64
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 78rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
p, ul { max-width: 52rem; }
figure { margin: 1.2rem 0; } figcaption { color: #555; font-size: .9rem; max-width: 52rem; }
img { max-width: 100%; height: auto; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #ddd; padding: .3rem .7rem; text-align: left; white-space: nowrap; }
th { border-bottom: 2px solid #222; }
code { background: #f3f1ec; padding: 0 .2em; overflow-wrap: anywhere; }
"""


@dataclass(frozen=True)
class Text:
    """Paragraphs, each a string; `code` in backticks and **bold** are set as such."""

    paragraphs: tuple[str, ...]


@dataclass(frozen=True)
class Points:
    """A list."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """A table in Markdown, with pipes."""

    markdown: str


@dataclass(frozen=True)
class Image:
    """A PNG and what it shows in words."""

    png: bytes
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading and what follows it."""

    title: str
    parts: Sequence[Text | Points | Table | Image]


def write_report(file: Path, title: str, sections: Sequence[Section]) -> None:
    """Write it. OSError if it can't be written."""
    body = "\n".join(
        f"<h2>{_inline(each.title)}</h2>\n" + "\n".join(map(_part, each.parts)) for each in sections
    )
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{_inline(title)}</h1>\n{body}\n</body>\n</html>\n"
    )
    file.write_text(page, encoding="utf-8")


def _part(part: Text | Points | Table | Image) -> str:
    match part:
        case Text(paragraphs):
            return "\n".join(f"<p>{_inline(each)}</p>" for each in paragraphs)
        case Points(items):
            return "<ul>\n" + "\n".join(f"<li>{_inline(each)}</li>" for each in items) + "\n</ul>"
        case Table(markdown):
            return f'<div class="wide">{_table(markdown)}</div>'
        case Image(png, caption):
            data = base64.b64encode(png).decode("ascii")
            said = html.escape(caption)
            return (
                f'<figure><img alt="{said}" src="data:image/png;base64,{data}">'
                f"<figcaption>{said}</figcaption></figure>"
            )


def _table(markdown: str) -> str:
    head, _, *rows = [_cells(line) for line in markdown.strip().splitlines()]
    lines = ["<table>", _row(head, "th")]
    lines += [_row(row, "td") for row in rows]
    return "\n".join([*lines, "</table>"])


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def _row(cells: Sequence[str], tag: str) -> str:
    # A row with nothing but its first cell is a heading over those that follow.
    if tag == "td" and not any(cells[1:]):
        return f'<tr><td colspan="{len(cells)}">{_inline(cells[0])}</td></tr>'
    return "<tr>" + "".join(f"<{tag}>{_inline(cell)}</{tag}>" for cell in cells) + "</tr>"


def _inline(text: str) -> str:
    escaped = html.escape(text)
    escaped = re.sub(r"`([^`]+)`", r"<code>\1</code>", escaped)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", escaped)
