"""Occlusion by rays in the real-time look: light from all around that shapes hide, and soft shadows."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.core.errors import WarpcamError

pytest.importorskip("pxr.Usd")
from pbr_scenes import bind
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_material, add_mesh

DARK = 0.05  # a colour so dark that light from surface to surface does not count
BOX = np.array([(-0.4, -0.3, 0.25), (0.4, 0.3, 0.55)])  # corners, above the floor


def alike(seen: np.ndarray, wanted: np.ndarray, most: float, rms: float) -> None:
    error = seen - wanted
    assert np.abs(error).max() < most
    assert np.sqrt((error**2).mean()) < rms


def floor_under_a_sky(stage: Usd.Stage, color: float = DARK) -> UsdShade.Shader:
    """A matt floor of 8 m under an even sky of radiance 1."""
    floor = add_mesh(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2, 3)])
    UsdLux.DomeLight.Define(stage, "/sky")
    return bind(floor, stage, diffuseColor=(color,) * 3, ior=1.0)


def add_box(stage: Usd.Stage, corners: np.ndarray) -> UsdGeom.Cube:
    box = UsdGeom.Cube.Define(stage, "/box")
    box.CreateSizeAttr(2.0)
    place = UsdGeom.Xformable(box)
    place.AddTranslateOp().Set(Gf.Vec3d(*map(float, corners.mean(0))))
    place.AddScaleOp().Set(Gf.Vec3f(*map(float, 0.5 * (corners[1] - corners[0]))))
    return box


def looking_down(height: float, width: float, size: tuple[int, int] = (64, 48), **more: Any) -> wc.Camera:
    """Its pixels are ``width / size[0]`` wide, columns along x, rows against y."""
    lens = wc.Orthographic(height=width * size[1] / size[0])
    options = {"position": (0.0, 0.0, height), "outputs": ("hdr",), "width": size[0], "height": size[1], **more}
    return wc.Camera("c", lens=lens, **options)


def places(width: float, size: tuple[int, int] = (64, 48)) -> np.ndarray:
    """Where on the floor they look, (height, width, 2)."""
    pixel = width / size[0]
    x, y = (np.arange(count) + 0.5 - count / 2 for count in size)
    return np.stack(np.meshgrid(pixel * x, -pixel * y), axis=-1)


def forwarded(model: mujoco.MjModel, height: float | None = None) -> mujoco.MjData:
    state = mujoco.MjData(model)
    if height is not None:
        state.qpos[2] = height
    mujoco.mj_forward(model, state)
    return state


def lit(scene: wc.Scene, camera: wc.Camera, **options: Any) -> np.ndarray:
    return wc.Renderer(scene, [camera], **options).render()["c"]["hdr"].cpu().numpy()[..., 0]


def open_share(points: np.ndarray, corners: np.ndarray, radius: float, rays: int = 4000) -> np.ndarray:
    """Share of cosine-weighted rays from places on the floor that meet no box within a radius."""
    random = np.random.default_rng(0)
    u, angle = random.random(rays), 2.0 * np.pi * random.random(rays)
    d = np.stack((np.sqrt(u) * np.cos(angle), np.sqrt(u) * np.sin(angle), np.sqrt(1.0 - u)), axis=-1)
    found = []
    for x, y in points.reshape(-1, 2):
        at = (corners[:, None] - np.array((x, y, 0.0))) / np.where(np.abs(d) < 1e-9, 1e-9, d)
        near, far = np.minimum(*at).max(axis=-1), np.maximum(*at).min(axis=-1)
        found.append(1.0 - np.mean((near <= far) & (far > 0.0) & (near < radius)))
    return np.array(found).reshape(points.shape[:-1])


@pytest.mark.parametrize("radius", [0.6, math.inf])
def test_a_floor_below_a_box(stage: Usd.Stage, radius: float, device: wp.Device) -> None:
    """What is open of the sky, against rays of numpy: the filter leaves little noise, and no bias but at the ends."""
    floor_under_a_sky(stage)
    add_box(stage, BOX)
    camera = looking_down(0.2, 2.4)  # from below the box
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, camera, look="pbr", ambient_occlusion=radius)[0] / DARK
    wanted = open_share(places(2.4)[::4, ::4], BOX, radius)
    alike(seen[::4, ::4], wanted, 0.06, 0.02)
    assert abs((seen[::4, ::4] - wanted).mean()) < 0.01
    assert wanted.min() < 0.5 < 0.98 < wanted.max()


def test_a_floor_beside_a_wall(stage: Usd.Stage, device: wp.Device) -> None:
    """Beside a long wall of height h the share (1 + cos(atan(h / x))) / 2 is open; paths see the same."""
    floor_under_a_sky(stage)
    add_box(stage, np.array([(-1.0, -40.0, 0.0), (-0.5, 40.0, 1.0)]))
    camera = looking_down(5.0, 2.0, (64, 4), position=(0.5, 0.0, 5.0))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, camera, look="pbr", ambient_occlusion=math.inf)[0].mean(axis=0)
    paths = wc.PathOptions(samples=512, bounces=1)
    traced = lit(scene, camera, look="path", path=paths)[0].mean(axis=0)
    x = places(2.0, (64, 4))[0, :, 0] + 1.0
    on_floor = x > 0.03
    wanted = 0.5 * (1.0 + np.cos(np.arctan2(1.0, x)))
    alike(seen[on_floor] / DARK, wanted[on_floor], 0.06, 0.02)
    alike(traced[on_floor] / DARK, wanted[on_floor], 0.05, 0.02)


def test_light_from_surface_to_surface_brightens_corners(stage: Usd.Stage, device: wp.Device) -> None:
    """A white corner in an even sky is brighter than what is open of the sky, a dark one as bright."""
    shares = {}
    surface = floor_under_a_sky(stage)
    add_box(stage, BOX)
    for color in (DARK, 0.8):
        surface.GetInput("diffuseColor").Set(Gf.Vec3f(color, color, color))
        scene = wc.from_usd(stage, device=device, exposure=0.0)
        shares[color] = lit(scene, looking_down(0.2, 2.4), look="pbr", ambient_occlusion=math.inf)[0] / color
    hidden = (shares[DARK] > 0.2) & (shares[DARK] < 0.6)
    assert hidden.any()
    assert (shares[0.8][hidden] > shares[DARK][hidden] + 0.1).all()


def test_metal_mirrors_less_of_a_sky_that_is_hidden(stage: Usd.Stage, device: wp.Device) -> None:
    """A rough metal has what is open of the sky, and grey light for the rest; what is all open loses nothing."""
    floor = add_mesh(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2, 3)])
    bind(floor, stage, diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
    UsdLux.DomeLight.Define(stage, "/sky")
    box = add_box(stage, BOX)
    camera = looking_down(0.2, 2.4)
    hidden = lit(wc.from_usd(stage, device=device), camera, look="pbr", ambient_occlusion=math.inf)[0]
    UsdGeom.Imageable(box).MakeInvisible()
    scene = wc.from_usd(stage, device=device)
    bare = lit(scene, camera, look="pbr")[0]
    np.testing.assert_allclose(lit(scene, camera, look="pbr", ambient_occlusion=math.inf)[0], bare, rtol=5e-3)
    share = open_share(places(2.4)[24:25, 32:33], BOX, math.inf)[0, 0]
    assert share + 0.1 * (1.0 - share) < hidden[24, 32] / bare[24, 32] < share + 0.5 * (1.0 - share)


@pytest.mark.parametrize("roughness", [0.35, 0.5, 0.7])
def test_a_metal_beside_a_wall_is_that_of_paths(stage: Usd.Stage, roughness: float, device: wp.Device) -> None:
    """It is darker where its lobe looks at the wall than where it looks away, and as bright as paths find it."""
    floor = add_mesh(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2, 3)])
    bind(floor, stage, diffuseColor=(0.9, 0.9, 0.9), metallic=1.0, roughness=roughness)
    wall = add_mesh(stage, "/wall", [(1, 4, 0), (1, -4, 0), (1, -4, 4), (1, 4, 4)], [(0, 1, 2, 3)])
    add_material(stage, "/Looks/wall", diffuseColor=(0.4, 0.4, 0.4), roughness=1.0, ior=1.0)
    UsdShade.MaterialBindingAPI.Apply(wall.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/wall"))
    UsdLux.DomeLight.Define(stage, "/sky")
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    means = []
    for side in (-1.0, 1.0):  # the camera looks along x at 45 degrees to the floor, towards the wall or away
        half = math.sqrt(0.5)
        turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(side * half, 0, half)).GetQuat()
        lens, place = wc.Orthographic(height=0.1), (0.5 + 0.3 * side, 0.0, 0.3)
        camera = wc.Camera(
            "c",
            width=16,
            height=16,
            lens=lens,
            position=place,
            rotation=(turn.GetReal(), *turn.GetImaginary()),
            outputs=("hdr",),
        )
        ways = ({"look": "path", "path": wc.PathOptions(samples=256)}, {"look": "pbr", "ambient_occlusion": math.inf})
        means.append([lit(scene, camera, **way).mean() for way in ways])
    (toward, seen_toward), (away, seen_away) = means
    assert toward < 0.9 * away
    assert seen_toward == pytest.approx(toward, rel=0.1)
    assert seen_away == pytest.approx(away, rel=0.1)


EDGE = 0.5  # height of the wall's edge [m]
LAMP = 2.0  # of the lamp


def half_plane(stage: Usd.Stage) -> None:
    """A floor, half of which lies below a wall at EDGE, x > 0."""
    floor = add_mesh(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2, 3)])
    bind(floor, stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    points = [(0, -4, EDGE), (4, -4, EDGE), (4, 4, EDGE), (0, 4, EDGE)]
    add_mesh(stage, "/wall", points, [(0, 1, 2, 3)]).CreateDoubleSidedAttr(True)


def with_a_sun(stage: Usd.Stage, device: wp.Device) -> tuple[wc.Scene, float]:
    half_plane(stage)
    UsdLux.DistantLight.Define(stage, "/lamp").CreateAngleAttr(10.0)
    return wc.from_usd(stage, device=device, exposure=0.0), EDGE * math.tan(math.radians(5.0))


def with_a_lamp(stage: Usd.Stage, device: wp.Device, kind: str) -> tuple[wc.Scene, float]:
    half_plane(stage)
    lamp = getattr(UsdLux, kind).Define(stage, "/lamp")
    lamp.CreateRadiusAttr(0.2)
    lamp.CreateIntensityAttr(30.0)
    UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, LAMP))
    return wc.from_usd(stage, device=device, exposure=0.0), 0.2 * EDGE / (LAMP - EDGE)


def with_a_bulb(stage: Usd.Stage, device: wp.Device) -> tuple[wc.Scene, float]:
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><visual><headlight active="0"/></visual><worldbody>
      <light pos="0 0 {LAMP}" dir="0 0 -1" cutoff="180" bulbradius="0.2" diffuse="1 1 1" specular="0 0 0"/>
      <geom type="plane" size="0 0 1" rgba="1 1 1 1"/>
      <geom type="box" pos="2 0 {EDGE + 0.0005}" size="2 4 0.0005"/></worldbody></mujoco>""")
    return wc.from_mujoco(model, [forwarded(model)], device=device), 0.2 * EDGE / (LAMP - EDGE)


