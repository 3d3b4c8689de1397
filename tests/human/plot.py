"""Draws force over indentation and contact area over force, for the simulated hands and for people.

usage: plot.py ROWS.json FOLDER, with the rows of `softhand report human --json`; writes FOLDER/human.png
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

rows = json.load(open(sys.argv[1]))
hands = list(dict.fromkeys(row["hand"] for row in rows))
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), constrained_layout=True)
colours = plt.cm.viridis([i / max(1, len(hands) - 0.6) for i in range(len(hands))])

people = [row for row in rows if row["hand"] == hands[0] and row["compared"]]
depth = [0.0] + [1e3 * row["indentation"] for row in people]
force = [0.0] + [row["force_reference"] for row in people]
spread = people[0]["force_spread"]
BAND = "people, a factor of %g in both directions (recalled)"
low, high = [f / spread for f in force], [f * spread for f in force]
left.fill_between(depth, low, high, color="0.88", label=BAND % spread)
form = "people, Pawluk and Howe's form (recalled constants)"
left.plot(depth, force, color="black", lw=2.5, ls=":", zorder=3, label=form)

forces = [0.25 * 1.1**i for i in range(36)]
spread = people[0]["area_spread"]
area = [100 * f**0.5 for f in forces]
low, high = [a / spread for a in area], [a * spread for a in area]
right.fill_between(forces, low, high, color="0.88", label=BAND % spread)
form = "people, 100 mm$^2$ at 1 N, grows with the root of force (recalled)"
right.plot(forces, area, color="black", lw=2.5, ls=":", zorder=3, label=form)

for hand, colour in zip(hands, colours):
    mine = [row for row in rows if row["hand"] == hand]
    depth = [0] + [1e3 * row["indentation"] for row in mine]
    left.plot(depth, [0] + [row["force"] for row in mine], "o-", ms=3, color=colour, label=hand)
    force, area = [row["force"] for row in mine], [1e6 * row["area"] for row in mine]
    right.plot(force, area, "o-", ms=3, color=colour, label=hand)
left.set(xlabel="indentation, mm", ylabel="force, N", xlim=(0, 2.55), ylim=(0, 9))
left.set(title="Index fingertip on a flat plate")
right.set(xlabel="force, N", ylabel="contact area, mm$^2$", xlim=(0, 6), ylim=(0, 420))
right.set(title="Contact area, sum of shares of contact points")
for axes in (left, right):
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left")
figure.savefig(sys.argv[2] + "/human.png", dpi=110, metadata={"Software": None})
