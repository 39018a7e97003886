"""Textures on shapes beside ``mujoco.Renderer`` of the version that is installed: MuJoCo 3.12 lays them another way."""

import io

import mujoco
import numpy as np
import pytest
import warp as wp
from mujoco_reference import reference_renderer
from PIL import Image

import warpcam as wc
from warpcam.sources.mujoco import model as mujoco_model

SIZE = 128
FINE = 120  # slices and stacks of what MuJoCo draws round
LIMIT = 6  # of 255
VERTICES = "-1 -1 0  1 -1 0  1 1 .4  -1 1 0  0 0 1"
FACES = "0 1 4  1 2 4  2 3 4  3 0 4  3 2 1  3 1 0"
ASSETS = f"""
  <texture name="coordinates" type="2d" file="coordinates.png"/>
  <texture name="cube" type="cube" file="coordinates.png"/>
  <material name="m" texture="{{texture}}" texrepeat="1.5 2" texuniform="{{uniform}}" specular="0"/>
  <mesh name="own" vertex="{VERTICES}" face="{FACES}" texcoord="0 0 1 0 1 1 0 1 .5 .5" scale=".3 .25 .3"/>
  <mesh name="plain" vertex="{VERTICES}" face="{FACES}" scale=".3 .25 .3"/>
  <hfield name="hills" nrow="3" ncol="3" size=".3 .25 .2 .1" elevation="0 .5 0 .2 1 .3 0 .4 .1"/>
"""
PLACES = [(x, y) for y in (0.8, 0.0, -0.8) for x in (-0.8, 0.0, 0.8)]
SHAPES = {
    "box": 'type="box" size=".3 .25 .2"',
    "sphere": 'type="sphere" size=".3"',
    "ellipsoid": 'type="ellipsoid" size=".3 .25 .2"',
    "capsule": 'type="capsule" size=".2 .15" euler="50 0 20"',
    "cylinder": 'type="cylinder" size=".25 .2" euler="30 0 20"',
    "plane": 'type="plane" size=".3 .2 .1"',
    "mesh with coordinates": 'type="mesh" mesh="own"',
    "mesh without": 'type="mesh" mesh="plain"',
    "height field": 'type="hfield" hfield="hills"',
}
CHANGED = ("box", "sphere", "ellipsoid", "capsule", "cylinder", "plane", "mesh with coordinates")
LIT = f"""
  <visual><quality offsamples="0" numslices="{FINE}" numstacks="{FINE}" shadowsize="16"/>
    <headlight ambient=".6 .6 .6" diffuse=".4 .4 .4" specular="0 0 0"/></visual>
"""
CAMERA = '<camera pos="0 -2.2 2.6" xyaxes="1 0 0 0 2.6 2.2" fovy="48"/>'


def coordinates() -> bytes:
    """An image whose red grows to the right and whose green grows downwards."""
    down, right = np.mgrid[0:64, 0:64] * 4
    file = io.BytesIO()
    Image.fromarray(np.stack((right, down, np.full_like(right, 128)), axis=-1).astype(np.uint8)).save(file, "PNG")
    return file.getvalue()


