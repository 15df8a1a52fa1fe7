"""Plan many random fields (concave, narrow, with many holes) and count what leaves the field.

    python benchmarks/random_fields.py --fields 1000 --json

Every field must either get a plan that the independent check accepts, or a refusal that says
why. What is counted beside the check itself: length of way outside the field, from the plan alone.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from agribot.autonomy.plan.coverage.area import PlanRequest
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.core.errors import MissionError
from agribot.description.loader import load_robot

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.autonomy.plan.random_fields import random_field


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fields", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    result = measure(options.fields, options.seed)
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    else:
        sys.stdout.writelines(f"{name}: {value}\n" for name, value in result.items())
    return 0 if result["outside_m"] == 0.0 else 1


def measure(count: int, seed: int) -> dict[str, object]:
    import shapely

    robot = load_robot("agribot")
    coverage, fields_m2, outside_m = [], 0.0, 0.0
    refused: Counter[str] = Counter()
    failed: list[str] = []
    started_s = time.process_time()
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        area, width_m = random_field(rng)
        request = PlanRequest(implement_width_m=width_m, tool_x_m=robot.tool_x_m)
        shape = measure_footprint(robot, width_m)
        try:
            plan = plan_field(area, shape, request)
        except MissionError as error:
            refused[str(error).split(":")[0]] += 1
            continue
        certificate = certify_plan(plan, area, shape, request)
        field = shapely.Polygon(area.boundary, area.holes)
        way = shapely.MultiLineString([leg.xy_map_m for leg in plan.legs])
        outside_m += float(shapely.difference(way, field).length)
        if not certificate.ok:
            problem = certificate.problems[0]
            failed.append(f"field {number}: {problem.rule}: {problem.message}")
            continue
        coverage.append(certificate.coverage_ratio)
        fields_m2 += certificate.field_area_m2
    return {
        "fields": count, "certified": len(coverage), "refused_before_planning": dict(refused),
        "refused_by_the_check": failed, "outside_m": outside_m,
        "coverage_min_ratio": min(coverage, default=0.0),
        "coverage_mean_ratio": float(np.mean(coverage)) if coverage else 0.0,
        "area_ha": fields_m2 / 1e4, "cpu_s": time.process_time() - started_s,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
