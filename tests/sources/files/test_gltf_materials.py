"""Materials of glTF files: extensions, samplers and colours of corners, as the specification draws them."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

pytest.importorskip("trimesh")

import warpcam as wc
from warpcam.core.color import srgb_to_linear

POINTS = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
UVS = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
RED, GREEN, BLUE, YELLOW = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
FOUR = np.array([[RED, GREEN], [BLUE, YELLOW]], np.uint8)
KINDS = {"<f4": 5126, "<u2": 5123, "|u1": 5121}
PAINT = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}


def data_uri(data: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def encoded(pixels: np.ndarray, kind: str = "png") -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind)
    return file.getvalue()


def write(folder: Path, material: dict[str, Any] | None, image: Any = None, **more: Any) -> Path:
    """A square, 2 m wide, that faces +z; its image's first row is on top."""
    blob, views, accessors = b"", [], []
    arrays = {"POSITION": POINTS, "TEXCOORD_0": more.pop("uvs", UVS), "COLOR_0": more.pop("colors", None), "": FACES}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    for array in arrays.values():
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        kind = {1: "SCALAR", 2: f"VEC{array.shape[-1]}"}[array.ndim]
        entry = {"bufferView": len(views) - 1, "componentType": KINDS[array.dtype.str], "count": len(array)}
        accessors.append(entry | {"type": kind, "normalized": array.dtype.kind == "u" and array is not FACES})
        blob += array.tobytes() + bytes(-array.nbytes % 4)
    places = {name: index for index, name in enumerate(arrays)}
    primitive: dict[str, Any] = {"indices": places.pop(""), "attributes": places, **more.pop("primitive", {})}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}], "buffers": [{"byteLength": len(blob), "uri": data_uri(blob)}],
        "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    if material is not None:
        primitive["material"] = 0
        tree["materials"] = [{"name": "paint", **material}]
    if image is not None:
        tree["images"] = [{"uri": data_uri(image if isinstance(image, bytes) else encoded(image))}]
        tree["textures"] = [{"source": 0}]
    path = folder / "it.gltf"
    path.write_text(json.dumps(tree | more))
    return path


def drawn(path: Path, device: wp.Device, output: str, side: int = 8) -> np.ndarray:
    """The square from above."""
    eye = wc.Camera(
        "eye", width=side, height=side, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=(output,)
    )
    scene = wc.load(path, device=device, up_axis=None)
    return wc.Renderer(scene, [eye]).render()["eye"][output][0].cpu().numpy()


def corners(path: Path, device: wp.Device, output: str = "albedo") -> list[tuple[int, ...]]:
    """Colours of the corners, row after row."""
    return [tuple(map(int, color)) for color in drawn(path, device, output)[[0, 0, -1, -1], [0, -1, 0, -1]]]


def material(name: str, factor: Any = (1, 1, 1, 1), **said: Any) -> dict[str, Any]:
    """A material of one extension."""
    return {"pbrMetallicRoughness": {"baseColorFactor": list(factor)}, "extensions": {name: said}}


UNLIT: dict[str, dict[str, Any]] = {
    "a factor": {"said": (0.5, 0.25, 1, 1)},
    "an image": {"said": (1, 1, 1, 1), "image": FOUR.repeat(8, 0).repeat(8, 1)},
    "colours of corners": {"said": (1, 1, 1, 1), "colors": np.array([(0.5, 0.25, 1)] * 4, np.float32)},
}


@pytest.mark.parametrize("output", ["rgb", "albedo"])
@pytest.mark.parametrize("kind", UNLIT)
def test_unlit(kind: str, output: str, tmp_path: Path, device: wp.Device) -> None:
    """Unlit surfaces show their base colour, and neither shine nor reflect beside it."""
    more = dict(UNLIT[kind])
    said = material("KHR_materials_unlit", more.pop("said")) | {"emissiveFactor": [1, 1, 1]}
    if "image" in more:
        said["pbrMetallicRoughness"] |= PAINT["pbrMetallicRoughness"]
    right = [RED, GREEN, BLUE, YELLOW] if "image" in more else [(188, 137, 255)] * 4
    found = corners(write(tmp_path, said, **more), device, output)
    np.testing.assert_allclose(found, right, atol=1)


