"""Plans of small data sets, with the files that they need, and what a folder has in the end."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from warpcam.datasets.generate import Plan, read_recipes

SCENE = """
<mujoco>
  <worldbody>
    <light pos="1 -2 4" dir="-0.2 0.4 -1" directional="true"/>
    <geom name="table" type="box" size="1 1 .05" pos="0 0 -.05" rgba="0.8 0.8 0.75 1"/>
    <body name="crate" pos="-0.4 0.4 0.2"><geom type="box" size=".2 .2 .2" rgba="0.9 0.5 0.1 1"/>
      <site name="near corner" pos=".2 -.2 .2" size="0.001"/><site name="far corner" pos="-.2 .2 -.2" size="0.001"/>
    </body>
    <body name="ball" pos="0 -0.2 0.25"><freejoint/><geom name="ball" size=".18" rgba="0.7 0.2 0.3 1"/></body>
    <body name="pill" pos="0.4 0.2 0.25"><freejoint/>
      <geom name="pill" type="capsule" size=".1 .15" rgba="0.2 0.3 0.8 1"/>
    </body>
  </worldbody>
</mujoco>
"""
RECIPES = """
poses:
  crate: {low: [-0.6, -0.6, 0.15], high: [0.6, 0.6, 0.3], rotation: yaw}
  "[bp]*": {low: [-0.6, -0.6, 0.15], high: [0.6, 0.6, 0.5]}
spacing: 0.35
cameras:
  orbit:
    shell: {target: [0, 0, 0.2], radius: [1.6, 2.6], elevation: [15, 70], roll: [-10, 10], spread: [0.1, 0.1, 0.1]}
    fovy: [40, 55]
    exposure: [-0.5, 0.5]
scene:
  light_directions: {low: 0, high: 30, of: turn}
  light_diffuse: {low: 0.5, high: 1.3, of: factor}
  shape_colors: {low: [0.1, 0.1, 0.1, 1], high: [0.9, 0.9, 0.9, 1], rows: [ball, pill]}
textures: {folder: TEXTURES, names: [table, crate]}
backgrounds: {folder: PHOTOGRAPHS, probability: 0.8}
distractors: {count: [0, 6], low: [-0.9, -0.9, 0], high: [0.9, 0.9, 0.8], size: [0.03, 0.1]}
sensors:
  orbit: {effects: [{name: AxialNoise, constant: 0.002}], randomize: {axial_noise_constant: [0.001, 0.01]}}
labels:
  classes: {box: crate, round: [ball, pill]}
  keypoints: true
"""


def plan_of(folder: Path, out: str = "out", recipes: str | None = RECIPES, **options: Any) -> Plan:
    """A plan whose files are in a folder; without recipes the scene is seen from one place."""
    (folder / "scene.xml").write_text(SCENE)
    read = None
    if recipes is not None:
        text = recipes
        for name in ("TEXTURES", "PHOTOGRAPHS"):
            _write_images(folder / name.lower())
            text = text.replace(name, str(folder / name.lower()))
        read = folder / "recipes.yaml"
        read.write_text(text)
    settings = {"writer": "coco", "count": 7, "width": 64, "height": 48, "shard_size": 3, "worlds": 3, "device": "cpu"}
    settings |= {"antialiasing": 1, "image_format": "png"}
    return Plan(str(folder / "scene.xml"), str(folder / out), recipes=read_recipes(read), **settings | options)


def files_of(folder: str | Path) -> dict[str, str]:
    """Digest of every file in a folder but the lock, by its path."""
    paths = (path for path in Path(folder).rglob("*") if path.is_file() and path.name != ".lock")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def shards_of(folder: str | Path) -> list[str]:
    """Names of finished shards, all of which must be whole, and of nothing else that is there."""
    found = sorted(path.name for path in (Path(folder) / "shards").iterdir())
    for name in found:
        json.loads((Path(folder) / "shards" / name / "shard.json").read_text())
    return found


def _write_images(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    random = np.random.default_rng(0)
    for number in range(3):
        cells = random.integers(40, 255, (8, 10, 3)).astype(np.uint8)
        Image.fromarray(cells.repeat(8, 0).repeat(8, 1)).save(folder / f"{number}.png")
