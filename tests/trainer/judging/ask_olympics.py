"""Ask duckietown-world itself: a program for a Python of its own, which has that package.

``python ask_olympics.py < drives.json > figures.json``; see test_lane_rules.py.
"""

import json
import sys

import numpy as np


def main():
    import geometry
    from duckietown_world.geo import SE2Transform
    from duckietown_world.rules import evaluate_rules
    from duckietown_world.seqs import SampledSequence
    from duckietown_world.world_duckietown import construct_map

    asked = json.load(sys.stdin)
    maps = {name: construct_map(tiles) for name, tiles in asked["maps"].items()}
    rows = []
    for drive in asked["drives"]:
        times = [float(t) for t in asked["dt_s"] * np.arange(len(drive["poses"]))]
        poses = [
            SE2Transform.from_SE2(geometry.SE2_from_translation_angle(np.array(p[:2]), p[2]))
            for p in drive["poses"]
        ]
        sequence = SampledSequence[SE2Transform](times, poses)
        every = SampledSequence[float](times, times)
        found = evaluate_rules(sequence, every, maps[drive["map"]], "ego")
        by_name = {
            "/".join((k, *n)): m.total for k, r in found.items() for n, m in r.metrics.items()
        }
        rows.append(by_name)
        print(len(rows), by_name, file=sys.stderr, flush=True)
    json.dump(rows, sys.stdout)


main()
