"""Our colours beside those of ``mujoco.Renderer``: a table, and pictures of both and of what differs.

    python -m warpcam.benchmarks.fidelity [--shot NAME ...] [--peer] [--out FILE.json] [--gallery FOLDER]

The judge draws as it does by default, with its antialiasing and its shadows. Its own picture with sixteen times as many
samples is compared with it, too, which tells how much its few samples matter. Scenes whose packages are not installed
are left out; ``pip install --no-deps dm-control gymnasium gymnasium-robotics robosuite mjlab`` brings them all.
"""

import argparse
import importlib.util
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "osmesa")
# Mesa's software renderer is to look textures up as precisely as a GPU does, without its short cuts of eight bits.
os.environ.setdefault("GALLIVM_PERF", "no_filter_hacks,no_aos_sampling")

import mujoco
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.benchmarks import fidelity_scenes, gallery, image_metrics, machine
from warpcam.benchmarks.fidelity_scenes import Shot
from warpcam.core.errors import WarpcamError

SIZE = 256
SAMPLES = 4  # of a pixel, in the judge's pictures
MOST_SAMPLES = 16  # of a pixel, of warpcam
FINER = 4  # pixels of the judge's finer pictures along the side of a pixel
# What is held up to the whole: median and least PSNR [dB], mean FLIP.
WANTED = {"median_psnr": 38.0, "least_psnr": 32.0, "mean_flip": 0.03}

Draw = Callable[[mujoco.MjModel, mujoco.MjData, int, int], np.ndarray]


