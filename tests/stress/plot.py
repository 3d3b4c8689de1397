#!/usr/bin/python3
"""Draws the pictures of the stress map.

usage: plot.py ROWS.json DIR, with the rows that `softhand report stress --json` writes

DIR/stress_map.png shows a square for each value of a case, coloured by class.
DIR/stress_sweep.png shows the points of the sweep for each pair of parameters: default mode below the diagonal, one
Newton step above it. DIR/stress_sweep_live.png shows the live budget above it.
"""
import json
import re
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from matplotlib.patches import Patch, Rectangle  # noqa: E402

# Green and blue are good, warm colours are bad, and darker is more severe. Lightness separates them without colour
# vision.
COLOURS = {
    "Pass": "#8fd19e",
    "Refused": "#9ecae1",
    "Violated": "#fdd35c",
    "Over force": "#f79d4d",
    "Over budget": "#e377c2",
    "Inverted": "#c0392b",
    "Diverged": "#5b0f1a",
    "Not built": "#e6e6e6",
}
WIDEST = 28  # squares per line


def legend(present):
    return [Patch(facecolor=COLOURS[name], edgecolor="#555555", label=name) for name in COLOURS if name in present]


def draw_map(rows, path):
    """Draws one or more lines for each case and one square for each value."""
    lines = []  # (section, case, rows)
    for section in dict.fromkeys(row["section"] for row in rows if row["section"] != "Sweep"):
        cases = {}
        for row in rows:
            if row["section"] == section:
                cases.setdefault(row["case"], []).append(row)
        for case, values in cases.items():
            for start in range(0, len(values), WIDEST):
                lines.append((section, case if start == 0 else "", values[start : start + WIDEST]))
    figure, axes = plt.subplots(figsize=(13, 0.26 * len(lines) + 1.6))
    y, last = 0.0, None
    for section, case, values in lines:
        if section != last:
            y += 0.5
            axes.text(-8.6, y + 0.55, section, fontsize=11, fontweight="bold", va="center")
            last = section
        axes.text(-0.25, y + 0.5, case.replace("_", " "), fontsize=8.5, ha="right", va="center")
        for x, row in enumerate(values):
            light = row["good"] or row["class"] == "Not built"
            axes.add_patch(
                Rectangle(
                    (x + 0.05, y + 0.08),
                    0.9,
                    0.84,
                    facecolor=COLOURS[row["class"]],
                    edgecolor="#444444" if light else "black",
                    linewidth=0.4 if light else 1.2,
                )
            )
            if not row["good"] and row["class"] != "Not built":
                dark = row["class"] in ("Inverted", "Diverged")
                label = row["invariant"] if re.fullmatch(r"G\d", row["invariant"]) else "!"
                colour = "white" if dark else "black"
                axes.text(x + 0.5, y + 0.5, label, fontsize=6.5, ha="center", va="center", color=colour)
        if len(values) <= 6:
            text = ",  ".join(row["parameter"] for row in values)
            axes.text(len(values) + 0.3, y + 0.5, text, fontsize=7, va="center", color="#333333")
        y += 1
    axes.set_xlim(-8.8, WIDEST + 0.5)
    axes.set_ylim(y + 0.2, 0)
    axes.axis("off")
    built = [
        row
        for row in rows
        if row["section"] != "Sweep" and row["class"] != "Not built" and row["mode"] == "default"
    ]
    good = sum(row["good"] for row in built)
    axes.set_title(
        f"Stress cases by class: {good} of {len(built)} built rows pass or are rightly refused; "
        "hand right_400, default mode",
        fontsize=11,
        loc="left",
    )
    axes.legend(
        handles=legend({row["class"] for row in rows if row["section"] != "Sweep"}),
        loc="upper center",
        bbox_to_anchor=(0.5, -0.005),
        ncol=8,
        fontsize=9,
        frameon=False,
    )
    figure.savefig(path, dpi=110, bbox_inches="tight")


