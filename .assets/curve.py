"""Draws curve.png from curve.csv: mean 10 x CD_L1 over the 30 inputs against processor seconds of a shape.

usage: python3 .assets/curve.py      (pip install matplotlib)
"""
import csv
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

here = Path(__file__).parent
with open(here / "curve.csv", newline="") as file:
    rows = [r for r in csv.DictReader(file)]

figure, axes = plt.subplots(figsize=(7, 4), dpi=110)
styles = {"before": ("o--", "0.75"), "falling": ("o--", "0.45"), "now": ("o-", "tab:blue"), "peer": ("s", "tab:orange")}
for build, (style, colour) in styles.items():
    points = sorted(
        (float(r["seconds"]), float(r["cd"]), r["setting"]) for r in rows if r["build"] == build
    )
    label = {
        "before": "before the first shape of least bending",
        "falling": "before the finish",
        "now": "now",
        "peer": "peers",
    }[build]
    axes.plot([p[0] for p in points], [p[1] for p in points], style, color=colour, label=label)
    for seconds, cd, name in points:
        axes.annotate(name, (seconds, cd), xytext=(5, 6 if build != "now" else -12), textcoords="offset points", fontsize=8, color=colour)
axes.set_xscale("log")
ticks = [1, 2, 5, 10, 20, 50, 100]
axes.set_xticks(ticks, [str(t) for t in ticks])
axes.set_xticks([], minor=True)
axes.set_xlim(1, 120)
axes.set_xlabel("processor seconds of a shape (one thread, mean)")
axes.set_ylabel("10 x CD_L1 (mean)")
axes.set_ylim(0.05, 0.16)
axes.grid(alpha=0.3)
axes.legend(loc="center right", bbox_to_anchor=(1, 0.68))
figure.tight_layout()
figure.savefig(here / "curve.png")
