"""Cost of labels: ``python -m warpcam.benchmarks.labels``.

A frame of ids alone, a frame of colours with shadows, and what ``Labels.read`` takes after a frame of ids: the median
of both together less that of the frame. Labels are those of bodies, first without amodal masks, then with them, then
with 17 keypoints in addition.
"""

import argparse
import json
from typing import Any

import warp as wp

import warpcam as wc
from warpcam.benchmarks import cases, machine, measure, problem, tasks

CASES = ("humanoid", "primitives", "yam")
KEYPOINTS = 17  # as many as COCO has of a person
VARIANTS: dict[str, dict[str, Any]] = {
    "without amodal masks": {"amodal": False},
    "with amodal masks": {},
    "with keypoints": {"keypoints": KEYPOINTS},
}


class Costs:
    """Times of one case."""

    def __init__(self, case: str, worlds: int, size: int, device: wp.Device):
        self._device = device
        self._problem = problem.build(cases.CASES[case], worlds, size, size)
        self._scene = wc.from_mujoco_warp(self._problem.mjm, self._problem.m, self._problem.d)

    def rows(self) -> list[dict[str, Any]]:
        """A row for each variant of labels: milliseconds, and their ratio to those of the frames."""
        shaded = self._median(self._renderer(("rgb",), shadows=True).render)
        renderer = self._renderer(("bodies",))
        plain = self._median(renderer.render)
        rows = []
        for name, options in VARIANTS.items():
            labels = wc.labels(renderer, **self._options(options))

            def frame(labels: wc.Labels = labels) -> None:
                renderer.render()
                labels.read()

            added = self._median(frame) - plain
            rows.append(
                {
                    "case": self._problem.case.name,
                    "labels": name,
                    "instances": labels.ids.shape[1],
                    "ids_ms": plain,
                    "rgb_shadows_ms": shaded,
                    "labels_ms": added,
                    "ratio_to_ids": added / plain,
                    "ratio_to_rgb_shadows": added / shaded,
                }
            )
        return rows

    def _options(self, options: dict[str, Any]) -> dict[str, Any]:
        if "keypoints" not in options:
            return options
        bodies = self._problem.mjm.nbody
        places = {str(k): (k % (bodies - 1) + 1, (0.0, 0.0, 0.01 * k)) for k in range(options["keypoints"])}
        return {**options, "keypoints": places}

    def _renderer(self, outputs: tuple[str, ...], shadows: bool = False) -> wc.Renderer:
        size, name = self._problem.width, self._problem.cameras[0]
        return wc.Renderer(self._scene, [wc.Camera(name, width=size, height=size, outputs=outputs, shadows=shadows)])

    def _median(self, frame: Any) -> float:
        return measure.median_of(frame, self._problem.place, problem.POSE_SETS, self._device)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--worlds", type=int, default=1024)
    parser.add_argument("--size", type=int, default=128, help="pixels of a side")
    parser.add_argument("--case", nargs="+", choices=cases.CASES, default=None, metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--out", help="JSON file")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device)
    chosen = options.case or [name for name in CASES if tasks.available(cases.CASES[name])]
    report: dict[str, Any] = {
        "about": __doc__,
        "machine": machine.describe(device),
        "worlds": options.worlds,
        "size": options.size,
        "results": [],
    }
    with wp.ScopedDevice(device):
        for case in chosen:
            for row in Costs(case, options.worlds, options.size, device).rows():
                report["results"].append(row)
                print(
                    f"{row['case']:12} {row['labels']:22} {row['instances']:4} instances: {row['labels_ms']:8.3f} ms, "
                    f"{row['ratio_to_ids']:.2f} of {row['ids_ms']:.3f} ms of ids, {row['ratio_to_rgb_shadows']:.2f} of "
                    f"{row['rgb_shadows_ms']:.3f} ms of colours",
                    flush=True,
                )
            if options.out:
                with open(options.out, "w") as file:
                    json.dump(report, file, indent=1)


if __name__ == "__main__":
    main()