LAMPS = {
    "sun": with_a_sun,
    "ball": lambda stage, device: with_a_lamp(stage, device, "SphereLight"),
    "disk": lambda stage, device: with_a_lamp(stage, device, "DiskLight"),
    "bulb": with_a_bulb,
}


@pytest.mark.parametrize("name", LAMPS)
def test_a_shadow_is_as_soft_as_its_light_is_wide(stage: Usd.Stage, name: str, device: wp.Device) -> None:
    """Below the edge the light is a disk that a line cuts; far from it all or nothing arrives; paths see the same."""
    if name == "bulb":
        pytest.importorskip("mujoco")
    scene, half = LAMPS[name](stage, device)
    camera = looking_down(0.4, 0.4, (64, 8), shadows=True)
    seen = lit(scene, camera, look="pbr", soft_shadows=True)[0].mean(axis=0)
    traced = lit(scene, camera, look="path", path=wc.PathOptions(samples=512, bounces=1))[0].mean(axis=0)
    x = places(0.4, (64, 8))[0, :, 0]
    u = np.clip(-x / half, -1.0, 1.0)
    wanted = 0.5 + (u * np.sqrt(1.0 - u**2) + np.arcsin(u)) / np.pi
    alike(seen / seen[:4].mean(), wanted, 0.08, 0.025)
    alike(traced / traced[:4].mean(), wanted, 0.06, 0.02)
    sharp = lit(scene, camera, look="pbr")[0].mean(axis=0)
    np.testing.assert_allclose(sharp / sharp[:4].mean(), x < 0.0, atol=0.02)


