"""Files of light in float: Radiance's and OpenEXR's."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.core.errors import RefusedError
from warpcam.textures.light_files import read_light

oiio: Any = pytest.importorskip("OpenImageIO")


def write(path: Path, pixels: np.ndarray, names: tuple[str, ...] = ("R", "G", "B")) -> Path:
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float")
    spec.channelnames = names
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(pixels)
    output.close()
    return path


@pytest.fixture
def light() -> np.ndarray:
    """Of many sizes, from a dark sky to a sun."""
    return (10.0 ** np.random.default_rng(1).uniform(-2.0, 4.0, (12, 20, 1)) * (1.0, 0.7, 0.4)).astype(np.float32)


def test_open_exr_is_exact(tmp_path: Path, light: np.ndarray) -> None:
    np.testing.assert_array_equal(read_light(write(tmp_path / "sky.exr", light), None, "images"), light)


def test_radiance(tmp_path: Path, light: np.ndarray) -> None:
    """Its colours share an exponent: 1/256 of the brightest."""
    read = read_light(write(tmp_path / "sky.hdr", light), None, "images")
    assert (np.abs(read - light) <= light.max(axis=2, keepdims=True) / 128.0).all()


def test_order_and_number_of_channels(tmp_path: Path, light: np.ndarray) -> None:
    four = np.concatenate((np.full((12, 20, 1), 0.5, np.float32), light[..., ::-1]), axis=2)
    np.testing.assert_array_equal(read_light(write(tmp_path / "a.exr", four, ("A", "B", "G", "R")), None, ""), light)
    grey = read_light(write(tmp_path / "grey.exr", light[..., :1], ("Y",)), None, "")
    np.testing.assert_array_equal(grey, light[..., :1].repeat(3, axis=2))
    with pytest.raises(wc.WarpcamError, match="has no red, green and blue, but Z"):
        read_light(write(tmp_path / "depth.exr", light[..., :1], ("Z",)), None, "images")


def test_what_no_light_is(tmp_path: Path, light: np.ndarray, caplog: pytest.LogCaptureFixture) -> None:
    light[0, 0], light[1, 1, 2] = -0.1, np.inf
    with caplog.at_level(logging.WARNING, "warpcam"):
        read = read_light(write(tmp_path / "sky.exr", light), None, "images")
    assert "3 are negative and become 0, and 1 are infinite and become 65504" in caplog.text
    assert (read[0, 0] == 0.0).all() and read[1, 1, 2] == 65504.0
    light[2, 2] = np.nan
    with pytest.raises(wc.WarpcamError, match="numbers that are none"):
        read_light(write(tmp_path / "sky.exr", light), None, "images")


def test_refusals(tmp_path: Path, light: np.ndarray) -> None:
    path = write(tmp_path / "sky.exr", light)
    with pytest.raises(RefusedError, match="image_pixels of limits is 239"):
        read_light(path, wc.Limits(image_pixels=239), "images")
    with pytest.raises(RefusedError, match="file_bytes of limits is 100"):
        read_light(path, wc.Limits(file_bytes=100), "images")
    with pytest.raises(wc.WarpcamError, match="there is no file"):
        read_light(tmp_path / "none.hdr", None, "images")
    with pytest.raises(wc.WarpcamError, match=r"allowed are files .hdr and .exr"):
        read_light(tmp_path / "sky.png", None, "images")
    for name in ("sky.hdr", "broken.exr"):
        (tmp_path / name).write_bytes(path.read_bytes()[:200] if name == "broken.exr" else path.read_bytes())
        with pytest.raises(wc.WarpcamError, match="cannot be read"):
            read_light(tmp_path / name, None, "images")


@pytest.mark.parametrize(
    ("origin", "size", "says"),
    [
        ((4, 2), (40, 30), "pixels of 20x12 at 4, 2, and its image is 40x30 at 0, 0"),
        ((-5, -1), (10, 10), "pixels of 20x12 at -5, -1, and its image is 10x10 at 0, 0"),
    ],
)
def test_a_part_of_an_image_is_refused(
    tmp_path: Path, light: np.ndarray, origin: tuple[int, int], size: tuple[int, int], says: str
) -> None:
    spec = oiio.ImageSpec(20, 12, 3, "float")
    (spec.x, spec.y), (spec.full_width, spec.full_height) = origin, size
    path = str(tmp_path / "part.exr")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec) and output.write_image(light)
    output.close()
    with pytest.raises(wc.WarpcamError, match=f"{says}; allowed are whole images"):
        read_light(path, None, "images")


@pytest.mark.parametrize("order", ["+Y 2 +X 2", "-Y 2 -X 2"])
def test_rows_in_another_order_are_refused(tmp_path: Path, order: str) -> None:
    path = tmp_path / "turned.hdr"
    path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{order}\n".encode() + bytes([128, 0, 0, 129]) * 4)
    with pytest.raises(wc.WarpcamError, match="its pixels in another order"):
        read_light(path, None, "images")


def test_a_scene_takes_them(tmp_path: Path, light: np.ndarray, device: wp.Device) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    scene = wc.from_mujoco(model, mujoco.MjData(model), device=device)
    path = write(tmp_path / "sky.exr", light)
    environments = wc.Environments(scene, [path, str(path)], index=1)
    struct = environments.tables(paths=True)[0]
    np.testing.assert_array_equal(struct.texels.numpy()[:240, :3], light.reshape(-1, 3))
    np.testing.assert_array_equal(struct.texels.numpy()[240:, :3], light.reshape(-1, 3))