@pytest.mark.parametrize("strength", [None, 0.5, 3.0])
def test_strength_of_emission(strength: float | None, tmp_path: Path, device: wp.Device) -> None:
    said = material("KHR_materials_emissive_strength", (0, 0, 0, 1), emissiveStrength=strength)
    said["pbrMetallicRoughness"] |= {"metallicFactor": 1.0}
    dark = drawn(write(tmp_path, said), device, "hdr")[4, 4]
    said["emissiveFactor"] = [1.0, 0.5, 0.25]
    glow = drawn(write(tmp_path, said), device, "hdr")[4, 4] - dark
    np.testing.assert_allclose(glow, np.array((1.0, 0.5, 0.25)) * (strength or 1.0), atol=1e-3)


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.0])
def test_index_of_refraction(ior: float, tmp_path: Path) -> None:
    said = material("KHR_materials_ior", ior=ior)
    scene = wc.load(write(tmp_path, said), device="cpu")
    reflectance = scene.array("material_reflectance").numpy()[0]
    np.testing.assert_allclose(reflectance, ((ior - 1.0) / (ior + 1.0)) ** 2, atol=1e-6)


def test_specular_and_glossiness(tmp_path: Path, device: wp.Device) -> None:
    said = {"diffuseFactor": [1, 0.5, 1, 1], "diffuseTexture": {"index": 0}, "specularFactor": [0.04] * 3}
    path = write(tmp_path, material("KHR_materials_pbrSpecularGlossiness", **said, glossinessFactor=0.25), FOUR[:1, :1])
    np.testing.assert_array_equal(corners(path, device), [RED] * 4)
    scene = wc.load(path, device="cpu")
    found = [scene.array(f"material_{name}").numpy().item() for name in ("roughness", "metallic", "reflectance")]
    np.testing.assert_allclose(found, (0.75, 0.0, 0.04), atol=1e-6)


def test_strength_of_maps(tmp_path: Path, device: wp.Device) -> None:
    """A map of normals without a scale does nothing; one of occlusion of half its strength takes half."""
    tilted = np.full((2, 2, 3), (218, 128, 218), np.uint8)
    said = {"pbrMetallicRoughness": {"metallicFactor": 0.0}, "normalTexture": {"index": 0, "scale": 0.0}}
    flat = drawn(write(tmp_path, {"pbrMetallicRoughness": {"metallicFactor": 0.0}}), device, "hdr")
    np.testing.assert_allclose(drawn(write(tmp_path, said, tilted), device, "hdr"), flat, atol=0.01)
    light = []
    for strength in (0.0, 0.5, 1.0):
        said = {"pbrMetallicRoughness": {"metallicFactor": 0.0}, "occlusionTexture": {"index": 0, "strength": strength}}
        light.append(drawn(write(tmp_path, said, np.zeros((2, 2, 3), np.uint8)), device, "hdr")[4, 4, 0])
    assert light[0] > light[2] + 0.05
    assert light[1] == pytest.approx(0.5 * (light[0] + light[2]), abs=2e-3)


REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
WIDE = np.array([(-1, 2), (2, 2), (2, -1), (-1, -1)], np.float32)  # three images along each side
ORDER = {REPEAT: (0, 1, 0, 1, 0, 1), CLAMP: (0, 0, 0, 1, 1, 1), MIRROR: (1, 0, 0, 1, 1, 0)}


@pytest.mark.parametrize("across", ORDER)
@pytest.mark.parametrize("along", ORDER)
def test_wrap_modes(along: int, across: int, tmp_path: Path, device: wp.Device) -> None:
    more = {"samplers": [{"wrapS": along, "wrapT": across}], "textures": [{"source": 0, "sampler": 0}], "uvs": WIDE}
    path = write(tmp_path, PAINT, FOUR.repeat(8, 0).repeat(8, 1), **more)
    found = drawn(path, device, "albedo", 12)[1::2, 1::2]
    right = FOUR[np.ix_(ORDER[across], ORDER[along])].astype(int)
    np.testing.assert_allclose(found, right, atol=2)


