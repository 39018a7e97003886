"""Isaac Lab's simple shading, beside what its reference pictures of RTX show; the scene and the stage are stand-ins."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

HOW = "pip install isaaclab lazy_loader; without its other dependencies the interface for renderers can be imported"
pytest.importorskip("isaaclab.renderers", reason=HOW, exc_type=ImportError)
pytest.importorskip("pxr", reason="pip install 'warpcam[usd]'")
newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")

from pxr import Gf, Usd, UsdGeom, UsdLux  # noqa: E402

from warpcam.compat.isaaclab import WarpcamRenderer, WarpcamRendererCfg, simple_shading  # noqa: E402
from warpcam.compat.isaaclab import renderer as module  # noqa: E402
from warpcam.compat.isaaclab.tonemap import bind_tonemap  # noqa: E402
from warpcam.core.color import encoded_beyond  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Isaac Lab's and Newton's own

SIZE = 33
CONSTANT, DIFFUSE, FULL = simple_shading.LEVELS
# The light of Isaac Lab's cart and pole, from the left and above as its camera sees it: w, x, y, z.
LIGHT = (0.8535533906, -0.1464466094, -0.3535533906, -0.3535533906)
BEHIND = (0.3535533906, 0.3535533906, -0.1464466094, 0.8535533906)  # the same, half a turn about z
# Linear colours, in parts of 255, and what the pictures of the cart and pole show of them where they face the camera.
CARTS = (
    ((225, 144, 49), (231, 216, 153), (231, 216, 157)),
    ((15, 18, 38), (74, 83, 136), (86, 94, 141)),
    ((41, 59, 81), (140, 166, 187), (144, 169, 188)),
)


def stage_with(*lights: tuple[str, float], orient: tuple[float, ...] = LIGHT) -> Any:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    for index, (kind, intensity) in enumerate(lights):
        light = getattr(UsdLux, kind).Define(stage, f"/World/light{index}")
        light.CreateIntensityAttr(intensity)
        light.AddOrientOp().Set(Gf.Quatf(*orient))
    return stage


def wall(device: wp.Device, color: tuple[float, ...]) -> Any:
    """Two worlds with a wall before the camera, facing -x, of that linear colour."""
    builder = newton.ModelBuilder()
    shown = tuple(float(encoded_beyond(np.float64(part / 255.0))) for part in color)
    for _ in range(2):
        part = newton.ModelBuilder()
        body = part.add_body(xform=wp.transform(wp.vec3(1.0, 0.0, 0.0), wp.quat_identity()))
        part.add_shape_box(body, hx=0.1, hy=0.15, hz=0.2, color=shown)
        builder.add_world(part)
    return builder.finalize(device=device)


class Eye:
    """A renderer with one camera at the world's origin that looks along +x."""

    def __init__(
        self, model: Any, kinds: list[str], stage: Any, monkeypatch: Any, background: Any = None, **settings: Any
    ):
        self.backend = backend = SimpleNamespace(model=model, state_0=model.state(), geometry_offsets=None)
        provider = SimpleNamespace(create_mapping=lambda labels: labels, get_transforms=lambda *_, **__: False)
        sim = SimpleNamespace(get_or_create_backend=lambda cfg: backend, get_scene_data_provider=lambda: provider)
        monkeypatch.setattr(module, "simulation", lambda: sim)
        monkeypatch.setattr(module, "_backend_cfg", lambda sim: None)
        monkeypatch.setattr(module.WarpcamRenderer, "_follow", lambda self: None)
        cfg = WarpcamRendererCfg(**settings)
        self.renderer, self.model = WarpcamRenderer(cfg), model
        self.renderer.initialize()
        camera = SimpleNamespace(
            width=SIZE, height=SIZE, data_types=kinds, background_color=background, isp_cfg=None,
            spawn=SimpleNamespace(clipping_range=(0.05, 50.0), distortion=None),
        )  # fmt: skip
        spec = SimpleNamespace(cfg=camera, view_count=model.world_count, camera_prim_paths=())
        self.renderer.prepare_cameras(stage, spec)
        self.data = self.renderer.create_render_data(spec)
        layouts, worlds = {str(k): v for k, v in self.renderer.supported_output_types().items()}, model.world_count
        self.buffers = {
            kind: SimpleNamespace(
                warp=wp.zeros(
                    (worlds, SIZE, SIZE, layouts[kind].channels), dtype=layouts[kind].dtype, device=model.device
                )
            )
            for kind in kinds
        }
        self.renderer.set_outputs(self.data, self.buffers)
        self.look((0.0, 0.0, 0.0))

    def look(self, position: tuple[float, ...]) -> None:
        worlds, device = self.model.world_count, self.model.device
        pixels = [[[60.0, 0.0, SIZE / 2], [0.0, 60.0, SIZE / 2], [0.0, 0.0, 1.0]]] * worlds
        self.renderer.update_camera(
            self.data,
            wp.array([position] * worlds, dtype=wp.vec3, device=device),
            wp.array([(0.0, 0.0, 0.0, 1.0)] * worlds, dtype=wp.quat, device=device),
            wp.array(pixels, dtype=wp.mat33, device=device),
        )

    def frame(self, kind: str) -> np.ndarray:
        self.renderer.render(self.data)
        return self.buffers[kind].warp.numpy()

    def middle(self, kind: str) -> np.ndarray:
        image = self.frame(kind).astype(int)
        assert (image[0] == image[1]).all() and not image[:, 0, 0].any()
        return image[0, SIZE // 2, SIZE // 2]


def close(found: np.ndarray, expected: Any, most: int) -> None:
    assert np.abs(found - np.asarray(expected)).max() <= most, (found.tolist(), expected)


@pytest.mark.parametrize("number", range(len(CARTS)))
def test_it_is_lit_as_rtx_lights_a_cart_and_pole(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    color, diffuse, full = CARTS[number]
    model = wall(device, color)
    stage = stage_with(("DomeLight", 500.0), ("DistantLight", 2000.0), ("DistantLight", 9000.0))
    close(Eye(model, [CONSTANT], stage, monkeypatch).middle(CONSTANT), (156, 156, 156), 1)
    close(Eye(model, [DIFFUSE], stage, monkeypatch).middle(DIFFUSE), diffuse, 2)
    close(Eye(model, [FULL], stage, monkeypatch).middle(FULL), full, 4)


def test_where_no_light_falls_there_is_still_some(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model, behind = wall(device, CARTS[0][0]), stage_with(("DistantLight", 2000.0), orient=BEHIND)
    close(Eye(model, [CONSTANT], behind, monkeypatch).middle(CONSTANT), (55, 55, 55), 1)
    close(Eye(model, [DIFFUSE], behind, monkeypatch).middle(DIFFUSE), (149, 116, 53), 1)
    close(Eye(model, [FULL], behind, monkeypatch).middle(FULL), (149, 116, 53), 7)


def test_without_a_distant_light_it_is_lit_from_the_camera(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cube in a hand is a scene without a distant light."""
    model, stage = wall(device, (0, 245, 245)), stage_with(("DomeLight", 2000.0))
    close(Eye(model, [CONSTANT], stage, monkeypatch).middle(CONSTANT), (153, 153, 153), 1)
    for each in (stage, None):
        close(Eye(model, [DIFFUSE], each, monkeypatch).middle(DIFFUSE), (0, 232, 232), 1)
    close(Eye(model, [FULL], stage, monkeypatch).middle(FULL), (119, 235, 235), 5)
    eye = Eye(model, [CONSTANT], stage, monkeypatch)
    flat = eye.frame(CONSTANT)[0]
    assert len(np.unique(flat[flat > 0])) == 1  # it comes from as far as the sun


def test_lights_that_are_hidden_or_brighter_count_so(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model, stage = wall(device, (100, 100, 100)), stage_with(("DistantLight", 4000.0), ("DistantLight", 2000.0))
    bright = Eye(model, [DIFFUSE], stage, monkeypatch).middle(DIFFUSE)[0]
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/light0")).MakeInvisible()
    dim = Eye(model, [DIFFUSE], stage, monkeypatch).middle(DIFFUSE)[0]
    UsdLux.DistantLight(stage.GetPrimAtPath("/World/light1")).CreateExposureAttr(1.0)
    assert dim < bright == Eye(model, [DIFFUSE], stage, monkeypatch).middle(DIFFUSE)[0]
    UsdLux.DistantLight(stage.GetPrimAtPath("/World/light1")).CreateColorAttr((1.0, 0.5, 0.0))
    red, green, blue = Eye(model, [DIFFUSE], stage, monkeypatch).middle(DIFFUSE)
    assert red == bright and green == pytest.approx(dim, abs=1) and blue < green


def test_shadows_are_cast_where_they_are_asked_for(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=0.1, hy=2.0, hz=2.0, xform=wp.transform(wp.vec3(2.0, 0.0, 0.0), wp.quat_identity()))
    builder.add_shape_box(-1, hx=0.1, hy=0.1, hz=0.1, xform=wp.transform(wp.vec3(1.4, 0.4, 0.6), wp.quat_identity()))
    model, stage = builder.finalize(device=device), stage_with(("DistantLight", 2000.0))
    for kind in (CONSTANT, FULL):
        plain, shaded = (
            Eye(model, [kind], stage, monkeypatch, enable_shadows=on).frame(kind)[0].astype(int) for on in (False, True)
        )
        darker = plain.max(axis=-1) - shaded.max(axis=-1) > 30
        assert 4 < darker.sum() < 0.3 * darker.size
        assert (plain == shaded).all(axis=-1)[~darker].all()


def test_the_background_is_black_or_the_cameras_own(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    for color in ((0.0, 0.25, 1.0), (0.9, 0.5, 0.02)):
        image = Eye(wall(device, (9, 9, 9)), [DIFFUSE], None, monkeypatch, background=color).frame(DIFFUSE)
        close(image[:, 0, 0].astype(int), [np.rint(255.0 * np.array(color))] * 2, 1)


def test_colours_that_change_and_what_is_hidden_are_seen(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model = wall(device, (200, 20, 20))
    eyes = {kind: Eye(model, [kind, "depth"], None, monkeypatch) for kind in (CONSTANT, DIFFUSE)}
    before = {kind: eye.middle(kind) for kind, eye in eyes.items()}
    colors = model.shape_color.numpy()
    model.shape_color.assign(colors[:, ::-1])
    assert (eyes[CONSTANT].middle(CONSTANT) == before[CONSTANT]).all()
    assert (eyes[DIFFUSE].middle(DIFFUSE) == before[DIFFUSE][::-1]).all()
    eye, state = eyes[DIFFUSE], model.state()
    state.body_q.assign(state.body_q.numpy() + np.array((0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.float32))
    near, eye.backend.state_0 = eye.frame("depth").min(), state
    assert eye.frame("depth").min() == pytest.approx(near + 0.5, abs=1e-4)
    model.shape_flags.assign(model.shape_flags.numpy() & ~1)
    for kind, eye in eyes.items():
        assert not eye.frame(kind).any() and np.isinf(eye.frame("depth")).all()


def test_beside_it_there_is_what_has_no_colour(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model = wall(device, (200, 20, 20))
    kinds = [DIFFUSE, "depth", "distance_to_camera", "normals", "motion_vectors"]
    eye, plain = Eye(model, kinds, None, monkeypatch), Eye(model, kinds[1:], None, monkeypatch)
    for kind in kinds[1:]:
        np.testing.assert_array_equal(eye.frame(kind), plain.frame(kind))
    other = Eye(model, [DIFFUSE], None, monkeypatch)
    assert other.renderer._shaded.keys() == {DIFFUSE}
    for refused in (["rgb", DIFFUSE], [FULL, "albedo"], [FULL, CONSTANT], ["rgb_hdr", FULL]):
        with pytest.raises(wc.WarpcamError, match=r"for one camera; allowed is one data type of simple_shading_\*"):
            Eye(model, refused, None, monkeypatch)
    buffer = SimpleNamespace(warp=wp.zeros((2, SIZE, SIZE, 3), dtype=wp.uint8, device=device))
    for made in (plain, eye):
        with pytest.raises(wc.WarpcamError, match="full_mdl: the camera was made without it in CameraCfg"):
            made.renderer.set_outputs(made.data, {FULL: buffer})
    for kind in ("rgb", "rgba", "rgb_hdr", "albedo"):  # its scene is lit otherwise
        with pytest.raises(wc.WarpcamError, match=f"{DIFFUSE}, {kind} came for one camera"):
            eye.renderer.set_outputs(eye.data, {DIFFUSE: eye.buffers[DIFFUSE], kind: buffer})


def test_the_curve(device: wp.Device) -> None:
    light = np.concatenate([[0.0, -1.0, 1e9, np.nan], np.geomspace(1e-4, 20.0, 38)]).astype(np.float32)
    image = wp.array(light.reshape(1, 7, 2, 3), dtype=wp.float32, device=device)
    out = wp.zeros(image.shape, dtype=wp.uint8, device=device)
    bind_tonemap(image, out, wp.get_device(device)).launch()
    bright = np.nan_to_num(np.maximum(light, 0.0)).astype(np.float64)
    bent = np.minimum(bright * (2.51 * bright + 0.03) / (bright * (2.43 * bright + 0.59) + 0.14), 1.0)
    expected = 255.0 * np.where(bent <= 0.0031308, 12.92 * bent, 1.055 * bent ** (1 / 2.4) - 0.055)
    assert np.abs(out.numpy().reshape(-1) - expected).max() <= 0.51