@pytest.mark.parametrize("antialiasing", [1, 4, 8])
def test_a_light_without_size_has_its_sharp_shadow(device: wp.Device, antialiasing: int) -> None:
    """Lights without size, more than one, and lights that cast none: as the stage of sharp shadows has them."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><visual><headlight active="0"/></visual><worldbody>
      <light pos="1 0 3" dir="-.3 0 -1" cutoff="180" bulbradius="0" diffuse=".4 .4 .4"/>
      <light type="directional" pos="0 0 4" dir=".4 .3 -1" diffuse=".3 .5 .3"/>
      <light pos="-1 1 3" dir="0 0 -1" cutoff="180" castshadow="false" diffuse=".2 .2 .4"/>
      <geom type="plane" size="0 0 1" rgba="1 1 1 1"/><geom type="box" pos="0 0 .4" size=".3 .2 .2"/>
      <geom type="capsule" pos=".6 .2 .3" size=".1 .3"/></worldbody></mujoco>""")
    scene = wc.from_mujoco(model, [forwarded(model)], device=device)
    camera = wc.Camera("c", width=64, height=48, lens=wc.Pinhole(fovy=50.0), position=(0.0, 0.0, 4.0),
                       outputs=("hdr",), shadows=True, antialiasing=antialiasing)  # fmt: skip
    sharp, soft = lit(scene, camera, look="pbr")[0], lit(scene, camera, look="pbr", soft_shadows=True)[0]
    unlike = np.abs(sharp - soft) > 0.01 * sharp.max()
    assert unlike.mean() < 0.005  # where a ray touches an edge
    assert np.ptp(sharp) > 0.1


