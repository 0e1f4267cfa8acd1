"""What the pages of charts share: a style for light and dark, narrow and wide; pictures inside; the machine's name."""
import base64
import html
import os
import platform
import struct

STYLE = """
:root { color-scheme: light dark; --ground: #fff; --ink: #33383f; --quiet: #6b7280; --accent: #c2410c; --bad: #b00020;
        --line: #e1e4e8; }
@media (prefers-color-scheme: dark) {
  :root { --ground: #16191c; --ink: #d9dde1; --quiet: #98a0a8; --accent: #f0a35a; --bad: #ff7a86; --line: #31373d; }
  img { filter: invert(0.9) hue-rotate(180deg); }
}
body { font: 16px/1.55 system-ui, sans-serif; background: var(--ground); color: var(--ink); max-width: 62rem;
       margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.9rem; margin-bottom: .2rem; } h2 { margin-top: 3rem; border-top: 1px solid var(--line); padding-top: 1.4rem; }
img { max-width: 100%; height: auto; } figure { margin: 1.2rem 0; }
table { border-collapse: collapse; font-size: .86rem; margin: 1rem auto; }
th, td { text-align: right; padding: .22rem .5rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } th { font-weight: 600; white-space: normal; vertical-align: bottom; }
tr.chosen td { color: var(--accent); font-weight: 600; } tr.void td { color: var(--quiet); }
.words { display: inline-block; max-width: 20rem; white-space: normal; } td:has(.words), th:has(.words) { text-align: left; }
table.verdict { margin: 1rem 0; } table.verdict td { text-align: left; white-space: normal; }
.bad { color: var(--bad); font-weight: 600; } .dim { color: var(--quiet); } a { color: var(--accent); }
/* A wide table or picture takes what the window has beside the text; --w is the picture's own width. */
figure, .scroll { margin-left: 50%; transform: translateX(-50%); }
figure { width: max(100%, min(var(--w), 94rem, 100vw - 3rem)); } .scroll { overflow-x: auto; width: min(94rem, 100vw - 3rem); }
/* On a narrow page a picture keeps the size at which its words can be read, and scrolls as tables do, whose first
   column takes several lines. */
@media (max-width: 60rem) {
  figure { overflow-x: auto; } figure img { max-width: none; width: max(0.7 * var(--w), min(100%, var(--w))); }
  td:first-child { white-space: normal; min-width: 11rem; }
}
@media (max-width: 44rem) { td:first-child { min-width: 8rem; } }
"""


def text(value):
    return html.escape(str(value))


def picture(path):
    data = path.read_bytes()
    width = struct.unpack(">I", data[16:20])[0]
    return (f'<figure style="--w: {width}px"><img alt="{text(path.stem)}" '
            f'src="data:image/png;base64,{base64.b64encode(data).decode("ascii")}"></figure>')


def scrolled(head, rows):
    """A table of cells that are HTML, and of (class, cells)."""
    cells = "".join(f"<th>{h}</th>" for h in head)
    body = "".join(f'<tr class="{kind}">' + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for kind, row in rows)
    return f'<div class="scroll"><table><tr>{cells}</tr>{body}</table></div>'


def page(title, body):
    return (f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{text(title)}</title>'
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>{body}</body></html>')


def machine():
    return f"{platform.node()}, {processor()}, {os.cpu_count()} cores"


def processor():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.machine()