def draw_judge(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    return draw_mujoco(mjm, mjd, camera, samples, SIZE)


def draw_mujoco(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int, size: int) -> np.ndarray:
    """Picture of ``mujoco.Renderer``, so many pixels high and wide."""
    mjm.vis.quality.offsamples = samples if samples > 1 else 0
    screen = mjm.vis.global_
    screen.offwidth, screen.offheight = max(screen.offwidth, size), max(screen.offheight, size)
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = False  # the rays of sensors are no part of a scene
    with mujoco.Renderer(mjm, size, size) as renderer:
        renderer.update_scene(mjd, camera=camera, scene_option=option)
        return renderer.render().copy()


def draw_finer(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    """The judge's own picture of more pixels, of which each FINER x FINER are averaged to one."""
    fine = draw_mujoco(mjm, mjd, camera, samples, FINER * SIZE)
    means = fine.reshape(SIZE, FINER, SIZE, FINER, 3).mean(axis=(1, 3))
    return np.rint(means).astype(np.uint8)


def draw_ours(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    scene = wc.from_mujoco(mjm, mjd, device="cpu")
    view = wc.Camera(camera, width=SIZE, height=SIZE, outputs=("rgb",), shadows=True, antialiasing=samples)
    return wc.Renderer(scene, [view]).render()[camera]["rgb"][0].numpy().copy()


def draw_mujoco_warp(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    """MuJoCo-Warp's renderer with everything on that it has."""
    import mujoco_warp as mjw

    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd)
        context = mjw.create_render_context(
            mjm,
            nworld=1,
            cam_res=(SIZE, SIZE),
            cam_active=[index == camera for index in range(mjm.ncam)],
            render_rgb=True,
            render_depth=False,
            use_textures=True,
            use_shadows=True,
            render_skybox=True,
            samples_per_pixel=max(1, round(samples**0.5)),
        )
        mjw.refit_bvh(m, d, context)
        mjw.render(m, d, context)
        rgb = wp.zeros((1, SIZE, SIZE), dtype=wp.vec3)
        mjw.get_rgb(context, 0, rgb)
        return np.rint(255.0 * np.clip(rgb.numpy()[0], 0.0, 1.0)).astype(np.uint8)


def draw_ours_like(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    """As many samples as the judge has, of those that there are."""
    return draw_ours(mjm, mjd, camera, SAMPLES if samples > 1 else 1)


def draw_ours_finer(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    return draw_ours(mjm, mjd, camera, MOST_SAMPLES)


def draw_ours_plain(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int, samples: int) -> np.ndarray:
    return draw_ours(mjm, mjd, camera, 1)


OURS, PLAIN, PEER = "warpcam", "warpcam, one sample", "mujoco_warp"
OURS_FINER = f"warpcam, {MOST_SAMPLES} samples"
JUDGE_FINER = f"mujoco.Renderer, {FINER**2} times the samples"
DRAWN: dict[str, Draw] = {
    OURS: draw_ours_like,
    OURS_FINER: draw_ours_finer,
    PLAIN: draw_ours_plain,
    JUDGE_FINER: draw_finer,
    PEER: draw_mujoco_warp,
}


def compare(shot: Shot, renderers: Sequence[str], samples: int, folder: Path | None) -> dict[str, Any]:
    """The row of one shot; saves its picture, too."""
    mjm, mjd, camera = fidelity_scenes.load(shot)
    judge = draw_judge(mjm, mjd, camera, samples)
    row: dict[str, Any] = {"shot": shot.name, "package": shot.package, "file": shot.file, "camera": shot.camera}
    images = {}
    for name in renderers:
        try:
            began = time.perf_counter()
            images[name] = DRAWN[name](mjm, mjd, camera, samples)
        except Exception as error:
            if name == OURS:
                raise
            row[name] = {"error": f"{type(error).__name__}: {error}"[:200]}
            continue
        mean, _ = image_metrics.flip(judge, images[name])
        row[name] = {
            "psnr": round(image_metrics.psnr(judge, images[name]), 2),
            "flip": round(mean, 4),
            "seconds": round(time.perf_counter() - began, 2),
        }
    if JUDGE_FINER in images:
        for name in (OURS, OURS_FINER, PLAIN):
            if name in images:
                row[name]["finer_psnr"] = round(image_metrics.psnr(images[JUDGE_FINER], images[name]), 2)
    if folder is not None:
        gallery.save(folder / f"{shot.name}.png", judge, images[OURS])
    return row


def summary(rows: Sequence[dict[str, Any]], name: str) -> dict[str, float]:
    """Summarise the scenes that the renderer has drawn."""
    drawn = [row[name] for row in rows if "psnr" in row.get(name, {})]
    ratios = [one["psnr"] for one in drawn]
    finer = [one["finer_psnr"] for one in drawn if "finer_psnr" in one]
    figures = {
        "shots": len(drawn),
        "median_psnr": round(float(np.median(ratios)), 2),
        "least_psnr": round(min(ratios), 2),
        "mean_flip": round(float(np.mean([one["flip"] for one in drawn])), 4),
        "largest_flip": round(max(one["flip"] for one in drawn), 4),
    }
    if finer:
        figures |= {"median_finer_psnr": round(float(np.median(finer)), 2), "least_finer_psnr": round(min(finer), 2)}
    return figures


def summaries(rows: Sequence[dict[str, Any]], renderers: Sequence[str]) -> dict[str, dict[str, float]]:
    """Summarise, for each renderer, the scenes that it has drawn, if any."""
    return {name: summary(rows, name) for name in renderers if any("psnr" in row.get(name, {}) for row in rows)}


def report_of(rows: Sequence[dict[str, Any]], renderers: Sequence[str], samples: int) -> dict[str, Any]:
    """Results of all shots, a summary of those of other packages, or of all, and one of those made here."""
    own = [row for row in rows if row["package"] == fidelity_scenes.OWN]
    others = [row for row in rows if row not in own]
    return {
        "format": 1,
        "kind": "fidelity",
        "judge": f"mujoco.Renderer {mujoco.__version__}, {samples} samples a pixel, {os.environ['MUJOCO_GL']}",
        "size": [SIZE, SIZE],
        "machine": machine.describe(wp.get_device("cpu")),
        "summary": summaries(others or own, renderers),
        "crowded": summaries(own, renderers),
        "results": list(rows),
    }


def chosen(names: Sequence[str] | None) -> list[Shot]:
    known = {shot.name: shot for shot in fidelity_scenes.SHOTS}
    for name in names or ():
        if name not in known:
            raise WarpcamError(f"--shot: {name!r} came, known are: {', '.join(known)}")
    wanted = [known[name] for name in names] if names else list(fidelity_scenes.SHOTS)
    return [shot for shot in wanted if importlib.util.find_spec(shot.package) is not None]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m warpcam.benchmarks.fidelity", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--shot", nargs="+", metavar="NAME", help="which (default: all that are installed)")
    parser.add_argument("--peer", action="store_true", help="draw with mujoco_warp's renderer, too")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of a pixel, in the judge's pictures (default: 4)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write JSON here")
    parser.add_argument("--gallery", type=Path, metavar="FOLDER", help="write gallery.md and its pictures here")
    options = parser.parse_args(arguments)
    renderers = [OURS, OURS_FINER, PLAIN, JUDGE_FINER, *([PEER] if options.peer else [])]
    folder = options.gallery / "images" / "gallery" if options.gallery else None
    rows = []
    try:
        for shot in chosen(options.shot):
            row = compare(shot, renderers, options.samples, folder)
            rows.append(row)
            cells = [f"{name} {row[name].get('psnr', '-')} dB, FLIP {row[name].get('flip', '-')}" for name in renderers]
            print(f"{shot.name:16} {'; '.join(cells)}", flush=True)
            report = report_of(rows, renderers, options.samples)
            if options.out:
                options.out.write_text(json.dumps(report, indent=1) + "\n")
        if not rows:
            raise WarpcamError("no shot can be drawn: none of the packages with scenes is installed")
    except WarpcamError as error:
        print(f"warpcam: {error}", file=sys.stderr)
        return 2
    if options.gallery:
        gallery.write_page(options.gallery / "gallery.md", report, WANTED)
    for name, figures in report["summary"].items():
        print(f"{name}: {figures}")
    for name, figures in report["crowded"].items():
        print(f"{name}, crowded scenes: {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
