"""Draws the pictures of error against run time from the rows of `softhand report error-runtime`.

usage: plot.py ROWS.json FOLDER

FOLDER/error_runtime.png shows each knob against its own reference.
FOLDER/error_runtime_total.png shows all runs against the best known result, with the Pareto front.
"""
import json
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt

KNOBS = {
    "newton_iterations": ("#1f77b4", "o", "Newton iterations (against R0)"),
    "residual_tolerance": ("#17becf", "s", "residual tolerance (against R0)"),
    "time_step": ("#2ca02c", "^", "time step (against R1)"),
    "mesh": ("#d62728", "D", "mesh (against R2)"),
    "combined": ("#9467bd", "P", "mesh and step, one iteration (against all)"),
    "left_out": ("#8c564b", "v", "left-out work (against R0)"),
    "work_budget": ("#e377c2", "p", "budget of work, fast steps (against R0)"),
    "engine": ("#7f7f7f", "h", "another engine (against R0)"),
}
BUDGETS = [(11.1, "90 Hz"), (8.3, "120 Hz"), (4.0, "250 Hz"), (1.0, "1 kHz")]
ERRORS = [(0.1, "0.1 mm"), (1.0, "1 mm"), (11.0, "11 mm: error of a tracker")]
LOWEST = 1e-6  # mm; smaller errors are drawn here


def short(row):
    return {
        "newton_iterations": row["setting"].replace("converged", "conv."),
        "residual_tolerance": row["setting"].replace(" N", ""),
        "time_step": row["setting"].replace(" s", ""),
        "mesh": row["setting"],
        "work_budget": row["setting"].replace(" fast steps", ""),
        "engine": row["setting"],
    }.get(row["knob"], "")


def panel(axes, rows, x_key, y_key, lowest, highest, with_front, labels):
    for milliseconds, name in BUDGETS:
        axes.axvline(milliseconds, color="0.85", lw=0.8, zorder=0)
        axes.text(milliseconds, lowest * 1.25, name, rotation=90, fontsize=5.5, color="0.5", ha="right", va="bottom")
    for millimetres, name in ERRORS:
        axes.axhline(millimetres, color="0.85", lw=0.8, zorder=0)
    if with_front:
        front = sorted((r for r in rows if r["on_front"]), key=lambda r: r[x_key])
        xs = [r[x_key] for r in front]
        ys = [max(r[y_key], lowest) for r in front]
        axes.step(xs, ys, where="post", color="k", lw=1, zorder=1)
    for knob, (colour, marker, _) in KNOBS.items():
        mine = [r for r in rows if r["knob"] == knob and r[x_key] is not None]
        good = sorted(
            (r for r in mine if r["class"] == "Pass" and r[y_key] is not None and (r[y_key] > 0 or with_front)),
            key=lambda r: r[x_key],
        )
        bad = [r for r in mine if r["class"] != "Pass"]
        xs = [r[x_key] for r in good]
        ys = [max(r[y_key], lowest) for r in good]
        if not with_front and knob not in ("combined", "engine", "left_out"):
            axes.plot(xs, ys, color=colour, lw=0.8, alpha=0.6)
        axes.plot(xs, ys, marker, color=colour, ms=4)
        if x_key == "ms_p50":
            axes.hlines(ys, xs, [max(r["ms_p99"], r["ms_p50"]) for r in good], color=colour, lw=0.6, alpha=0.6)
        axes.plot([r[x_key] for r in bad], [highest * 0.8] * len(bad), "x", color=colour, ms=6, mew=1.5, clip_on=False)
        if labels:
            for r, x, y in zip(good, xs, ys):
                axes.annotate(short(r), (x, y), xytext=(2, 2), textcoords="offset points", fontsize=5, color=colour)
    for r in rows:
        if r["default"] and r[y_key] is not None and r["class"] == "Pass":
            axes.plot(r[x_key], max(r[y_key], lowest), "*", color="#ff7f0e", ms=12, mec="k", mew=0.6, zorder=5)
        elif r["default"]:
            axes.plot(r[x_key], highest * 0.8, "X", color="#ff7f0e", ms=9, mec="k", mew=0.6, zorder=5)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(lowest, highest)
    axes.tick_params(labelsize=7)


def figure(rows, path, x_key, y_key, lowest, highest, with_front, x_label, y_label):
    scenes = list(dict.fromkeys(r["scene"] for r in rows if r["class"] != "Not built"))
    panels = len(scenes) + 1  # with the legend
    columns = min(panels, min((3, 4, 5), key=lambda n: (-panels % n, n)))  # as few empty ones as possible
    lines = -(-panels // columns)
    picture, all_axes = plt.subplots(lines, columns, figsize=(4.0 * columns, 3.3 * lines), squeeze=False)
    flat = [axes for line in all_axes for axes in line]
    for axes, scene in zip(flat, scenes):
        panel(axes, [r for r in rows if r["scene"] == scene], x_key, y_key, lowest, highest, with_front, not with_front)
        axes.set_title(scene, fontsize=9)
    for axes in flat[len(scenes):]:
        axes.axis("off")  # the first of these axes holds the legend
    handles = [
        plt.Line2D([], [], color=c, marker=m, ls="", label=text)
        for k, (c, m, text) in KNOBS.items()
        if any(r["knob"] == k for r in rows)
    ]
    handles.append(plt.Line2D([], [], color="#ff7f0e", marker="*", ms=11, mec="k", ls="", label="the default"))
    top_edge = "on the top edge: failed (class in the table)"
    handles.append(plt.Line2D([], [], color="0.4", marker="x", ls="", label=top_edge))
    if with_front:
        handles.append(plt.Line2D([], [], color="k", label="Pareto front"))
    else:
        handles.append(plt.Line2D([], [], color="0.5", lw=0.8, label="whisker: median to p99"))
    handles.append(plt.Line2D([], [], color="0.85", label="frames of 90, 120, 250, 1000 Hz; 0.1, 1, 11 mm (tracker)"))
    flat[len(scenes)].legend(handles=handles, loc="center", fontsize=7, frameon=False)
    for line in all_axes:
        line[0].set_ylabel(y_label, fontsize=8)
    for axes in all_axes[-1]:
        axes.set_xlabel(x_label, fontsize=8)
    picture.tight_layout()
    picture.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(picture)


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        rows = json.load(file)
    folder = sys.argv[2]
    figure(
        rows,
        folder + "/error_runtime.png",
        "ms_p50",
        "tissue_rms_mm",
        LOWEST,
        1e2,
        False,
        "CPU time of a step, ms",
        "tissue, RMS against the knob's reference, mm",
    )
    hand_rows = [r for r in rows if r["knob"] != "engine"]
    if hand_rows:
        figure(
            hand_rows,
            folder + "/error_runtime_total.png",
            "ms_frame",
            "total_tissue_rms_mm",
            2e-2,
            20,
            True,
            "CPU time of 1/90 s of the scene, ms",
            "tissue, RMS against R2 + R1 - R0, mm",
        )


main()