def worlds_of(device: wp.Device, heights: list[float]) -> wc.Scene:
    model = mujoco.MjModel.from_xml_string("""<mujoco><visual><headlight ambient=".5 .5 .5" diffuse="0 0 0"/></visual>
      <worldbody><light pos="0.5 0 2" dir="0 0 -1" cutoff="180" bulbradius=".2" diffuse=".5 .5 .5"/>
      <geom type="plane" size="0 0 1" rgba="1 1 1 1"/>
      <body name="b"><freejoint/><geom type="box" size=".3 .2 .1" rgba=".8 .3 .3 1"/></body></worldbody></mujoco>""")
    states = []
    for height in heights:
        states.append(forwarded(model, height))
    return wc.from_mujoco(model, states, device=device)


@pytest.mark.parametrize("antialiasing", [1, 4, 16])
def test_worlds_are_drawn_as_alone(device: wp.Device, antialiasing: int) -> None:
    camera = wc.Camera("c", width=40, height=30, lens=wc.Pinhole(fovy=50.0), position=(0.0, 0.0, 3.0),
                       outputs=("hdr", "depth"), shadows=True, antialiasing=antialiasing)  # fmt: skip
    options: dict[str, Any] = {"look": "pbr", "ambient_occlusion": 0.5, "soft_shadows": True}
    renderer = wc.Renderer(worlds_of(device, [0.3, 0.6]), [camera], **options)
    images = renderer.render()["c"]["hdr"]
    both = images.cpu().numpy().copy()
    for world, height in enumerate([0.3, 0.6]):
        alone = wc.Renderer(worlds_of(device, [height]), [camera], **options).render()["c"]["hdr"][0].cpu().numpy()
        np.testing.assert_array_equal(both[world], alone)
    images.zero_()
    renderer.render(worlds=[1])
    assert not images[0].any()
    np.testing.assert_array_equal(images[1].cpu().numpy(), both[1])


def test_nothing_runs_for_those_who_do_not_ask(device: wp.Device) -> None:
    camera = looking_down(3.0, 2.0, shadows=True)
    scene = worlds_of(device, [0.3])
    plain = wc.Renderer(scene, [camera], look="pbr")
    assert "occlu" not in str(plain.plan["c"])
    asked = wc.Renderer(scene, [camera], look="pbr", ambient_occlusion=1.0, soft_shadows=True)
    for name in ("occluders", "occlusion rays", "occlusion filter"):
        assert name in str(asked.plan["c"])
    told = wc.estimate_memory(scene, [camera], look="pbr", ambient_occlusion=1.0, soft_shadows=True)
    assert told.total == asked.memory.total > plain.memory.total
    depth = wc.Renderer(scene, [looking_down(3.0, 2.0, outputs=("depth",))], look="pbr", ambient_occlusion=1.0)
    assert "occlu" not in str(depth.plan["c"])


ERRORS = {
    "ambient_occlusion must be a radius above 0 in metres or None, got 0.0": {"ambient_occlusion": 0.0},
    "ambient_occlusion must be a radius above 0 in metres or None, got nan": {"ambient_occlusion": math.nan},
    "ambient_occlusion must be a radius above 0 in metres or None, got True": {"ambient_occlusion": True},
    "ambient_occlusion must be a radius above 0 in metres or None, got 1000": {"ambient_occlusion": 10**400},
    "soft_shadows must be True or False, got 4": {"soft_shadows": 4},
    "ambient_occlusion is of look='pbr', and the look is 'mujoco'": {"ambient_occlusion": 1.0, "look": "mujoco"},
    "soft_shadows is of look='pbr', and the look is 'path'": {"soft_shadows": True, "look": "path"},
    "soft_shadows are those of cameras with shadows=True, and none has it": {"soft_shadows": True},
}


@pytest.mark.parametrize("text", ERRORS)
def test_what_cannot_be(text: str, device: wp.Device) -> None:
    with pytest.raises(WarpcamError, match=f"Renderer: {text}".replace("(", r"\(")):
        wc.Renderer(worlds_of(device, [0.3]), [looking_down(3.0, 2.0)], **{"look": "pbr", **ERRORS[text]})
