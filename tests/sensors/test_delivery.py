"""Delivery of frames: which frame a camera shows when, of all its outputs, and how old it is told to be."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.sensors.effect import parameter_array, parameters_of
from warpcam.sensors.kernels.random import Randomness
from warpcam.sensors.timing.delivery import DeliveredImages

OUTPUTS = ("depth", "rgb", "segmentation", "normals")
OPTIONS: tuple[dict[str, Any], ...] = ({}, {"hold": 0.75}, {"redraw": 0.5})


class Rising:
    """A rig whose camera is higher at every read, so that each frame can be told from the others."""

    def __init__(self, device: Any, *effects: sensors.Effect, num_worlds: int = 3, **options: Any):
        options = {"position": (0.0, 0.0, 5.0), "lens": wc.Pinhole(fovy=60.0), "outputs": OUTPUTS, **options}
        self.renderer = wc.Renderer(scene_of(device, num_worlds), [camera("eye", **options)])
        self.rig = sensors.Rig(self.renderer, {"eye": effects})
        self.images = self.rig.images["eye"]
        self.truths: list[dict[str, np.ndarray]] = []
        self.times: list[np.ndarray] = []

    def read(self, time: Any, **options: Any) -> dict[str, np.ndarray]:
        self.renderer.camera("eye").position[:, 2] += 0.1
        self.rig.read(time=time, **options)
        self.times.append(np.broadcast_to(np.asarray(time, np.float32), self.renderer.scene.num_worlds))
        self.truths.append(on_host(self.renderer.images["eye"]))
        return on_host(self.images)

    def shown(self, world: int) -> int:
        """Number of the frame that a world shows; all outputs must be of that frame."""
        seen = on_host(self.images)
        frames = [k for k, truth in enumerate(self.truths) if (truth["depth"][world] == seen["depth"][world]).all()]
        (frame,) = frames
        for name, truth in self.truths[frame].items():
            assert (seen[name][world] == truth[world]).all(), name
        return frame


def on_host(images: Any) -> dict[str, np.ndarray]:
    return {name: image.cpu().numpy().copy() for name, image in images.items()}


def expected_frames(times: np.ndarray, rate: float, phase: float, latency: float) -> list[int]:
    """Frame that is shown at each read, by definition, in float64."""
    shown, last, under_way, result = -1, None, [], []
    for k, time in enumerate(times):
        period = np.floor(time * rate - phase + 0.01)
        if rate == 0.0 or period != last:
            under_way.append((k, time + (latency if last is not None else 0.0)))
            last = period
        shown = max([shown, *(frame for frame, arrival in under_way if time >= arrival - 1e-4)])
        result.append(shown)
    return result


@pytest.mark.parametrize("step", [0.01, 0.004, 0.1])
@pytest.mark.parametrize("size", [(8, 6), (5, 3)])
def test_the_newest_frame_that_has_arrived_is_shown(step: float, size: tuple[int, int], device: wp.Device) -> None:
    rates, phases, latencies = [0.0, 30.0, 50.0, 30.0, 30.0], [0.0, 0.0, 0.0, 0.5, 0.0], [0.02, 0.05, 0.0, 0.04, 0.0]
    delivery = sensors.Delivery(rate=rates, phase=phases, latency=latencies, capacity=6)
    rising = Rising(device, delivery, num_worlds=5, width=size[0], height=size[1])
    times = 3.0 + step * np.arange(24)
    expected = np.array([expected_frames(times, *row) for row in zip(rates, phases, latencies, strict=True)])
    for k, time in enumerate(times):
        seen = rising.read(time)
        assert [rising.shown(world) for world in range(5)] == expected[:, k].tolist()
        np.testing.assert_allclose(seen["frame_age"], time - times[expected[:, k]], atol=1e-5)
    assert seen["frame_age"].dtype == np.float32 and (rising.rig.deliveries("eye").overrun == 0).all()


def test_all_outputs_are_of_one_frame_and_in_memory_of_the_rig(device: wp.Device) -> None:
    effects = (sensors.DepthRange(min=0.0, max=5.5), sensors.Delivery(latency=0.02))
    rising = Rising(device, *effects)
    pointers = {name: image.data_ptr() for name, image in rising.images.items()}
    own = {image.data_ptr() for image in rising.renderer.images["eye"].values()}
    assert not own & set(pointers.values()) and set(pointers) == {*OUTPUTS, "frame_age"}
    frames = [rising.read(0.01 * k) for k in range(5)]
    for name in ("rgb", "segmentation", "normals"):
        assert (frames[4][name] == rising.truths[2][name]).all()
    truth = rising.truths[2]["depth"]
    assert (frames[4]["depth"] == np.where(truth > 5.5, 0.0, truth)).all()
    assert {name: image.data_ptr() for name, image in rising.images.items()} == pointers
    assert rising.rig.deliveries("eye").age.data_ptr() == pointers["frame_age"]


def test_point_clouds_are_of_the_frame_that_has_arrived(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.02), outputs=("depth", "points"))
    with pytest.raises(wc.WarpcamError, match="its images arrive late: positions must be"):
        sensors.PointClouds(rising.rig)
    clouds = {
        name: sensors.PointClouds(rising.rig, positions=name, num_points=480, method="first", padding="zeros")
        for name in ("points", "depth")
    }
    for k in range(5):
        rising.read(0.01 * k)
    heights = {name: each.read()["points"][..., 2].cpu().numpy() for name, each in clouds.items()}
    np.testing.assert_allclose(heights["depth"] - heights["points"], 0.2 * (heights["points"] != 0.0), atol=1e-4)
    truth = rising.truths[2]["points"].reshape(3, -1, 3)
    assert (
        np.abs(heights["points"].max(axis=1) - np.where(np.isfinite(truth), truth, -9)[..., 2].max(axis=1)).max() < 1e-5
    )


def test_times_are_those_of_the_simulation_where_it_keeps_them(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.05), num_worlds=2)
    clock = wp.to_torch(rising.renderer.scene.clock())
    for times in ((0.0, 1.0), (0.03, 1.1), (0.06, 1.2)):
        clock[:] = torch.tensor(times)
        rising.read(None)
    np.testing.assert_allclose(rising.images["frame_age"].cpu(), (0.06, 0.1), atol=1e-6)


def test_an_older_frame_never_follows_a_newer_one(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.03, jitter=0.05, distribution="uniform", capacity=9))
    captured = []
    for k in range(40):
        seen = rising.read(0.01 * k)
        captured.append(0.01 * k - seen["frame_age"])
        assert np.allclose(captured[-1], [0.01 * rising.shown(world) for world in range(3)], atol=1e-5)
    steps = np.diff(captured, axis=0)
    assert steps.min() > -1e-5 and steps.max() > 0.015 and (steps < 1e-5).any()
    assert (rising.rig.deliveries("eye").captured == 40).all()


def test_frames_that_find_no_room_are_lost_and_counted(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.04, capacity=2))
    shown = []
    for k in range(12):
        rising.read(0.01 * k)
        shown.append(rising.shown(0))
    assert shown == [0, 0, 0, 0, 0, 1, 2, 2, 2, 5, 6, 6]
    status = rising.rig.deliveries("eye")
    assert status.captured.tolist() == [12] * 3 and status.overrun.tolist() == [5] * 3


def test_dropped_frames_never_come(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(drop=[0.0, 1.0, 0.5], latency=[0.0, 0.0, 0.01]))
    shown = []
    for k in range(30):
        rising.read(0.01 * k)
        shown.append([rising.shown(world) for world in range(3)])
    assert [row[0] for row in shown] == list(range(30)) and [row[1] for row in shown] == [0] * 30
    dropped = rising.rig.deliveries("eye").dropped.tolist()
    assert dropped[0] == 0 and dropped[1] == 29 and 5 < dropped[2] < 25
    assert 28 - dropped[2] <= len({row[2] for row in shown}) - 1 <= 29 - dropped[2]


def test_a_reset_shows_the_next_frame_at_once(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(rate=10.0, latency=0.25))
    for k in range(8):
        rising.read(0.05 * k)
    before = [rising.shown(world) for world in range(3)]
    rising.rig.reset([1])
    assert [rising.shown(world) for world in range(3)] == before
    rising.read(0.41)
    assert [rising.shown(world) for world in range(3)] == [2, 8, 2]
    rising.read(0.46)
    rising.read(np.array([0.51, 0.51, 0.0]))  # the simulator has put its clock back
    assert [rising.shown(world) for world in range(3)] == [4, 8, 10]
    np.testing.assert_allclose(rising.images["frame_age"].cpu(), (0.31, 0.1, 0.0), atol=1e-5)
    rising.read(np.array([0.56, 0.56, 0.56]))  # frames that were under way before are lost
    assert rising.shown(2) == 10


def test_worlds_that_are_not_read_stay_as_they_are(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.02))
    for k in range(4):
        before = rising.read(0.01 * k)
    after = rising.read(0.9, worlds=[1])
    for name, image in after.items():
        assert (image[[0, 2]] == before[name][[0, 2]]).all()
    assert rising.shown(1) == 3


def test_parameters_are_written_in_place_and_drawn(device: wp.Device) -> None:
    latency = torch.zeros(3, device=wp.device_to_torch(device))
    rising = Rising(device, sensors.Delivery(latency=latency, rate=10.0))
    wc.randomize(rising.rig.parameters("eye"), delivery_phase=(0.0, 1.0), delivery_latency=(0.0, 0.0), seed=2)
    assert len(set(rising.rig.parameters("eye").delivery_phase.tolist())) == 3
    rising.read(0.0)
    rising.rig.parameters("eye").delivery_phase.zero_()
    rising.read(0.1)
    assert [rising.shown(world) for world in range(3)] == [1, 1, 1]
    latency[2] = 0.05
    rising.read(0.2)
    assert [rising.shown(world) for world in range(3)] == [2, 2, 1]


def test_a_world_is_delivered_alike_whatever_the_number_of_worlds(device: wp.Device) -> None:
    delivery: dict[str, Any] = {"latency": 0.02, "jitter": 0.02, "drop": 0.3, "capacity": 16}
    few = Rising(device, sensors.Delivery(**delivery), num_worlds=2)
    many = Rising(device, sensors.Delivery(**delivery), num_worlds=4)
    for k in range(20):
        ages = few.read(0.01 * k)["frame_age"], many.read(0.01 * k)["frame_age"]
        assert (ages[0] == ages[1][:2]).all()
    assert ages[1].std() > 0.0


def test_a_delivery_may_be_captured(device: wp.Device) -> None:
    rising = Rising(device, sensors.Delivery(latency=0.02))
    time = torch.zeros(3, device=wp.device_to_torch(device))
    rising.rig.read(time=time)
    with wp.ScopedCapture(device) as capture:
        rising.rig.read(time=time)
    height = rising.renderer.camera("eye").position
    for k in range(1, 4):
        time[:] = 0.01 * k
        height[:, 2] = 5.0 + k
        wp.capture_launch(capture.graph)
    np.testing.assert_allclose(rising.images["frame_age"].cpu(), 0.02, atol=1e-6)
    seen = rising.images["depth"].clone()
    height[:, 2] = 6.0
    truth = rising.renderer.render()["eye"]["depth"]
    assert (seen == truth).all()


def test_a_scene_that_keeps_no_time_is_given_it(tmp_path: Path, device: wp.Device) -> None:
    (tmp_path / "triangle.obj").write_text("v -1 -1 -2\nv 1 -1 -2\nv 0 1 -2\nf 1 2 3\n")
    scene = wc.load(tmp_path / "triangle.obj", num_worlds=2)
    eye = camera("eye", position=(0.0, 0.0, 2.0), lens=wc.Pinhole(fovy=60.0), outputs=("depth", "rgb"))
    rig = sensors.Rig(wc.Renderer(scene, [eye]), {"eye": [sensors.Delivery(rate=10.0, latency=0.05)]})
    with pytest.raises(wc.WarpcamError, match=r"Delivery of 'eye' needs the simulation's time, and this scene keeps"):
        rig.read()
    for time in (0, 0.1, np.array([0.14, 0.16])):
        rig.read(time=time)
    np.testing.assert_allclose(rig.images["eye"]["frame_age"].cpu(), (0.14, 0.06), atol=1e-6)
    assert np.isfinite(rig.images["eye"]["depth"].cpu().numpy()).any()
    free = sensors.Rig(rig.renderer, {"eye": [sensors.DepthRange(min=0.0, max=3.0)]})
    assert free.read()["eye"].keys() == {"depth", "rgb"}


def frame_of(effect: sensors.Delivery, num_worlds: int, device: wp.Device) -> tuple[Any, DeliveredImages]:
    """Frame of many worlds of one pixel."""
    arrays = {entry.name: parameter_array(effect, entry, "test", num_worlds, device) for entry in parameters_of(effect)}
    pixel = wp.zeros((num_worlds, 1, 1, 1), dtype=wp.float32, device=device)
    randomness = Randomness()
    randomness.seeds = wp.zeros(num_worlds, dtype=wp.int32, device=device)
    randomness.frames = wp.zeros(num_worlds, dtype=wp.int32, device=device)
    none = wp.empty(0, dtype=wp.float32, device=device)
    frame = sensors.EffectFrame(
        source=none,
        target=none,
        truth={},
        views=none,
        times=wp.zeros(num_worlds, dtype=wp.float32, device=device),
        elapsed=none,
        renders=randomness.frames,
        mask=wp.full(num_worlds, 1, dtype=wp.uint8, device=device),
        params=SimpleNamespace(**arrays),
        randomness=randomness,
        width=1,
        height=1,
        device=device,
        memory={},
        worlds=range(num_worlds),
    )
    return frame, DeliveredImages(effect, arrays, {"depth": pixel}, "test")


def delays_of(effect: sensors.Delivery, num_worlds: int, times: tuple[float, ...], device: wp.Device) -> np.ndarray:
    """Delays of each world's frames after the first, (frame, world); NaN of those that were dropped."""
    frame, delivered = frame_of(effect, num_worlds, device)
    stages, delays = delivered.bind(frame), []
    for k, time in enumerate(times):
        frame.times.fill_(time)
        frame.randomness.frames.fill_(k)
        for stage in stages:
            stage.launch()
        pending = frame.memory["pending"].numpy() > 0
        new = pending & (frame.memory["captured"].numpy() == np.float32(time))
        arrival = np.where(new, frame.memory["arrival"].numpy(), np.nan)
        if k:
            delays.append(np.fmax.reduce(arrival, axis=1) - np.float32(time))
    return np.array(delays)


