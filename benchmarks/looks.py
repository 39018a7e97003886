"""A page of scenes in the looks "mujoco", "pbr" and "path" side by side: ``python -m warpcam.benchmarks.looks``.

The look "pbr" is there twice: plain, and with soft shadows, one bounce of light and reflections.

Renders each scene and writes ``images/looks/SCENE.jpg`` and the page ``looks_gallery.md`` into a folder.
"""

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.benchmarks import gallery, image_metrics, machine, scenes
from warpcam.benchmarks.look_scenes import SCENES, LookScene
from warpcam.render.looks import LookName, looks_of
from warpcam.sources.common import formats

WIDTH, HEIGHT = 256, 192
SAMPLES = 256
QUALITY = 88  # of JPEG
RAYS: dict[str, Any] = {"soft_shadows": True, "indirect_light": True, "reflections": True}
WITH_RAYS = "pbr with rays"  # name of the column that is drawn with them
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


def columns_of(world: wc.Scene, samples: int) -> Iterator[tuple[str, LookName, dict[str, Any]]]:
    """Name, look and the renderer's options of each picture of a scene."""
    for look in looks_of(world):
        yield look, look, {"path": wc.PathOptions(samples=samples)} if look == "path" else {}
        if look == "pbr":
            yield WITH_RAYS, look, RAYS


def pictures(scene: LookScene, samples: int, device: wp.Device) -> dict[str, np.ndarray]:
    """The scene in each look that it has, and in "pbr" with rays: (height, width, 3) uint8, by column."""
    place: dict[str, Any] = {}
    if scene.camera is None:
        place = {"position": scene.position, "rotation": scenes.facing(scene.position, scene.target),
                 "lens": wc.Pinhole(fovy=scene.fovy)}  # fmt: skip
    name = scene.camera or "view"
    world = opened(scene, device)
    found: dict[str, np.ndarray] = {}
    for column, look, options in columns_of(world, samples):
        real_time: dict[str, Any] = {} if look == "path" else {"shadows": True, "antialiasing": 16}
        camera = wc.Camera(name, width=WIDTH, height=HEIGHT, outputs=("rgb",), **place, **real_time)
        images = wc.Renderer(world, [camera], look=look, **options).render()
        found[column] = images[name]["rgb"][0].cpu().numpy().copy()
    return found


def page(
    titles: Mapping[str, str], flips: Mapping[str, tuple[float, float]], columns: Mapping[str, Sequence[str]], how: str
) -> str:
    """Text of the page.

    Args:
        titles: Of the scenes, by name.
        flips: Mean FLIP of "pbr" beside "path", plain and with rays.
        columns: Names of the pictures of each scene, as they stand side by side.
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
        "`pbr` with rays has `soft_shadows=True`, `indirect_light=True` and `reflections=True`.",
        "",
        "| scene | FLIP, `pbr` | FLIP, `pbr` with rays |",
        "|---|---:|---:|",
        *(f"| [{title}](#{name}) | {flips[name][0]:.3f} | {flips[name][1]:.3f} |" for name, title in titles.items()),
    ]
    for name, title in titles.items():
        beside = ", ".join(f"`{column}`" for column in columns[name]).replace(f"`{WITH_RAYS}`", "`pbr` with rays")
        lines += ["", f"## {name}", "", f"{title[0].upper()}{title[1:]}: {beside}."]
        lines += ["", f"![{title}, in {len(columns[name])} pictures]({PICTURES.as_posix()}/{name}.jpg)"]
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
    flips, columns = {}, {}
    for name in options.scene or SCENES:
        drawn = pictures(SCENES[name], options.samples, device)
        row = Image.fromarray(gallery.beside(list(drawn.values())))
        row.save(options.out / PICTURES / f"{name}.jpg", quality=QUALITY, optimize=True)
        plain, rays = (image_metrics.flip(drawn["path"], drawn[column])[0] for column in ("pbr", WITH_RAYS))
        flips[name], columns[name] = (plain, rays), tuple(drawn)
        print(f"{name}: {', '.join(drawn)}; FLIP beside path {plain:.3f}, with rays {rays:.3f}", flush=True)
    if options.scene is None:
        about = machine.describe(device)
        where = about["device"] if device.is_cuda else about["cpu"]
        how = f"Pictures have {WIDTH} x {HEIGHT} pixels and {options.samples} paths a pixel, rendered on {where}."
        titles = {name: scene.title for name, scene in SCENES.items()}
        (options.out / PAGE).write_text(page(titles, flips, columns, how))


if __name__ == "__main__":
    main()