@pytest.mark.parametrize("mode", [CLAMP, MIRROR])
def test_sides_of_an_image_that_does_not_repeat(mode: int, tmp_path: Path, device: wp.Device) -> None:
    """Colours of one side do not show at the other."""
    more = {"samplers": [{"wrapS": mode, "wrapT": mode}], "textures": [{"source": 0, "sampler": 0}]}
    path = write(tmp_path, PAINT, FOUR, **more)
    np.testing.assert_allclose(corners(path, device), [RED, GREEN, BLUE, YELLOW], atol=2)


def test_wraps_of_every_map(tmp_path: Path) -> None:
    """Images of another size lie like those of the base colour."""
    said = PAINT | {"emissiveTexture": {"index": 1}, "emissiveFactor": [1, 1, 1]}
    more = {
        "samplers": [{"wrapS": CLAMP, "wrapT": CLAMP}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 0}],
        "images": [{"uri": data_uri(encoded(FOUR.repeat(n, 0).repeat(n, 1)))} for n in (8, 2)],
        "uvs": WIDE,
    }
    path = write(tmp_path, said, **more)
    scene = wc.load(path, device="cpu", up_axis=None)
    eye = wc.Camera("eye", width=12, height=12, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=("hdr",))
    light = wc.Renderer(scene, [eye]).render()["eye"]["hdr"][0].numpy()[1::2, 1::2]
    right = srgb_to_linear(FOUR[np.ix_(ORDER[CLAMP], ORDER[CLAMP])] / 255.0)
    assert ((light > 0.5) == (right > 0.5))[[0, 0, -1, -1], [0, -1, 0, -1]].all()


@pytest.mark.parametrize(("mode", "right"), [(9728, 0), (9729, 1)], ids=["nearest", "linear"])
def test_filters(mode: int, right: int, tmp_path: Path, device: wp.Device) -> None:
    """Texels that are not smoothed end where the next ones begin."""
    more = {"samplers": [{"magFilter": mode}], "textures": [{"source": 0, "sampler": 0}]}
    found = drawn(write(tmp_path, PAINT, FOUR, **more), device, "albedo", 16).astype(int)
    blends = np.abs(found - FOUR.repeat(8, 0).repeat(8, 1)).max() > 40
    assert blends == bool(right)


@pytest.mark.parametrize("mode", ["OPAQUE", "BLEND", "MASK"])
@pytest.mark.parametrize("even", [True, False], ids=["one alpha", "several"])
def test_alpha_of_corners(even: bool, mode: str, tmp_path: Path, caplog: Any, device: wp.Device) -> None:
    """It counts for what blends or is cut out, and only there."""
    alphas = np.full(4, 0.25, np.float32) if even else np.array([1, 1, 0, 0], np.float32)  # solid below
    colors = np.concatenate((np.tile((1.0, 0.0, 0.0), (4, 1)), alphas[:, None]), axis=1).astype(np.float32)
    said = material("KHR_materials_unlit") | {"alphaMode": mode, "doubleSided": True}
    path = write(tmp_path, said, colors=colors)
    alpha = drawn(path, device, "rgba", 16)[..., 3].astype(int)
    assert not caplog.text
    if mode == "OPAQUE":
        assert (alpha == 255).all()
    elif even:
        np.testing.assert_allclose(alpha, 64 if mode == "BLEND" else 0, atol=1)
    elif mode == "BLEND":
        np.testing.assert_allclose(alpha[:, 8], np.linspace(0, 255, 33)[1::2], atol=4)
    else:
        np.testing.assert_array_equal(alpha[:, 8], np.repeat((0, 255), 8))


def test_the_default_material(tmp_path: Path, device: wp.Device) -> None:
    """White, as the specification says."""
    assert corners(write(tmp_path, None), device) == [(255, 255, 255)] * 4