@pytest.mark.parametrize(
    ("distribution", "mean", "deviation"),
    [("normal", 1.0, 0.1), ("uniform", 1.05, 0.1 / 12**0.5), ("exponential", 1.1, 0.1)],
)
def test_delays_have_the_distribution_that_was_asked_for(
    distribution: Any, mean: float, deviation: float, device: wp.Device
) -> None:
    effect = sensors.Delivery(latency=1.0, jitter=0.1, drop=0.02, distribution=distribution)
    delays = delays_of(effect, 10**6, (0.0, 0.25), device)[0]
    assert abs(np.nanmean(delays) - mean) < 5e-4 and abs(np.nanstd(delays) - deviation) < 5e-4
    assert abs(np.isnan(delays).mean() - 0.02) < 7e-4


def test_a_jitter_is_held_and_redrawn(device: wp.Device) -> None:
    times = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25)
    free, held, slow = (
        delays_of(sensors.Delivery(latency=4.0, jitter=0.5, capacity=8, **options), 2000, times, device)
        for options in OPTIONS
    )
    same = [(np.abs(np.diff(delays, axis=0)) < 1e-5).mean() for delays in (free, held)]
    assert same[0] < 0.01 and abs(same[1] - 0.75) < 0.03
    kept = (np.abs(np.diff(slow, axis=0)) < 1e-5).mean(axis=1)  # 0.25, 0.5, ..., 1.25
    assert kept[[1, 3]].min() == 1.0 and kept[[0, 2]].max() < 0.01


