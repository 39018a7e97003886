"""Compilation for a GPU of all that a GPU would be given.

NVRTC comes with Warp and needs no GPU: a name that two headers have, and what is wrong in the parts of headers that are
for CUDA alone, is an error on a machine without one, too.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.compat.mujoco_warp.splats import ContextSplats
from warpcam.kernels.flags import SceneFlag, ShadingFlag
from warpcam.kernels.plan import edges
from warpcam.kernels.runtime import compile as compilation
from warpcam.kernels.runtime import launch
from warpcam.kernels.update import refit
from warpcam.kernels.update.refit_gaussians import GaussianArrays, bind_refit_gaussians
from warpcam.sources.mujoco import model as mujoco_model

ARCH = 90
# Bytes of a thread's stack. Called, not inlined, a function that gets the scene would copy 6,000 bytes of it there.
MOST_STACK = 1024
ASSETS = """
  <texture name="checks" type="2d" builtin="checker" width="64" height="64" rgb1=".1 .2 .3" rgb2=".9 .8 .3"/>
  <texture name="cube" type="cube" builtin="gradient" width="32" height="32" rgb1="1 0 0" rgb2="0 1 .5" mark="edge"/>
  <material name="floor" texture="checks" texrepeat="3 2"/>
  <material name="body" texture="cube" rgba="1 .7 1 1"/>
  <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>
"""
FEW = """
  <geom type="plane" size="0 0 1" material="floor"/>
  <geom type="sphere" size=".2" material="body"/>
  <geom type="capsule" size=".1 .3"/>
  <geom type="ellipsoid" size=".25 .1 .3"/>
  <geom type="cylinder" size=".15 .2"/>
  <geom type="box" size=".2 .1 .25" pos=".7 0 .1"/>
"""
LIGHTS = '<light pos="1 1 4" dir="-1 -1 -4"/><light directional="true" dir="0 1 -2"/>'
HILLS = '<hfield name="hills" nrow="5" ncol="5" size="2 2 .5 .1" elevation="{}"/>'.format(
    " ".join(str(i * 7 % 5) for i in range(25))
)


@pytest.fixture(autouse=True)
def card(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[launch.Stage]]:
    """Choose kernels as for a GPU, on the CPU; return the stages of renderers that are made meanwhile, not bound."""
    stages: list[launch.Stage] = []
    real = wp.Device.is_cuda.fget
    monkeypatch.setattr(wp.Device, "is_cuda", property(lambda self: _chooses(sys._getframe(1)) or real(self)))
    monkeypatch.setattr(wp.Device, "is_cpu", property(lambda self: not (_chooses(sys._getframe(1)) or real(self))))
    monkeypatch.setattr(wp.Device, "sm_count", property(lambda _: 1), raising=False)
    monkeypatch.setattr("warpcam.render.renderer.prepare", stages.extend)
    with wp.ScopedDevice("cpu"):
        yield stages


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which a module that several tests ask for is compiled once."""
    return tmp_path_factory.mktemp("compiled")


def _chooses(frame: Any) -> bool:
    name = frame.f_globals["__name__"]
    runs = name in (compilation.__name__, launch.__name__, refit.__name__)  # what is made there is launched at once
    return name.startswith("warpcam.kernels.") and not runs


def _render(
    mjm: Any,
    outputs: tuple[str, ...],
    size: tuple[int, int] = (64, 64),
    backs: bool = False,
    look: Any = None,
    sky: bool = False,
    occlusion: Any = None,
    **options: Any,
) -> None:
    position = (0.0, -2.0, 0.6)
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        outputs=outputs,
        position=position,
        rotation=scenes.looking(position, (0.0, 0.0, 0.0)),
        **{"lens": wc.Pinhole(fovy=60.0), "shadows": not {"rgb", "rgba"}.isdisjoint(outputs), **options},
    )
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 10), planes_from_behind=backs)
    light = np.ones((64, 128, 3), np.float32)
    light[20, 30] = 1.0e4  # a sun, which is a light
    environments = wc.Environments(scene, light) if sky else None
    wc.Renderer(scene, [camera], look=look, environments=environments, **(occlusion or {}))


def _compile(stages: list[launch.Stage], folder: Path) -> int:
    modules = {stage.module.name: stage.module for stage in stages}
    for name, module in modules.items():
        (path,) = wp.compile_aot_module(module, arch=ARCH, module_dir=folder / name, use_ptx=True)
        stacks = [int(size) for size in re.findall(r"__local_depot\d+\[(\d+)\]", path.read_text())]
        assert max(stacks, default=0) < MOST_STACK, f"{name}: {stacks}"
    return len(modules)


