"""What the plotting scripts share: matplotlib without a display, colours, and the two-argument command line."""
import argparse
import json
import os
import tempfile

os.environ.setdefault("MPLCONFIGDIR", tempfile.mkdtemp(prefix="matplotlib-"))
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# One accent, for what this project is about; the others by ink, grey and dash.
ACCENT = "#c2410c"
INK = "#33383f"
GREY = "#9aa1aa"


def style():
    plt.rcParams.update({
        "font.size": 10, "axes.edgecolor": GREY, "axes.labelcolor": INK, "text.color": INK,
        "xtick.color": INK, "ytick.color": INK, "axes.spines.top": False, "axes.spines.right": False,
        "axes.grid": True, "grid.color": "#e6e8eb", "grid.linewidth": 0.8, "axes.axisbelow": True,
        "figure.dpi": 130, "legend.frameon": False,
    })


def run(description, draw, data_help, picture_help="PNG to write"):
    """Reads JSON from the first argument and calls draw(data, second argument)."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", help=data_help)
    parser.add_argument("picture", help=picture_help)
    arguments = parser.parse_args()
    with open(arguments.data) as file:
        data = json.load(file)
    style()
    draw(data, arguments.picture)