RATIFIED = (
    "KHR_animation_pointer", "KHR_materials_anisotropy", "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission", "KHR_materials_dispersion", "KHR_materials_iridescence",
    "KHR_materials_sheen", "KHR_materials_specular",
    "KHR_materials_variants", "KHR_materials_volume", "KHR_node_hoverability",
    "KHR_node_selectability", "KHR_texture_basisu", "KHR_xmp_json_ld", "EXT_lights_image_based",
    "EXT_meshopt_compression", "MSFT_lod", "VENDOR_of_tomorrow",
)  # fmt: skip


@pytest.mark.parametrize("listed", [True, False], ids=["listed", "not listed"])
@pytest.mark.parametrize("name", RATIFIED)
def test_extensions_that_are_not_drawn_are_named(name: str, listed: bool, tmp_path: Path, caplog: Any) -> None:
    more = {"extensionsUsed": [name]} if listed else {"nodes": [{"mesh": 0, "extensions": {name: {}}}]}
    wc.load(write(tmp_path, None, **more), device="cpu")
    assert caplog.text.count("uses extensions of glTF that are not drawn") == 1
    assert name in caplog.text


DRAWN = (
    "KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_texture_transform",
    "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "EXT_texture_webp", "KHR_draco_mesh_compression",
    "KHR_lights_punctual", "KHR_node_visibility", "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
)  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_extensions_that_are_drawn_are_not_told(name: str, tmp_path: Path, caplog: Any) -> None:
    wc.load(write(tmp_path, None, extensionsUsed=[name]), device="cpu")
    assert not caplog.text


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_lines_are_told(mode: int, tmp_path: Path, caplog: Any) -> None:
    path = write(tmp_path, None)
    tree = json.loads(path.read_text())
    tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": mode})
    path.write_text(json.dumps(tree))
    wc.load(path, device="cpu")
    assert "has lines, which are not drawn" in caplog.text


def test_primitives_without_positions_are_told(tmp_path: Path, caplog: Any) -> None:
    path = write(tmp_path, None)
    tree = json.loads(path.read_text())
    tree["meshes"][0]["primitives"].append({"attributes": {}})
    path.write_text(json.dumps(tree))
    wc.load(path, device="cpu")
    assert "has a primitive without positions, which is not drawn" in caplog.text


def test_nodes_that_are_not_visible(tmp_path: Path) -> None:
    """Neither the node nor what is below it is drawn."""
    nodes = [
        {"mesh": 0},
        {"children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}},
        {"mesh": 0, "translation": [5, 0, 0]},
    ]
    path = write(tmp_path, None, nodes=nodes, scenes=[{"nodes": [0, 1]}])
    low, high = wc.load(path, device="cpu", up_axis=None).bounds()
    np.testing.assert_allclose((low, high), ((-1, -1, 0), (1, 1, 0)), atol=1e-6)


@pytest.mark.parametrize("extension", ["EXT_texture_webp", "KHR_texture_basisu"])
def test_images_of_extensions(extension: str, tmp_path: Path, caplog: Any, device: wp.Device) -> None:
    """The extension's image if it can be read, or else the plain one; neither gives the base colour, and a warning."""
    better = encoded(np.full((4, 4, 3), BLUE, np.uint8), "webp") if "webp" in extension else b"no image at all"
    images = [{"uri": data_uri(encoded(np.full((4, 4, 3), RED, np.uint8)))}, {"uri": data_uri(better)}]
    more = {"images": images, "textures": [{"source": 0, "extensions": {extension: {"source": 1}}}]}
    right = BLUE if "webp" in extension else RED
    np.testing.assert_allclose(corners(write(tmp_path, PAINT, **more), device), [right] * 4, atol=8)
    assert "cannot be read" not in caplog.text
    more["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 1}}}]
    more["images"][1] = {"uri": data_uri(b"no image at all")}
    assert corners(write(tmp_path, PAINT, **more), device) == [(255, 255, 255)] * 4
    assert "has a texture that cannot be read (its format is not known)" in caplog.text
