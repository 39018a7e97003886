"""The corners of a floor's cells, lit once for many pixels, against each pixel lit by itself."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import shading, shadow, trace

TEXTURE = '<texture name="checks" type="2d" builtin="checker" rgb1=".9 .8 .7" rgb2=".2 .3 .4" width="64" height="48"/>'
SPOTS = (
    '<light pos="0 -1 3" dir=".1 .3 -1" cutoff="60" exponent="3" diffuse=".8 .8 .8" specular=".3 .3 .3"/>'
    '<light pos="2 1 2" dir="-1 0 -1" cutoff="70" exponent="1" diffuse=".5 .5 .5" attenuation=".6 .1 .05"/>'
)
SUN = '<light type="directional" dir=".2 .4 -1" diffuse=".6 .6 .6" castshadow="false"/>'
RED = '<light pos="-1 0 3" dir="0 0 -1" cutoff="80" diffuse=".7 .2 .1" ambient=".1 0 0"/>'
MANY = (
    SPOTS
    + SUN
    + '<light pos="1 -2 3" dir="0 .3 -1" diffuse=".4 .4 .4"/><light pos="-2 1 4" dir="0 0 -1" diffuse=".3 .3 .3"/>'
)
THINGS = (
    '<geom type="sphere" pos="0 .4 .4" size=".4"/><geom type="box" pos=".9 1 .3" size=".3 .4 .3"/>'
    '<geom type="capsule" pos="-.9 1.2 .6" size=".15 .4" material="plain"/>'
)


def model(size: str, material: str, lights: str, camera: str, pose: str = "", visual: str = "") -> mujoco.MjModel:
    return scenes.compile_xml(
        lights + camera + f'<geom type="plane" size="{size}" material="{material}" {pose}/>' + THINGS,
        assets=TEXTURE
        + '<material name="grey" texture="checks" texrepeat="3 2"/><material name="plain" rgba=".6 .6 .6 1"/>'
        + '<material name="blue" rgba=".3 .4 .8 1" emission=".1" texuniform="true" texture="checks"/>',
        more='<statistic extent="2" center="0 0 0"/><visual><map zfar="30"/>' + visual + "</visual>",
    )


NEAR = '<camera pos="0 -1.6 1.5" xyaxes="1 .1 0 0 .6 .8"/>'
HORIZON = '<camera pos="0 -2 .8" xyaxes="1 0 0 0 .05 1"/>'
TILTED = '<camera pos=".5 -2 1.6" xyaxes="1 .3 .2 -.2 .5 .9"/>'


def pictures(
    mjm: mujoco.MjModel, device: wp.Device, shadows: bool, width: int = 96, height: int = 64
) -> list[np.ndarray]:
    """With corners that are kept, and without: `hdr` has no use for them."""
    data = scenes.forward(mjm)
    scene = wc.from_mujoco(mjm, [data], device=device)
    found = []
    for outputs in (("rgb",), ("rgb", "hdr")):
        camera = wc.Camera(0, width=width, height=height, outputs=outputs, shadows=shadows)
        renderer = wc.Renderer(scene, [camera])
        renderer.render()
        found.append(renderer.array(0, "rgb").numpy().astype(int))
    return found


@pytest.mark.parametrize("shadows", [True, False])
@pytest.mark.parametrize("lights", [SPOTS, SUN, RED + SPOTS, MANY], ids=["spots", "sun", "red", "many"])
def test_lights(device: wp.Device, lights: str, shadows: bool) -> None:
    kept, plain = pictures(model("0 0 .1", "grey", lights, NEAR), device, shadows)
    assert np.abs(kept - plain).max() <= 1
    assert plain.std() > 10


@pytest.mark.parametrize("camera", [NEAR, HORIZON, TILTED], ids=["near", "horizon", "tilted"])
@pytest.mark.parametrize("material", ["grey", "plain", "blue"])
@pytest.mark.parametrize("size", ["0 0 .1", "3 0 .2", "2.3 1.9 .35", "20 20 .05"])
def test_planes(device: wp.Device, size: str, material: str, camera: str) -> None:
    kept, plain = pictures(model(size, material, SPOTS + SUN, camera, 'euler="2 -3 10"'), device, True)
    assert np.abs(kept - plain).max() <= 1
    assert plain.std() > 10


@pytest.mark.parametrize("shadows", [True, False])
@pytest.mark.parametrize("material", ["grey", "plain", "blue"])
@pytest.mark.parametrize("camera", [NEAR, HORIZON], ids=["near", "horizon"])
@pytest.mark.parametrize("size", [(128, 64), (100, 52)], ids=["whole", "parts"])
def test_images_alone_and_together(
    device: wp.Device,
    monkeypatch: pytest.MonkeyPatch,
    size: tuple[int, int],
    camera: str,
    material: str,
    shadows: bool,
) -> None:
    """On a GPU those that are asked for alone are drawn by strips in whole regions, all together pixel by pixel."""
    for module in (shading, shadow, trace):
        monkeypatch.setattr(module, "region_size", lambda *_, **__: (64, 64))
    mjm = model("0 0 .1", material, SPOTS + SUN, camera, 'euler="2 -3 10"')
    scene = wc.from_mujoco(mjm, [scenes.forward(mjm)], device=device)

    def look(*outputs: str) -> dict[str, np.ndarray]:
        return scenes.look(scene, wc.Camera(0, width=size[0], height=size[1], outputs=outputs, shadows=shadows))

    together = look("rgb", "rgba", "hdr", "albedo", "segmentation")
    rgb, rgba, both = look("rgb"), look("rgba"), look("rgb", "rgba")
    found = {**rgb, **rgba, **look("hdr"), **look("albedo")}
    for name in ("rgb", "rgba"):
        assert np.abs(both[name].astype(int) - found[name]).max() <= 1
        assert np.abs(found[name].astype(int) - together[name]).max() <= 1
    assert np.abs(rgba["rgba"][..., :3].astype(int) - rgb["rgb"]).max() <= 1
    np.testing.assert_array_equal(rgba["rgba"][..., 3], 255 * (together["segmentation"] >= 0))
    assert np.abs(found["albedo"].astype(int) - together["albedo"]).max() <= 1
    np.testing.assert_allclose(found["hdr"], together["hdr"], atol=0.01)
    assert found["hdr"].max() > found["rgb"].max() / 255


@pytest.mark.parametrize("width", [128, 100])
def test_where_no_light_reaches_there_is_none(device: wp.Device, monkeypatch: pytest.MonkeyPatch, width: int) -> None:
    """Corners keep the sum of all lights, of which those in shadow are taken away."""
    for module in (shading, shadow, trace):
        monkeypatch.setattr(module, "region_size", lambda *_, **__: (64, 64))
    lights = "".join(
        f'<light type="directional" pos="-1.8 2.1 3" dir=".6 -.7 -1" diffuse="{grey} {grey} {grey}" ambient="0 0 0"/>'
        for grey in (0.9, 0.05, 0.3)
    )
    mjm = model("0 0 .1", "grey", lights, NEAR, visual='<headlight active="0"/>')
    scene = wc.from_mujoco(mjm, [scenes.forward(mjm)], device=device)
    options = {"width": width, "height": 64, "shadows": True}
    hdr = scenes.look(scene, wc.Camera(0, outputs=("hdr",), **options))["hdr"]
    plain = scenes.look(scene, wc.Camera(0, outputs=("hdr", "rgb", "segmentation"), **options))
    floor = plain["segmentation"] == 0
    dark = floor & (plain["hdr"] == 0.0).all(axis=-1)
    assert 0.01 < dark.mean() < 0.5 * floor.mean()
    assert hdr.min() >= 0.0
    np.testing.assert_allclose(hdr[dark], 0.0, atol=1e-6)
    np.testing.assert_allclose(hdr, plain["hdr"], atol=0.01)


@pytest.mark.parametrize(("width", "height"), [(64, 64), (37, 51), (130, 70)])
def test_sizes(device: wp.Device, width: int, height: int) -> None:
    kept, plain = pictures(model("2.3 1.9 .35", "grey", SPOTS, TILTED), device, True, width, height)
    assert np.abs(kept - plain).max() <= 1


@pytest.mark.parametrize("behind", [100, 900])
def test_looks_of_what_is_seen(device: wp.Device, behind: int) -> None:
    """Shapes that are not seen change nothing, even where they are too many for all looks to be kept."""
    random = np.random.default_rng(5)
    seen = "".join(
        f'<geom type="{kind}" pos="{x:.3f} {y:.3f} {z:.3f}" size=".09 .08 .07" {more} '
        f'rgba="{r:.2f} {g:.2f} {b:.2f} 1"/>'
        for kind, more in (("sphere", ""), ("box", 'material="grey"'), ("ellipsoid", ""))
        for x, y, z, r, g, b in random.uniform((-1, -1, 0.1, 0, 0, 0), (1, 2, 1, 1, 1, 1), (60, 6))
    )
    unseen = '<geom type="sphere" pos="0 -9 1" size=".1"/>' * behind
    images = []
    for more in ("", unseen):
        mjm = model("0 0 .1", "grey", SPOTS + seen + more, NEAR)
        images.append(pictures(mjm, device, False)[0])
    assert np.abs(images[0] - images[1]).max() <= 1


@pytest.mark.parametrize("camera", [NEAR, HORIZON, TILTED], ids=["near", "horizon", "tilted"])
@pytest.mark.parametrize("material", ["grey", "plain"])
@pytest.mark.parametrize("lights", [SPOTS, SUN.replace("false", "true")], ids=["spots", "sun"])
@pytest.mark.parametrize("shadows", [True, False])
def test_regions(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch, shadows: bool, lights: str, material: str, camera: str
) -> None:
    """Strips of a region show what tiles do: those of four tiles are drawn, and looked through for shadows, at once."""
    mjm = model("0 0 .1", material, lights, camera, 'euler="2 -3 10"')
    images = []
    for region in ((16, 8), (32, 16), (64, 32), (64, 64)):  # in the first there are none
        for module in (shading, shadow, trace):
            monkeypatch.setattr(module, "region_size", lambda *_, region=region, **__: region)
        images += pictures(mjm, device, shadows, 128, 64)
    assert images[0].std() > 10
    for image in images[1:]:
        assert np.abs(image - images[0]).max() <= 1


def test_the_sky_is_no_floor(device: wp.Device) -> None:
    """A wide view has pixels of the sky and of the floor in one strip, and shapes that hide both."""
    sky = '<texture type="skybox" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="16" height="16"/>'
    seen = []
    for assets in ("", sky):
        mjm = scenes.compile_xml(
            SPOTS + HORIZON + '<geom type="plane" size="0 0 .1" material="grey"/>' + THINGS,
            assets=TEXTURE + '<material name="grey" texture="checks"/><material name="plain"/>' + assets,
        )
        kept, plain = pictures(mjm, device, True, 256, 256)
        assert np.abs(kept - plain).max() <= 1
        seen.append(kept)
    differ = (seen[0] != seen[1]).any(axis=-1)
    assert 0.1 < differ.mean() < 0.9


@pytest.mark.parametrize("hung", ["-1.5 3 4.5", "-1.5 3.6 3.5"], ids=["above", "beside"])
def test_what_hangs_behind_a_lamp_takes_no_shadow_away(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch, hung: str
) -> None:
    """The light's view of such a shape has no end; the image's first rows look above the horizon."""
    lamp = '<light pos="-1.5 3 3.5" dir="0 0 -1" cutoff="80" diffuse=".9 .9 .9"/>'
    ball = f'<geom type="sphere" pos="{hung}" size=".2"/><geom type="box" pos="0 3 .8" size=".5 .5 .8"/>'
    mjm = model("0 0 .1", "grey", lamp + ball, '<camera pos="0 -1 1.5" xyaxes="1 0 0 0 0 1"/>')
    images = []
    for region in ((16, 8), (64, 64)):
        for module in (shading, shadow, trace):
            monkeypatch.setattr(module, "region_size", lambda *_, region=region, **__: region)
        images += [pictures(mjm, device, shadows, 128, 64)[0] for shadows in (True, False)]
    assert (np.abs(images[0] - images[1]).max(axis=-1) > 5).sum() > 50  # of the box on the floor
    assert np.abs(images[2] - images[0]).max() <= 1
    assert np.abs(images[3] - images[1]).max() <= 1
