"""A page of scenes in the looks "mujoco", "pbr" and "path" side by side: ``python -m warpcam.benchmarks.looks``.

Renders each scene and writes ``images/looks/SCENE.jpg`` and the page ``looks_gallery.md`` into a folder.
"""

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.benchmarks import gallery, image_metrics, machine, scenes
from warpcam.benchmarks.look_scenes import SCENES, LookScene
from warpcam.render.looks import looks_of
from warpcam.sources.common import formats

WIDTH, HEIGHT = 256, 192
SAMPLES = 256
QUALITY = 88  # of JPEG
PICTURES, PAGE = Path("images") / "looks", "looks_gallery.md"


def opened(scene: LookScene, device: wp.Device) -> wc.Scene:
    with tempfile.TemporaryDirectory() as folder:
        path = scene.write(Path(folder))
        if path.suffix in formats.USD:
            return wc.from_usd(path, device=device, exposure=scene.exposure)
        if path.suffix in formats.MESHES:
            return wc.load(path, device=device)
        mjm = mujoco.MjModel.from_xml_path(str(path))
    mjd = mujoco.MjData(mjm)
    if mjm.nkey:
        mujoco.mj_resetDataKeyframe(mjm, mjd, 0)
    mujoco.mj_forward(mjm, mjd)
    return wc.from_mujoco(mjm, mjd, device=device)


def pictures(scene: LookScene, samples: int, device: wp.Device) -> dict[str, np.ndarray]:
    """The scene in each look that it has: (height, width, 3) uint8."""
    place: dict[str, Any] = {}
    if scene.camera is None:
        place = {"position": scene.position, "rotation": scenes.facing(scene.position, scene.target),
                 "lens": wc.Pinhole(fovy=scene.fovy)}  # fmt: skip
    name = scene.camera or "view"
    world = opened(scene, device)
    found: dict[str, np.ndarray] = {}
    for look in looks_of(world):
        real_time: dict[str, Any] = {} if look == "path" else {"shadows": True, "antialiasing": 16}
        camera = wc.Camera(name, width=WIDTH, height=HEIGHT, outputs=("rgb",), **place, **real_time)
        path = wc.PathOptions(samples=samples) if look == "path" else None
        images = wc.Renderer(world, [camera], look=look, path=path).render()
        found[look] = images[name]["rgb"][0].cpu().numpy().copy()
    return found


def page(titles: Mapping[str, str], flips: Mapping[str, float], looks: Mapping[str, Sequence[str]], how: str) -> str:
    """Text of the page.

    Args:
        titles: Of the scenes, by name.
        flips: Mean FLIP of "pbr" beside "path".
        looks: Names of the looks, as they stand side by side.
        how: Sizes and the machine, in a sentence.
    """
    lines = [
        "# Gallery of the looks",
        "",
        "Scenes in each [look](looks.md) that they have. To make this page:",
        "",
        "```sh",
        "pip install 'warpcam[bench,usd,meshes]'",
        "python -m warpcam.benchmarks.looks --out docs",
        "```",
        "",
        f"{how} FLIP is the difference that eyes see when two pictures are swapped, 0 to 1: of `pbr` beside `path`.",
        "",
        "| scene | FLIP |",
        "|---|---:|",
        *(f"| [{title}](#{name}) | {flips[name]:.3f} |" for name, title in titles.items()),
    ]
    for name, title in titles.items():
        beside = ", ".join(f"`{look}`" for look in looks[name])
        lines += ["", f"## {name}", "", f"{title[0].upper()}{title[1:]}: {beside}."]
        lines += ["", f"![{title}, in {len(looks[name])} looks]({PICTURES.as_posix()}/{name}.jpg)"]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the page and its pictures")
    parser.add_argument("--scene", nargs="+", choices=SCENES, metavar="NAME", help="these alone, without the page")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="paths of each pixel (default: %(default)s)")
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device)
    (options.out / PICTURES).mkdir(parents=True, exist_ok=True)
    flips, looks = {}, {}
    for name in options.scene or SCENES:
        drawn = pictures(SCENES[name], options.samples, device)
        row = Image.fromarray(gallery.beside(list(drawn.values())))
        row.save(options.out / PICTURES / f"{name}.jpg", quality=QUALITY, optimize=True)
        flips[name], looks[name] = image_metrics.flip(drawn["path"], drawn["pbr"])[0], tuple(drawn)
        print(f"{name}: {', '.join(drawn)}; FLIP of pbr beside path {flips[name]:.3f}", flush=True)
    if options.scene is None:
        about = machine.describe(device)
        where = about["device"] if device.is_cuda else about["cpu"]
        how = f"Pictures have {WIDTH} x {HEIGHT} pixels and {options.samples} paths a pixel, rendered on {where}."
        titles = {name: scene.title for name, scene in SCENES.items()}
        (options.out / PAGE).write_text(page(titles, flips, looks, how))


if __name__ == "__main__":
    main()