@pytest.mark.parametrize(
    "outputs",
    [
        ("depth", "segmentation"),
        ("depth", "segmentation", "albedo", "normals", "points"),
        ("depth", "segmentation", "flow", "flow_valid"),
        ("rgb", "depth", "flow_valid"),
    ],
)
def test_of_few_shapes(outputs: tuple[str, ...], card: list[launch.Stage], folder: Path) -> None:
    _render(scenes.compile_xml(FEW + LIGHTS, assets=ASSETS), outputs)
    assert _compile(card, folder) >= 2


def test_textures_that_lie_from_above(
    card: list[launch.Stage], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Albedo alone is written by the trace, which asks how textures lie."""
    monkeypatch.setattr(mujoco_model, "VERSION", (3, 11))
    _render(scenes.compile_xml(FEW, assets=ASSETS), ("depth", "albedo"))
    assert _compile(card, tmp_path) >= 2
    code = " ".join(path.read_text() for path in tmp_path.glob("*visibility*/*.cu"))
    types = re.findall(r"draw_with_albedo<warpcam::SceneTypes<\d+, (\d+)>", code)
    assert types and all(int(each) & SceneFlag.TEXTURE_FROM_ABOVE for each in types)


@pytest.mark.parametrize(
    ("outputs", "mesh"),
    [(("depth", "segmentation", "normals"), False), (("depth", "albedo"), False), (("rgb", "depth", "normals"), True)],
)
def test_of_planes_from_behind(outputs: tuple[str, ...], mesh: bool, card: list[launch.Stage], tmp_path: Path) -> None:
    """Kernels of what is not lit are told, those of colours are not."""
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/>' if mesh else ""
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS), outputs, backs=True)
    assert _compile(card, tmp_path) >= 2
    traces = [path.read_text() for path in tmp_path.glob("*visibility*/*.cu")]
    flags = [int(re.findall(r"draw\w*<warpcam::SceneTypes<\d+, (\d+)>", code)[0]) for code in traces]
    told = [each & SceneFlag.PLANES_FROM_BEHIND != 0 for each in flags]
    assert sorted(told) == ([False, True] if "rgb" in outputs else [True])


@pytest.mark.parametrize("output", ["normals", "points"])
def test_of_shapes_listed_ahead(output: str, card: list[launch.Stage], folder: Path) -> None:
    _render(scenes.compile_xml(FEW + LIGHTS, assets=ASSETS), ("depth", "segmentation", output))
    assert any("lists" in stage.module.name for stage in card)
    assert _compile(card, folder) >= 2


@pytest.mark.parametrize(
    ("outputs", "more"), [(("rgb", "rgba"), ""), (("hdr",), ""), (("rgb",), '<geom size=".2" rgba="1 1 1 .5"/>')]
)
def test_of_floors_in_parts_of_regions(
    outputs: tuple[str, ...], more: str, card: list[launch.Stage], tmp_path: Path
) -> None:
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS), outputs, (84, 84), shadows=True)
    shading = [stage for stage in card if stage.module.name.startswith("write_images")]
    assert shading[0].key.flags & (ShadingFlag.PLANE_STRIPS | ShadingFlag.WHOLE_REGIONS) == ShadingFlag.PLANE_STRIPS
    assert _compile(shading, tmp_path) == 1


@pytest.mark.parametrize("shapes", [1, 130])  # of many ids have more than a byte
@pytest.mark.parametrize("size", [(64, 64), (16, 8)])
def test_of_smooth_edges_without_meshes(
    shapes: int, size: tuple[int, int], card: list[launch.Stage], folder: Path
) -> None:
    more = shapes * '<geom size=".1"/>'
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS), ("rgb",), size, antialiasing=4)
    assert _compile(card, folder) >= 3


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_of_meshes_and_hills(antialiasing: int, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" material="body" pos="0 0 1"/><geom type="hfield" hfield="hills"/>'
    outputs = ("rgb", "depth", "normals", "albedo", "flow", "flow_valid")
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS + HILLS), outputs, antialiasing=antialiasing)
    assert _compile(card, folder) >= 3


def test_of_more_casters_with_meshes_than_a_list_holds(card: list[launch.Stage], folder: Path) -> None:
    _render(scenes.compile_xml(FEW + 200 * '<geom type="mesh" mesh="wedge"/>' + LIGHTS, assets=ASSETS), ("rgb",))
    assert _compile([stage for stage in card if stage.module.name.startswith("shadow")], folder) == 1


@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=60.0), wc.Orthographic(height=2.0)])
def test_of_traces_that_choose_from_shapes_in_view(lens: Any, card: list[launch.Stage], folder: Path) -> None:
    more = 200 * '<geom type="mesh" mesh="wedge"/>'
    outputs = ("depth", "segmentation", "points")
    _render(scenes.compile_xml(FEW + more, assets=ASSETS), outputs, lens=lens)
    assert any("shapes_in_view" in stage.module.name for stage in card)
    assert _compile(card, folder) >= 3


@pytest.mark.parametrize(("outputs", "shapes"), [(("rgb",), 1), (("rgb", "rgba"), 1), (("rgb",), 130)])
def test_of_meshes_smoothed_in_place(
    outputs: tuple[str, ...], shapes: int, card: list[launch.Stage], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(edges, "WORTH_PLACE", 1)
    more = shapes * '<geom type="mesh" mesh="wedge" material="body" pos="0 0 1"/>'  # of many ids have more than a byte
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS), outputs, antialiasing=4)
    assert edges.THREADS_IN_PLACE in {stage.block_dim for stage in card}
    assert _compile(card, folder) >= 3


@pytest.mark.parametrize("lens", [wc.Orthographic(height=2.0), wc.Fisheye(fovy=100.0)])
def test_of_what_is_seen_through(lens: Any, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="plane" size="2 2 1" material="mirror" pos="0 0 .1"/><geom size=".2" rgba="1 1 1 .5"/>'
    mirror = '<material name="mirror" reflectance=".5"/>'
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS + mirror), ("rgba", "depth"), lens=lens)
    assert _compile(card, folder) >= 3


@pytest.mark.parametrize(
    ("look", "curve"),
    [("pbr", "reinhard"), ("pbr", "aces"), ("pbr", "khronos_neutral"), ("pbr", "agx"), ("path", "agx")],
)
def test_of_tone_mapping(look: str, curve: str, card: list[launch.Stage], folder: Path) -> None:
    """The kernels that write colours, among them those that lay one surface over another."""
    mjm = scenes.compile_xml(FEW + '<geom size=".2" rgba="1 1 1 .5"/>' + LIGHTS, assets=ASSETS)
    _render(mjm, ("rgba", "depth"), look=look, tone_mapping=curve)
    name = "trace_paths" if look == "path" else "write_images"
    assert _compile([stage for stage in card if name in stage.module.name], folder) == 1


def test_of_film(card: list[launch.Stage], folder: Path) -> None:
    """Automatic exposure and bloom."""
    more = {"look": "pbr", "tone_mapping": "agx", "auto_exposure": wc.AutoExposure(), "bloom": wc.Bloom()}
    _render(scenes.compile_xml(FEW + LIGHTS, assets=ASSETS), ("rgba", "depth"), **more)
    names = ("meter_light", "film", "scatter_light", "develop_images")
    assert _compile([stage for stage in card if any(name in stage.module.name for name in names)], folder) == 4


@pytest.mark.parametrize("look", ["pbr", "path"])
def test_of_environments(look: str, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom size=".2" rgba="1 1 1 .5"/>' if look == "path" else ""
    _render(scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS), ("rgba", "depth"), look=look, sky=True)
    names = ("trace_paths", "environments") if look == "path" else ("write_images", "environments", "suns")
    found = _compile([stage for stage in card if any(name in stage.module.name for name in names)], folder)
    assert found == len(names)


@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=60.0), wc.Fisheye(fovy=100.0)])
def test_of_reflections(lens: Any, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom size=".2" rgba="1 1 1 .5"/>'
    mjm = scenes.compile_xml(FEW + more + LIGHTS, assets=ASSETS)
    _render(
        mjm, ("rgb", "hdr"), look="pbr", occlusion={"reflections": True}, lens=lens, sky=lens.projection == "pinhole"
    )
    names = ("trace_reflections", "filter_reflections", "list_path_shapes", "write_images")
    assert _compile([stage for stage in card if any(name in stage.module.name for name in names)], folder) == 4


@pytest.mark.parametrize("occlusion", [{"ambient_occlusion": 1.0}, {"ambient_occlusion": 1.0, "soft_shadows": True}])
def test_of_occlusion(occlusion: Any, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom type="hfield" hfield="hills"/>'
    mjm = scenes.compile_xml(FEW + more + '<geom size=".2" rgba="1 1 1 .5"/>' + LIGHTS, assets=ASSETS + HILLS)
    _render(mjm, ("rgba", "depth"), look="pbr", occlusion=occlusion, lens=wc.Fisheye(fovy=100.0))
    assert _compile([stage for stage in card if re.search("occlu|write_images", stage.module.name)], folder) == 4


def test_of_indirect_light(card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom type="hfield" hfield="hills"/>'
    mjm = scenes.compile_xml(FEW + more + '<geom size=".2" rgba="1 1 1 .5"/>' + LIGHTS, assets=ASSETS + HILLS)
    asked = {"indirect_light": True, "soft_shadows": True}
    _render(mjm, ("rgb", "depth"), look="pbr", occlusion=asked, lens=wc.Fisheye(fovy=100.0))
    names = ("trace_indirect", "filter_indirect", "write_images")
    assert _compile([stage for stage in card if any(name in stage.module.name for name in names)], folder) == 3


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_of_rays_that_begin_apart(antialiasing: int, card: list[launch.Stage], folder: Path) -> None:
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom type="hfield" hfield="hills"/>'
    mjm = scenes.compile_xml(FEW + more + '<geom size=".2" rgba="1 1 0 .5"/>' + LIGHTS, assets=ASSETS + HILLS)
    rays = np.ones((64, 64, 3))
    outputs = ("rgb", "depth", "distance", "normals", "points", "albedo")
    _render(mjm, outputs, lens=wc.Rays(rays, origins=rays), antialiasing=antialiasing)
    assert _compile(card, folder) >= 3


@pytest.mark.parametrize("theirs", [False, True])
def test_of_what_moves_and_splats(theirs: bool, card: list[launch.Stage], folder: Path) -> None:
    newton = pytest.importorskip("newton", reason="needs Newton: pip install warpcam[newton]")
    import newton_scenes
    import splat_scenes

    from warpcam.sources.newton.options import NewtonOptions
    from warpcam.sources.newton.source import load

    builder = newton_scenes.cloth()
    builder.add_shape_gaussian(body=-1, gaussian=splat_scenes.random_gaussians(20, 0))
    if theirs:
        ball = newton.Mesh.create_sphere(0.3, compute_inertia=False)
        builder.add_shape_mesh(body=-1, mesh=ball, scale=(1.0, 2.0, 1.0))
    choice = NewtonOptions(solid=theirs, lit_normals=theirs, backs=theirs or None)
    scene = load(*newton_scenes.finalize(builder, wp.get_device()), None, (0.2, 0.2, 0.2), None, None, choice=choice)
    wc.Renderer(scene, [splat_scenes.eye(shadows=True)])
    bounds = launch.bind_launch(refit.move_bounds, 0, [], scene.device)  # a stage on CUDA alone
    assert _compile([*card, bounds], folder) >= 3


def test_of_splats_by_world(card: list[launch.Stage], folder: Path) -> None:
    """Colours that depend on the ray, and what places the clouds."""
    mjm = scenes.compile_xml(FEW + LIGHTS, assets=ASSETS)
    cloud = {"positions": np.zeros((1, 3)), "scales": np.ones((1, 3)), "colors": np.ones((1, 3))}
    splats = ContextSplats([cloud, {**cloud, "harmonics": np.ones((1, 15, 3))}], choice=[0, 1])
    scene = wc.from_mujoco(mjm, [scenes.forward(mjm)] * 2, splats=splats)
    wc.Renderer(scene, [scenes.own_camera(width=64, height=64, outputs=("rgb", "depth"))])
    found = [stage for stage in card if "splats" in stage.module.name]
    trees = bind_refit_gaussians(GaussianArrays(), scene.tables().splats, scene.device)
    assert _compile([*found, *scene.stages(), *trees], folder) == 4


@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=60.0), wc.Fisheye(fovy=100.0)])
def test_of_labels(lens: Any, card: list[launch.Stage], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Amodal masks are traced, of each instance alone."""
    more = '<geom type="mesh" mesh="wedge" pos="0 0 1"/><geom type="hfield" hfield="hills"/>'
    mjm = scenes.compile_xml(FEW + more + '<body name="base"><geom size=".1"/></body>', assets=ASSETS + HILLS)
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 10))
    camera = scenes.own_camera(width=64, height=64, outputs=("depth", "segmentation", "bodies"), lens=lens)
    renderer = wc.Renderer(scene, [camera])
    card.clear()
    monkeypatch.setattr("warpcam.labeling.labels.prepare", card.extend)
    wc.labels(renderer, keypoints={"middle": (1, (0.0, 0.0, 0.0))})
    assert any("cover_instance" in stage.module.name for stage in card)
    assert _compile(card, folder) >= 4


@pytest.mark.parametrize("echoes", [1, 2])
def test_of_lidars(echoes: int, card: list[launch.Stage], folder: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("time,azimuth,zenith\n" + "".join(f"{k},{k},{k}\n" for k in range(64)))
    mjm = scenes.compile_xml(FEW + '<body name="base"><geom size=".1"/></body>', assets=ASSETS)
    widens = {"divergence": 0.1, "echo_gap": 0.5} if echoes > 1 else {}
    for pattern in (sensors.patterns.livox_csv(table, samples=32), sensors.patterns.spinning([0.0, 1.0], columns=16)):
        for sweep in ("instant", "moving"):
            scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 10))
            sensors.Lidar(scene, pattern, exclude_body="base", sweep=sweep, echoes=echoes, **widens)
    assert any("scan_rays" in stage.module.name for stage in card)
    assert _compile(card, folder) >= 4