def test_lags_of_whole_steps(device: wp.Device) -> None:
    """Lags from 1 to 3 steps, all as likely, as simulators give them in steps; and from 0 to 2."""
    for first, last in ((1, 3), (0, 2)):
        latency, width = (first - 1) * 0.25, (last - first + 1) * 0.25
        effect = sensors.Delivery(latency=latency, jitter=width, distribution="uniform")
        frame, delivered = frame_of(effect, 30000, device)
        stages, first_shown = delivered.bind(frame), np.full(30000, np.nan)
        frame.params.drop.zero_()
        for k in range(5):
            frame.times.fill_(0.25 * k)
            frame.randomness.frames.fill_(k)
            frame.params.drop.fill_(float(k > 1))  # the frame of step 1 is the only one
            for stage in stages:
                stage.launch()
            shown = 0.25 * k - delivered.status.age.cpu().numpy() == 0.25
            first_shown[shown & np.isnan(first_shown)] = k - 1
        shares = [(first_shown == lag).mean() for lag in range(first, last + 1)]
        np.testing.assert_allclose(shares, 1.0 / 3.0, atol=0.01)


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ((sensors.Delivery(rate=-1.0),), "'eye': Delivery: rate must be from 0 to inf, got -1"),
        ((sensors.Delivery(drop=1.5),), "Delivery: drop must be from 0 to 1, got 1.5"),
        ((sensors.Delivery(capacity=0),), "capacity must be a whole number of at least 1, got 0"),
        ((sensors.Delivery(capacity=2.5),), "capacity must be a whole number of at least 1, got 2.5"),  # type: ignore[arg-type]
        (
            (sensors.Delivery(capacity=10**9),),
            r"'eye': Delivery: capacity must be at most \d+, for which an output of a world has less than 2\^31 bytes, "
            r"got 1000000000, for which all worlds need [\d,]+,000,000,000 bytes",
        ),
        ((sensors.Delivery(distribution="gamma"),), "distribution must be one of 'normal', 'uniform'"),  # type: ignore[arg-type]
        ((sensors.Delivery(rate=100.0, latency=0.05),), "capacity must be at least 6 .* got 4"),
        ((sensors.Delivery(), sensors.DepthRange(min=0, max=1)), "Delivery delivers all images and must be the last"),
        ((sensors.Delivery(), sensors.Delivery()), "Delivery delivers all images and must be the last effect"),
    ],
)
def test_bad_input_is_refused(effects: Any, message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        Rising("cpu", *effects)


def test_frames_that_have_no_room_are_refused(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("warpcam.sensors.timing.delivery.free_bytes", lambda device: 1000)
    with pytest.raises(
        wc.WarpcamError,
        match=r"capacity must be at most 4, for which there is room, got 5; 1,200 bytes are needed, 1,000 are free on",
    ):
        frame_of(sensors.Delivery(capacity=5), 60, device)
    frame_of(sensors.Delivery(capacity=4), 60, device)


def test_bad_times_are_refused() -> None:
    rising = Rising("cpu", sensors.Delivery())
    for time in ("now", True, [0, [0, 0]], np.zeros(2), torch.zeros(3, dtype=torch.float64), torch.zeros((3, 1))):
        with pytest.raises(wc.WarpcamError, match=r"time must be a number or float32 \(3,\) \[s\], got"):
            rising.rig.read(time=time)
    assert rising.rig.frames.tolist() == [0, 0, 0] == rising.renderer.frames.tolist()
    with wp.ScopedCapture("cpu"), pytest.raises(wc.WarpcamError, match="a time on the host cannot become part of it"):
        rising.rig.read(time=0.5)
    with pytest.raises(wc.WarpcamError, match="camera 'top' came, those with a Delivery are: 'eye'"):
        rising.rig.deliveries("top")
