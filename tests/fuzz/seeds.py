"""Good files of every format, from which mutations begin: generated ones, and those of installed packages."""

import importlib.util
import io
import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[2]
NAMED = re.compile(r"""(?:file|filename|fileright)\s*=\s*["']([^"']+)["']""")
LOOK = b"newmtl paint\nKa 0 0 0\nKd 0.8 0.5 0.2\nKs 0.1 0.1 0.1\nNs 40\nd 0.9\nillum 2\nmap_Kd -s 2 2 1 a.png\n"
LARGEST = 200_000  # bytes of a seed from a package, with what it names


@dataclass(frozen=True)
class Seed:
    """Files by their paths below a folder, and which of them is opened."""

    main: str
    files: dict[str, bytes]


def _primitives() -> Iterator[tuple[str, trimesh.Trimesh]]:
    make = trimesh.creation
    yield "box", make.box((1.0, 2.0, 0.5))
    yield "ball", make.icosphere(1)
    yield "rod", make.cylinder(0.3, 1.0, sections=8)
    yield "cone", make.cone(0.5, 1.0, sections=7)
    yield "ring", make.torus(1.0, 0.3, major_sections=8, minor_sections=5)
    yield "one", trimesh.Trimesh(np.eye(3), [[0, 1, 2]], process=False)
    yield "pill", make.capsule(1.0, 0.4, count=(6, 6))
    yield "tube", make.annulus(0.2, 0.5, 1.0, sections=6)


def _image(form: str = "PNG") -> bytes:
    pixels = np.random.default_rng(0).integers(0, 256, (8, 8, 3), np.uint8)
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, form)
    return data.getvalue()


def _dressed(mesh: trimesh.Trimesh, look: str) -> trimesh.Trimesh:
    mesh = mesh.copy()
    if look == "colors":
        mesh.visual.vertex_colors = np.random.default_rng(1).integers(0, 256, (len(mesh.vertices), 4), np.uint8)
    elif look == "texture":
        image = Image.open(io.BytesIO(_image()))
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, roughnessFactor=0.5, name="paint")
        mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2] * 0.3, material=material)
    return mesh


def gltf() -> Iterator[Seed]:
    for name, mesh in _primitives():
        for look in ("plain", "colors", "texture"):
            scene = trimesh.Scene()
            for place in range(2):
                turn = trimesh.transformations.translation_matrix((3.0 * place, 0, 0))
                scene.add_geometry(_dressed(mesh, look), transform=turn)
            yield Seed(f"{name}.glb", {f"{name}.glb": scene.export(file_type="glb")})
            files = {key.replace("model", name): value for key, value in scene.export(file_type="gltf").items()}
            yield Seed(f"{name}.gltf", files)


def obj() -> Iterator[Seed]:
    for _, mesh in _primitives():
        for look in ("plain", "colors", "texture"):
            text = trimesh.exchange.obj.export_obj(_dressed(mesh, look if look != "texture" else "plain"))
            if look == "texture":
                corners = "".join(f"vt {u:.3f} {v:.3f}\n" for u, v in mesh.vertices[:, :2])
                faces = "".join("f " + " ".join(f"{k}/{k}" for k in face) + "\n" for face in mesh.faces + 1)
                points = "".join(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in mesh.vertices)
                text = f"mtllib look.mtl\n{points}{corners}o part\nusemtl paint\n{faces}"
            yield Seed("a.obj", {"a.obj": text.encode(), "look.mtl": LOOK, "a.png": _image()})


