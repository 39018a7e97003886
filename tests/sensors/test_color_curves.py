"""Tables between bytes and linear light, and effects that encode light themselves."""

import numpy as np
import pytest
import warp as wp
from measured_colors import measured, picture

from warpcam import sensors
from warpcam.core.color import linear_to_srgb, srgb_to_linear
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import bind_launch, run
from warpcam.sensors.kernels.curves import byte_table, encode_byte, light_table

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def encode_all(
    table: wp.array(dtype=wp.int32),
    light: wp.array(dtype=wp.float32),
    found: wp.array(dtype=wp.int32),
    first: wp.int32,
):
    index = first + wp.tid()
    found[index] = encode_byte(table, light[index])


def encoded(light: np.ndarray, device: wp.Device) -> np.ndarray:
    found = wp.zeros(light.size, dtype=wp.int32, device=device)
    given = wp.array(light, dtype=wp.float32, device=device)
    run([bind_launch(encode_all, light.size, [byte_table(device), given, found], device)])
    return found.numpy()


def test_light_becomes_the_byte_next_to_its_display_value(device: wp.Device) -> None:
    """Floats from 2^-14 to beyond white, evenly spread over their bits."""
    light = np.arange(0x38800000, 0x3F810000, 97, dtype=np.int32).view(np.float32)
    found, exact = encoded(light, device), 255.0 * linear_to_srgb(light)
    assert np.abs(found - exact).max() <= 0.5 + 1e-4
    assert (np.unique(found) == np.arange(256)).all()


def test_light_out_of_range_is_black_or_white(device: wp.Device) -> None:
    light = np.array([-np.inf, -1.0, -0.0, 0.0, 1e-40, 1e-4, np.nan, 1.0, 1.0001, 7.0, 1e30, np.inf], np.float32)
    assert encoded(light, device).tolist() == [0] * 7 + [255] * 5


def test_bytes_become_linear_light_and_bytes_again(device: wp.Device) -> None:
    light = light_table(device).numpy()
    assert np.allclose(light, srgb_to_linear(np.arange(256) / 255.0), rtol=1e-5, atol=0.0)
    assert (encoded(light, device) == np.arange(256)).all()


@pytest.mark.parametrize(
    "effect", [sensors.JpegArtifacts([40.0, 90.0]), sensors.Quantization(4.0)], ids=["jpeg", "quantization"]
)
def test_effects_that_take_light_encode_it(effect: sensors.Effect, device: wp.Device) -> None:
    light = 1.2 * picture(21, 37) - 0.1
    assert effect.takes_light
    found = measured(effect, light, device, is_linear=True)
    expected = measured(effect, measured(sensors.ToneCurve(), light, device), device)
    assert (found != expected).mean() < 0.01 and np.abs(found - measured(effect, light, device)).max() > 0.1