AXES = [
    ("E", "Young's modulus, Pa", "log"),
    ("nu", "Poisson's ratio", "linear"),
    ("dt", "time step, ms", "log"),
    ("k", "contact stiffness, N/m", "log"),
    ("ratio", "object / tissue mass", "log"),
]


# Case of the sweep, name of its mode, line style.
MODES = {
    "sweep": ("default mode", "-"),
    "sweep_one_step": ("one Newton step", "--"),
    "sweep_live": ("live budget", ":"),
}


def draw_sweep(rows, path, above):
    """Draws a scatter plot for each pair of parameters: default mode below the diagonal, the case `above` above it.
    Returns False if one of the two has no points."""
    points = {"sweep": [], above: []}
    for row in rows:
        if row["case"] in points:
            values = {name: float(value) for name, value in re.findall(r"(\w+) = ([-+.\deE]+)", row["parameter"])}
            points[row["case"]].append((values, row["class"]))
    if not all(points.values()):
        return False
    count = len(AXES)
    figure, grid = plt.subplots(count, count, figsize=(15, 14))
    order = list(COLOURS)
    for i, (row_name, row_label, row_scale) in enumerate(AXES):
        for j, (column_name, column_label, column_scale) in enumerate(AXES):
            axes = grid[i][j]
            if i == j:
                # Share of points that pass, as a function of this parameter only.
                for case in points:
                    ordered = sorted(points[case], key=lambda point: point[0][row_name])
                    size = max(len(ordered) // 8, 1)
                    chunks = [ordered[k : k + size] for k in range(0, len(ordered), size)]
                    chunks = [chunk for chunk in chunks if len(chunk) == size]
                    middle = [chunk[size // 2][0][row_name] for chunk in chunks]
                    shares = [100 * sum(c == "Pass" for _, c in chunk) / size for chunk in chunks]
                    axes.plot(middle, shares, MODES[case][1], color="#2c7a3f", marker="o", markersize=3)
                axes.set_xscale(row_scale)
                axes.set_ylim(-3, 103)
                axes.set_title("% Pass", fontsize=9)
            else:
                for which in order:
                    chosen = [values for values, c in points["sweep" if i > j else above] if c == which]
                    axes.scatter(
                        [v[column_name] for v in chosen],
                        [v[row_name] for v in chosen],
                        s=16,
                        color=COLOURS[which],
                        edgecolor="#555555",
                        linewidth=0.3,
                    )
                axes.set_xscale(column_scale)
                axes.set_yscale(row_scale)
            if i == count - 1:
                axes.set_xlabel(column_label, fontsize=9)
            if j == 0:
                axes.set_ylabel(row_label if i else "", fontsize=9)
            axes.tick_params(labelsize=7)
    shares = {case: 100 * sum(c == "Pass" for _, c in points[case]) / len(points[case]) for case in points}
    figure.suptitle(
        f"One finger presses an object on a table, {len(points['sweep'])} points: default mode below the diagonal "
        f"({shares['sweep']:.0f} % Pass), {MODES[above][0]} above it ({shares[above]:.0f} % Pass)\n"
        "diagonal: share of passing points along one parameter",
        fontsize=12,
    )
    handles = legend({which for case in points.values() for _, which in case})
    handles += [Line2D([], [], color="#2c7a3f", linestyle=MODES[case][1], label=MODES[case][0]) for case in points]
    figure.legend(handles=handles, loc="lower center", ncol=10, fontsize=10, frameon=False)
    figure.tight_layout(rect=(0, 0.03, 1, 0.97))
    figure.savefig(path, dpi=80)
    return True


def main():
    with open(sys.argv[1]) as file:
        rows = json.load(file)
    draw_map(rows, sys.argv[2] + "/stress_map.png")
    draw_sweep(rows, sys.argv[2] + "/stress_sweep.png", "sweep_one_step")
    draw_sweep(rows, sys.argv[2] + "/stress_sweep_live.png", "sweep_live")


if __name__ == "__main__":
    main()
