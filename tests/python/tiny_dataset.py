"""A dataset that takes seconds. As a script: makes it, with more grasps, in the folder given."""

from __future__ import annotations

import sys

from ruffini import dataset

TINY = {
    "objects": 2,
    "grasps": 1,
    "frames": 2,
    # Light grips: a grasp that ends at 80 N takes ten times as long.
    "force": [1.0, 5.0],
    "truth_nodes": 400,
    "model_nodes": 200,
    "gels": [
        {"sensor": "gelsight-mini", "young": 3e5, "poisson": 0.47, "friction": 0.6, "share": 1.0}
    ],
}

if __name__ == "__main__":
    dataset.generate(sys.argv[1], threads=2, **{**TINY, "grasps": 3})
