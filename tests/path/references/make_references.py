"""Renders the scenes of judged_scenes.py with Mitsuba 3, and stores radiance, (64, 64, 3) float16, beside this file.

``pip install mitsuba``, then ``python tests/path/references/make_references.py [NAME ...]``.
"""

import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
FOLDER = Path(__file__).resolve().parent
sys.path.append(str(FOLDER.parents[1] / "helpers"))
import judged_scenes as judged  # noqa: E402

SAMPLES, ROUNDS = 1024, 8  # of each pixel, and with how many seeds
T = mi.ScalarTransform4f
BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}


def bsdf(look: judged.Look) -> dict[str, Any]:
    if look.kind == "metal":
        alpha = max(look.roughness, 0.045) ** 2
        return {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "material": "none"}
    if look.kind == "glass" and look.roughness > 0.0:
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": look.roughness**2, "int_ior": look.index}
    if look.kind == "glass":
        return {"type": "dielectric", "int_ior": look.index}
    color: dict[str, Any] = {"type": "rgb", "value": list(look.color)}
    if look.texture:
        color = {"type": "bitmap", "bitmap": mi.Bitmap(judged.texture()[::-1].copy()), "filter_type": "bilinear"}
    return {"type": "diffuse", "reflectance": color}


def shape(one: Any) -> dict[str, Any]:
    found: dict[str, Any]
    if isinstance(one, judged.Ball):
        found = {"type": "sphere", "center": list(one.middle), "radius": one.radius}
    elif isinstance(one, judged.Box):
        place = T().translate(list(one.middle)).rotate([0, 1, 0], one.turn).scale(list(one.half))
        found = {"type": "cube", "to_world": place}
    else:
        mesh = mi.Mesh("mesh", len(one.points), len(one.faces), has_vertex_texcoords=one.uvs is not None,
                       props=properties(one.look))  # fmt: skip
        values = mi.traverse(mesh)
        values["vertex_positions"] = np.asarray(one.points, np.float32).ravel()
        values["faces"] = np.asarray(one.faces, np.uint32).ravel()
        if one.uvs is not None:
            values["vertex_texcoords"] = np.asarray(one.uvs, np.float32).ravel()
        values.update()
        return mesh
    if any(one.look.emission):
        found["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": list(one.look.emission)}}
    return {**found, "bsdf": bsdf(one.look)}


def properties(look: judged.Look) -> mi.Properties:
    found = mi.Properties()
    found["mesh_bsdf"] = mi.load_dict(bsdf(look))
    if any(look.emission):
        found["mesh_light"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": list(look.emission)}})
    return found


def light(one: Any) -> dict[str, Any]:
    if isinstance(one, judged.Point):
        return {
            "type": "point",
            "position": list(one.middle),
            "intensity": {"type": "rgb", "value": list(one.intensity)},
        }
    if isinstance(one, judged.Sun):
        away = [-float(x) for x in one.toward]
        return {"type": "directional", "direction": away, "irradiance": {"type": "rgb", "value": one.irradiance}}
    x, y, z = one.turn
    place = T().translate(list(one.middle)).rotate([0, 0, 1], z).rotate([0, 1, 0], y).rotate([1, 0, 0], x)
    place = place.rotate([0, 1, 0], 180.0).scale([*one.half, 1.0])  # Mitsuba's shines along +z
    radiance = {"type": "rgb", "value": list(one.radiance)}
    return {"type": "rectangle", "to_world": place, "bsdf": BLACK, "emitter": {"type": "area", "radiance": radiance}}


def render(scene: judged.Judged) -> np.ndarray:
    parts = {f"shape{k}": shape(one) for k, one in enumerate(scene.shapes)}
    parts |= {f"light{k}": light(one) for k, one in enumerate(scene.lights)}
    if scene.sky is not None:
        parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": list(scene.sky)}}
    film = {"type": "hdrfilm", "width": judged.SIZE, "height": judged.SIZE, "rfilter": {"type": "box"}}
    look = T().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0])
    sensor = {"type": "perspective", "fov": judged.FOVY, "fov_axis": "y", "to_world": look, "film": film}
    loaded = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": -1}, "sensor": sensor, **parts})
    rounds = [np.array(mi.render(loaded, spp=SAMPLES, seed=seed)) for seed in range(ROUNDS)]
    return np.mean(rounds, axis=0)


for name in sys.argv[1:] or judged.SCENES:
    np.save(FOLDER / judged.file_name(name), render(judged.SCENES[name]).astype(np.float16))
    print(name, flush=True)