def ply() -> Iterator[Seed]:
    for _, mesh in _primitives():
        for look in ("plain", "colors"):
            for encoding in ("ascii", "binary"):
                data = trimesh.exchange.ply.export_ply(_dressed(mesh, look), encoding=encoding)
                yield Seed("a.ply", {"a.ply": data})
    corners = "".join(f"{x} {y} 0\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1), (2, 2)))
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    for faces in ("4 0 1 2 3\n3 0 2 4\n", "5 0 1 2 4 3\n3 0 1 2\n"):
        text = f"{head}element face 2\nproperty list uchar int vertex_indices\nend_header\n{corners}{faces}"
        yield Seed("a.ply", {"a.ply": text.encode()})
    strip = f"{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{corners}5 0 1 3 2 -1\n"
    yield Seed("a.ply", {"a.ply": strip.encode()})


def stl() -> Iterator[Seed]:
    for _, mesh in _primitives():
        data = trimesh.exchange.stl.export_stl(mesh)
        colored = b"COLOR=\x10\x80\xff\xff".ljust(80, b" ") + data[80:]
        for each in (trimesh.exchange.stl.export_stl_ascii(mesh).encode(), data, colored):
            yield Seed("a.stl", {"a.stl": each})


def dae() -> Iterator[Seed]:
    for _, mesh in _primitives():
        for look in ("plain", "colors"):
            yield Seed("a.dae", {"a.dae": trimesh.exchange.dae.export_collada(_dressed(mesh, look))})


def msh() -> Iterator[Seed]:
    for _, mesh in _primitives():
        vertices, faces = mesh.vertices.astype("<f4"), mesh.faces.astype("<i4")
        for normals in (0, len(vertices)):
            head = np.array((len(vertices), normals, 0, len(faces)), "<i4").tobytes()
            body = vertices.tobytes() * (2 if normals else 1) + faces.tobytes()
            yield Seed("a.msh", {"a.msh": head + body})


def splats() -> Iterator[Seed]:
    names = [*"xyz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    for count in (1, 2, 5, 17, 40):
        for rest in (0, 9, 24, 45):
            columns = [*names[:6], *(f"f_rest_{place}" for place in range(rest)), *names[6:]]
            values = np.random.default_rng(count + rest).normal(size=(count, len(columns))).astype("<f4")
            head = "".join(f"property float {name}\n" for name in columns)
            for form in ("ascii", "binary_little_endian"):
                text = "\n".join(" ".join(f"{value:.4f}" for value in row) for row in values).encode() + b"\n"
                start = f"ply\nformat {form} 1.0\nelement vertex {count}\n{head}end_header\n".encode()
                yield Seed("a.ply", {"a.ply": start + (text if form == "ascii" else values.tobytes())})


def _packages(modules: tuple[str, ...], pattern: str) -> Iterator[Seed]:
    """Files of installed packages with those that they name, where all are small."""
    for module in modules:
        found = importlib.util.find_spec(module)
        folders = found.submodule_search_locations if found is not None else None
        for path in sorted(Path(folders[0]).rglob(pattern)) if folders else ():
            files = _bundle(path)
            if files is not None:
                yield files


def _bundle(path: Path) -> Seed | None:
    """A file with all that it names, at most two folders above it."""
    if path.stat().st_size > LARGEST:
        return None
    root, found, left = path.parents[2], {path}, [path]
    while left:
        text = left.pop().read_text(errors="replace")
        folders = {"", *re.findall(r"""(?:meshdir|texturedir|assetdir)\s*=\s*["']([^"']+)["']""", text)}
        for name in NAMED.findall(text):
            for folder in folders:
                other = Path(os.path.normpath(path.parent / folder / name))
                if other.is_file() and other not in found and other.is_relative_to(root):
                    found.add(other)
                    left += [other] if other.suffix == ".xml" else []
    if sum(each.stat().st_size for each in found) > LARGEST:
        return None
    return Seed(
        path.relative_to(root).as_posix(), {each.relative_to(root).as_posix(): each.read_bytes() for each in found}
    )


def mjcf() -> Iterator[Seed]:
    from tests.fuzz import texts

    yield from (Seed("a.xml", {"a.xml": text.encode(), **texts.mjcf_files(_image())}) for text in texts.MJCF)
    for seed in _packages(("dm_control", "gymnasium", "mujoco_warp", "newton"), "*.xml"):
        if b"<mujoco" in seed.files[seed.main]:
            yield seed


def urdf() -> Iterator[Seed]:
    from tests.fuzz import texts

    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    part = {"a.stl": trimesh.exchange.stl.export_stl(cube), "a.obj": trimesh.exchange.obj.export_obj(cube).encode()}
    for text in texts.urdf():
        yield Seed("a.urdf", {"a.urdf": text.encode(), **part, "a.png": _image()})
    yield from _packages(("newton", "dm_control"), "*.urdf")


def usd() -> Iterator[Seed]:
    from tests.fuzz import stages

    for name, data in stages.stages(_image()):
        yield Seed(name, {name: data, "a.png": _image()})
    for pattern in ("*.usd", "*.usda", "*.usdc"):
        yield from _packages(("newton", "warp"), pattern)


def calibration() -> Iterator[Seed]:
    from tests.fuzz import texts

    for text in texts.calibrations():
        yield Seed("a.yaml", {"a.yaml": text.encode()})


def recipes() -> Iterator[Seed]:
    from tests.fuzz import texts

    whole = (REPOSITORY / "examples" / "dataset.yaml").read_text()
    for text in (whole, *texts.RECIPES):
        yield Seed("a.yaml", {"a.yaml": text.encode()})


def lidar() -> Iterator[Seed]:
    for channels in (1, 4, 16, 32, 128):
        angles = np.linspace(20.0, -20.0, channels).tolist()
        data = {"beam_altitude_angles": angles, "beam_azimuth_angles": angles, "lidar_mode": "512x10"}
        for whole in (data, {"beam_intrinsics": {**data, "lidar_origin_to_beam_origin_mm": 15.8}}):
            yield Seed("a.json", {"a.json": json.dumps(whole).encode()})
        rows = "".join(f"{place},{place * 7 % 360},{place % 90}\n" for place in range(8 * channels))
        yield Seed("a.csv", {"a.csv": f"time,azimuth,zenith\n{rows}".encode()})


SEEDS: dict[str, Callable[[], Iterator[Seed]]] = {
    "mjcf": mjcf, "urdf": urdf, "gltf": gltf, "obj": obj, "ply": ply, "stl": stl, "usd": usd, "splats": splats,
    "dae": dae, "msh": msh, "calibration": calibration, "recipes": recipes, "lidar": lidar,
}  # fmt: skip
