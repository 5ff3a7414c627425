"""Compares the errors that `evaluate slam` has left in a folder with those of `evo`, which computes them from the same files.

Prints both side by side, and fails where they differ by more than 1 %. As `evo_ape tum TRUTH ESTIMATE -a` and `evo_rpe tum
TRUTH ESTIMATE` do it: nearest stamps within 10 ms, alignment by rotation and translation, root mean square.
"""

import json
import sys
from pathlib import Path

from evo.core import metrics, sync
from evo.tools import file_interface

MOST = 0.01
# Errors of rounding are no differences.
LEAST_M = 1e-6


def errors(truth_file, estimate_file):
    """The absolute and the relative error, in metres."""
    truth = file_interface.read_tum_trajectory_file(str(truth_file))
    estimate = file_interface.read_tum_trajectory_file(str(estimate_file))
    truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=0.01)
    relative = metrics.RPE(metrics.PoseRelation.translation_part, 1, metrics.Unit.frames)
    relative.process_data((truth, estimate))
    estimate.align(truth)
    absolute = metrics.APE(metrics.PoseRelation.translation_part)
    absolute.process_data((truth, estimate))
    rmse = metrics.StatisticsType.rmse
    return {"ate_evo_m": absolute.get_statistic(rmse), "rpe_trans_m": relative.get_statistic(rmse)}


def main():
    folder = Path(sys.argv[1])
    figures = json.loads((folder / "slam.json").read_text())["figures"]
    compared, apart = 0, []
    print(f"{'figure':<60} {'evaluate':>10} {'evo':>10}")
    for key in figures:
        case, method, metric = key.split("/")
        if metric != "ate_evo_m":
            continue
        place = folder / "slam" / case
        for metric, value in errors(place / "truth.txt", place / f"{method}.txt").items():
            key = f"{case}/{method}/{metric}"
            print(f"{key:<60} {figures[key]:>10.6f} {value:>10.6f}")
            compared += 1
            if abs(figures[key] - value) > MOST * value + LEAST_M:
                apart.append(key)
    if not compared:
        sys.exit(f"there is nothing to compare in {folder}: no recording there has truth")
    if apart:
        sys.exit(f"more than 1 % apart: {', '.join(apart)}")
    print(f"{compared} figures agree to 1 %")


if __name__ == "__main__":
    main()
