#!/usr/bin/python3
"""Plots a run.csv of `wholebodyd --observe`: the object's joint, the base's path, the clearance.

Usage: plot_run.py RUN_CSV PICTURE [--unit m|rad]
"""
import argparse
import csv

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen before)


def spans(times, phases):
    """Consecutive samples of one phase: (phase, start, end)."""
    out = []
    for t, phase in zip(times, phases):
        if out and out[-1][0] == phase:
            out[-1][2] = t
        else:
            if out:
                out[-1][2] = t
            out.append([phase, t, t])
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run_csv")
    parser.add_argument("picture")
    parser.add_argument("--unit", default="m", choices=["m", "rad"])
    a = parser.parse_args()

    with open(a.run_csv, newline="") as f:
        rows = list(csv.DictReader(f))
    if not rows:
        raise SystemExit(f"{a.run_csv} holds no samples")
    phases = [r["phase"] for r in rows]
    number = {key: [float(r[key]) for r in rows] for key in rows[0] if key != "phase"}
    t = number["t_s"]

    figure = plt.figure(figsize=(11, 6.5), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.5, 1])
    joint = figure.add_subplot(grid[0, 0])
    clearance = figure.add_subplot(grid[1, 0], sharex=joint)
    path = figure.add_subplot(grid[:, 1])

    colours = {}
    for phase, start, end in spans(t, phases):
        if phase == "none" or end == start:
            continue
        colour = colours.setdefault(phase, plt.get_cmap("Pastel1")(len(colours)))
        for axes in (joint, clearance):
            axes.axvspan(start, end, color=colour, lw=0)
    handles = [plt.Rectangle((0, 0), 1, 1, color=c) for c in colours.values()]
    joint.legend(handles, colours, loc="upper left", framealpha=1)

    joint.plot(t, number["joint_value"], color="black")
    joint.set_ylabel(f"joint [{a.unit}]")
    joint.tick_params(labelbottom=False)
    clearance.plot(t, number["clearance_m"], color="black")
    clearance.set_ylim(bottom=min(0, *number["clearance_m"]))
    clearance.set_ylabel("clearance to all but the unit [m]")
    clearance.set_xlabel("time since the request [s]")
    for axes in (joint, clearance):
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)

    x, y = number["base_x_m"], number["base_y_m"]
    hand_x, hand_y = number["hand_x_m"], number["hand_y_m"]
    path.plot(hand_x, hand_y, color="tab:orange", lw=1, label="hand")
    path.plot(x, y, color="tab:blue", label="base")
    path.plot(x[0], y[0], "o", color="tab:blue", label="start")
    path.set_aspect("equal", adjustable="datalim")
    path.set_xlabel("x [m] (the kitchen's front is at +x)")
    path.set_ylabel("y [m]")
    path.legend(frameon=False)
    path.grid(alpha=0.3)
    figure.savefig(a.picture, dpi=110)


if __name__ == "__main__":
    main()