def compiled(
    world: str, texture: str = "coordinates", uniform: bool = False, more: str = ""
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    assets = ASSETS.format(texture=texture, uniform=str(uniform).lower())
    mjm = mujoco.MjModel.from_xml_string(
        f"<mujoco>{LIT}<asset>{assets}</asset><worldbody>{world}{CAMERA}</worldbody>{more}</mujoco>",
        {"coordinates.png": coordinates()},
    )
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


def paint(mjm: mujoco.MjModel, mjd: mujoco.MjData) -> np.ndarray:
    """(height, width, 3) uint8."""
    with reference_renderer(mjm, SIZE, SIZE) as renderer:
        renderer.update_scene(mjd, camera=0)
        return renderer.render().copy()


def near(painted: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Pixels no farther than LIMIT from what the others have there and around, (height, width) bool."""
    padded = np.pad(painted.astype(int), ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = np.stack([padded[i : i + SIZE, j : j + SIZE] for i in range(3) for j in range(3)])
    return ((seen >= around.min(axis=0) - LIMIT) & (seen <= around.max(axis=0) + LIMIT)).all(axis=-1)


def all_shapes() -> str:
    shapes = zip(PLACES, SHAPES.values(), strict=True)
    return "".join(f'<geom pos="{x} {y} 0" material="m" {shape}/>' for (x, y), shape in shapes)


def shares(painted: np.ndarray, seen: np.ndarray, ids: np.ndarray) -> dict[int, float]:
    """Return, for each shape's id, the part of its pixels that differ."""
    wrong = ~near(painted, seen)
    return {int(shape): float(wrong[ids == shape].mean()) for shape in np.unique(ids) if shape >= 0}


def looked(mjm: mujoco.MjModel, mjd: mujoco.MjData, device: wp.Device, *outputs: str) -> dict[str, np.ndarray]:
    camera = wc.Camera(0, width=SIZE, height=SIZE, outputs=outputs)
    images = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [camera]).render()[0]
    host = {name: image[0].cpu().numpy() for name, image in images.items()}
    return {name: image[..., 0] if image.shape[-1] == 1 else image for name, image in host.items()}


@pytest.mark.parametrize("uniform", [False, True])
def test_textures_lie_as_the_installed_version_lays_them(
    device: wp.Device, uniform: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mjm, mjd = compiled(all_shapes(), uniform=uniform)
    painted = paint(mjm, mjd)
    seen = looked(mjm, mjd, device, "rgb", "segmentation")
    by_shape = shares(painted, seen["rgb"], seen["segmentation"])
    print({name: f"{share:.1%}" for name, share in zip(SHAPES, by_shape.values(), strict=True)})
    assert max(by_shape.values()) < 0.03
    # The rule of the other versions would be seen.
    monkeypatch.setattr(mujoco_model, "VERSION", (3, 17) if mujoco_model.VERSION < (3, 12) else (3, 11))
    other = looked(mjm, mjd, device, "rgb", "segmentation")
    by_shape = shares(painted, other["rgb"], other["segmentation"])
    for name, share in zip(SHAPES, by_shape.values(), strict=True):
        assert (share > 0.3) == (name in CHANGED), (name, share)


def test_up_to_3_11_they_lie_on_shapes_from_above(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """With any version: the texture shows its own coordinates."""
    monkeypatch.setattr(mujoco_model, "VERSION", (3, 11))
    mjm, mjd = compiled('<geom type="box" size=".6 .5 .4" material="m"/>')
    seen = looked(mjm, mjd, device, "albedo", "points", "segmentation")
    seen = {name: image[seen["segmentation"] == 0] for name, image in seen.items()}
    place = (np.array((0.75, -1.0)) * seen["points"][:, :2] / (0.6, 0.5) - 0.5) % 1.0
    inner = ((place > 0.1) & (place < 0.9)).all(axis=-1)
    off = np.abs((seen["albedo"][:, :2] / 4.0 + 0.5) / 64.0 - place)[inner]
    assert inner.sum() > 1500 and off.max() < 0.02


def test_lights_that_have_no_place(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Point lights are not drawn, and shone as the headlight does before 3.12."""
    light = '<light type="point" pos="1 1 2" diffuse=".5 .1 0" ambient="0 .1 0" specular="0 0 0" castshadow="false"/>'
    mjm, mjd = compiled(all_shapes() + light)
    painted = paint(mjm, mjd)
    seen = looked(mjm, mjd, device, "rgb", "segmentation")
    assert max(shares(painted, seen["rgb"], seen["segmentation"]).values()) < 0.03
    for version, brighter in (((3, 11), True), ((3, 12), False)):
        monkeypatch.setattr(mujoco_model, "VERSION", version)
        with_it = mujoco_model.headlight(mjm).sum() - mjm.vis.headlight.ambient.sum() - mjm.vis.headlight.diffuse.sum()
        assert with_it == pytest.approx(0.7 if brighter else 0.0, abs=1e-6)
        mjm.vis.headlight.active = 0
        assert mujoco_model.global_ambient(mjm) == (0.0 if brighter else 0.3)
        mjm.vis.headlight.active = 1


SMALL = " ".join(f"{0.5 * float(value):g}" for value in VERTICES.split())


def flex(kind: str, more: str = "") -> str:
    return f"""
      <body name="held"><flexcomp name="soft" type="{kind}" mass="1" material="m" {more}>
        <contact selfcollide="none"/></flexcomp></body>
      <geom type="cylinder" size=".3 .2" pos="0 .8 0" material="m"/>
    """


def skin() -> str:
    bone = '<bone body="held" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2 3 4" vertweight="1 1 1 1 1"/>'
    return f"""
      <deformable><skin name="skin" vertex="{SMALL}" face="{FACES}" inflate=".01" material="m"
        texcoord="0 0 1 0 1 1 0 1 .5 .5">{bone}</skin></deformable>
    """


HELD = '<body name="held"><geom size=".05"/></body><geom type="cylinder" size=".3 .2" pos="0 .8 0" material="m"/>'
PYRAMID = f'point="{SMALL}" element="{FACES}" radius=".01"'
SOFT = {  # the world, what stands beside it, and whether 2-D textures show
    "line": (flex("grid", 'dim="1" count="4 1 1" spacing=".5 .5 .5" radius=".2"'), "", False),
    "cloth": (flex("grid", 'dim="2" count="4 3 1" spacing=".5 .5 .5" radius=".02"'), "", True),
    "solid": (flex("grid", 'dim="3" count="4 3 2" spacing=".5 .5 .5" radius=".02"'), "", True),
    "cloth without coordinates": (flex("direct", f'dim="2" {PYRAMID}'), "", False),
    "skin": (HELD, skin(), True),
}


@pytest.mark.parametrize(
    ("name", "texture"),
    [*((name, "coordinates") for name in SOFT), *((name, "cube") for name in SOFT if not SOFT[name][2])],
)
def test_what_is_soft_shows_textures_by_its_own_coordinates_alone(device: wp.Device, name: str, texture: str) -> None:
    """And repeats them as often as the material says, uniform or not.

    With such coordinates a cube texture is not shown; what is instead is anything.
    """
    world, more, shows = SOFT[name]
    mjm, mjd = compiled(world, texture=texture, uniform=True, more=more)
    painted = paint(mjm, mjd)
    seen = looked(mjm, mjd, device, "rgb", "segmentation")
    ids, rgb = seen["segmentation"], seen["rgb"].astype(int)
    can, soft = 0, int(ids.max())
    assert soft == mjm.ngeom
    by_shape = shares(painted, rgb, ids)
    assert by_shape[can] < 0.03 and by_shape[soft] < 0.04
    textured = [bool((np.ptp(rgb[ids == which], axis=1) > 40).any()) for which in (can, soft)]
    assert textured == [True, shows]


def of_channels(channels: int) -> bytes:
    """An image whose colours and alpha differ everywhere."""
    down, right = np.mgrid[0:64, 0:64] * 4
    pixels = np.stack((right, down, 255 - right // 2, 255 - down), axis=-1).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels[..., 0] if channels == 1 else pixels[..., :channels]).save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize("shape", ["box", "sphere", "plane", "mesh with coordinates"])
@pytest.mark.parametrize("alpha", [0.6, 1.0])
def test_the_alpha_of_a_texture_counts_on_what_is_transparent(device: wp.Device, shape: str, alpha: float) -> None:
    floor = '<geom type="plane" size="3 3 1" pos="0 0 -.4" rgba=".1 .8 .2 1"/>'
    found = []
    for channels in (4, 3):
        mjm = mujoco.MjModel.from_xml_string(
            f"""<mujoco>{LIT}<asset>{ASSETS.format(texture="t", uniform="false")}
            <texture name="t" type="2d" file="t.png" nchannel="{channels}"/>
            <material name="n" texture="t" rgba="1 1 1 {alpha}" specular="0"/></asset>
            <worldbody>{floor}<geom material="n" {SHAPES[shape]}/>
            <camera pos="0 -.8 .9" xyaxes="1 0 0 0 .9 .8" fovy="45"/></worldbody></mujoco>""",
            {"coordinates.png": coordinates(), "t.png": of_channels(channels)},
        )
        mjd = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, mjd)
        found.append((paint(mjm, mjd), looked(mjm, mjd, device, "rgb", "segmentation")))
    (painted, seen), (_, opaque) = found
    there = seen["segmentation"] == 1
    wrong = ~near(painted, seen["rgb"])
    assert there.sum() > 1000 and wrong[there].mean() < 0.03 and wrong[~there].mean() < 0.03
    # Without alpha it would look another way, where it is transparent.
    differs = (np.abs(seen["rgb"][there].astype(int) - opaque["rgb"][there]) > 20).any(axis=-1).mean()
    assert (differs > 0.3) == (alpha < 1.0), differs


def test_textures_of_one_channel_are_not_shown(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    mjm = mujoco.MjModel.from_xml_string(
        f"""<mujoco>{LIT}<asset><texture name="grey" type="2d" file="t.png" nchannel="1"/>
        <material name="m" texture="grey" rgba=".9 .6 .3 1" specular="0"/></asset>
        <worldbody><geom type="box" size=".3 .3 .2" material="m"/>{CAMERA}</worldbody></mujoco>""",
        {"t.png": of_channels(1)},
    )
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    seen = looked(mjm, mjd, device, "rgb", "albedo", "segmentation")
    assert "texture 'grey' has 1 channels and is not shown" in caplog.text
    assert (np.abs(seen["albedo"][seen["segmentation"] == 0].astype(int) - (230, 153, 77)) <= 1).all()
    if mujoco_model.VERSION >= (3, 17):  # older ones draw no such model at all
        assert near(paint(mjm, mjd), seen["rgb"]).mean() > 0.99


def test_groups_beyond_are_the_first_and_the_last(device: wp.Device) -> None:
    balls = "".join(
        f'<geom size=".2" pos="{0.5 * index - 0.75} 0 0" rgba=".8 .3 .1 1" group="{group}"/>'
        for index, group in enumerate((0, -1, 3, 7))
    )
    mjm, mjd = compiled(balls)
    seen = looked(mjm, mjd, device, "rgb", "segmentation")
    assert set(np.unique(seen["segmentation"])) == {-1, 0, 1}
    assert near(paint(mjm, mjd), seen["rgb"]).mean() > 0.98
    scene = wc.from_mujoco(mjm, mjd, groups=(5,), device=device)
    camera = wc.Camera(0, width=SIZE, height=SIZE, outputs=("segmentation",))
    assert set(np.unique(wc.Renderer(scene, [camera]).render()[0]["segmentation"].cpu().numpy())) == {-1, 3}


TETRAHEDRON = """
<mujoco>
  <asset>
    <texture name="checks" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0" width="16" height="16"/>
    <material name="m" texture="checks"/>
    <mesh name="other" vertex="1 1 1  1 -1 -1  -1 1 -1  -1 -1 1" texcoord=".7 .7 .7 .7 .7 .7 .7 .7"/>
    <mesh name="tetrahedron" vertex="1 1 1  1 -1 -1  -1 1 -1  -1 -1 1" texcoord=".1 .1 .1 .1 .1 .1 .7 .7"/>
  </asset>
  <worldbody>
    <camera pos="0 -4 0" xyaxes="1 0 0 0 0 1"/><geom type="mesh" mesh="tetrahedron" material="m"/>
  </worldbody>
</mujoco>
"""


def seen_with(device: wp.Device, of: slice, corner: int, index: int, start: int | None = None) -> np.ndarray:
    """An image of a mesh, some of whose faces have another index of a corner's coordinate, as uint8."""
    mjm = mujoco.MjModel.from_xml_string(TETRAHEDRON)
    mesh = mjm.mesh("tetrahedron")
    first = int(mesh.faceadr[0])
    mjm.mesh_facetexcoord[first : first + 4][of, corner] = index
    if start is not None:
        mjm.mesh_texcoordadr[mesh.id] = start
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    with wp.ScopedDevice(device):
        renderer = wc.Renderer(wc.from_mujoco(mjm, mjd), [wc.Camera(0, width=64, height=64, outputs=("albedo",))])
        return renderer.render()[0]["albedo"][0].cpu().numpy()


@pytest.mark.parametrize("corner", [0, 2])
def test_faces_without_texture_coordinates_are_projected_on(device: wp.Device, corner: int) -> None:
    """Faces of OBJ files may leave out some; MuJoCo-Warp projects on them, and so on all of a mesh that has none."""
    projected, given = seen_with(device, slice(4), 0, 0, start=-1), seen_with(device, slice(0), 0, 0)
    assert (seen_with(device, slice(4), corner, -1) == projected).all() and (projected != given).any()
    single = [seen_with(device, slice(face, face + 1), corner, -1) for face in range(4)]
    for image in single:
        assert ((image == projected) | (image == given)).all(axis=-1).mean() > 0.99 and (image != projected).any()
    assert any((image != given).any() for image in single)


@pytest.mark.parametrize("index", [-2, 4])
def test_indices_beyond_the_coordinates_are_told(device: wp.Device, index: int) -> None:
    with pytest.raises(wc.WarpcamError, match=r"mesh_facetexcoord must be indices from -1 to 3, got .* at face 1"):
        seen_with(device, slice(1, 2), 0, index)
