#!/usr/bin/python3
"""Draws the cost of a solve over nodes, spheres and joints: scripts/plot_mpc.py FIGURES.json PICTURE.png
(FIGURES.json: build/release/bench/mpc --json FIGURES.json)."""
import json
import re
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

if len(sys.argv) != 3:
    sys.exit(__doc__)
figures = json.load(open(sys.argv[1]))
series = {}
for figure in figures:
    match = re.fullmatch(r"solve_ms_(nodes|spheres|joints)_(\d+)", figure["name"])
    if match:
        series.setdefault(match[1], []).append((int(match[2]), figure["value"]))
if not series:
    sys.exit(sys.argv[1] + " holds no solve_ms_* figures")
plot, axes = plt.subplots(1, len(series), figsize=(4 * len(series), 3.2))
for axis, (over, points) in zip(axes, series.items()):
    axis.plot(*zip(*points), "o-")
    axis.set(xlabel=over, ylabel="solve [equivalent ms]", ylim=(0, None), xlim=(0, None))
    axis.grid(True)
plot.tight_layout()
plot.savefig(sys.argv[2], dpi=120)
