"""The images of one camera on their way through its effects."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, get_args

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.core.world_arrays import WorldArrays
from warpcam.kernels.flags import Lens
from warpcam.kernels.runtime.indices import COLOR_STRIP, STRIP, strips_of
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.render.drawn_cameras import drawn_cameras
from warpcam.render.renderer import Renderer
from warpcam.sensors.effect import Effect, EffectFrame, Kind, names_of, parameter_array, parameters_of
from warpcam.sensors.kernels import curves
from warpcam.sensors.kernels import images as kernels
from warpcam.sensors.kernels.color_images import color_source, color_target
from warpcam.sensors.kernels.random import Randomness
from warpcam.sensors.kernels.tone import apply_srgb
from warpcam.sensors.timing.clock import Clock
from warpcam.sensors.timing.delivery import DeliveredImages, Delivery

Images = Mapping[str, wp.array]
BindStep = Callable[[wp.array, wp.array, Images, range, wp.array], Sequence[Stage]]
BYTES = 2  # place of an image of bytes on the way
GRADES = {"linear": 0, "display": 1}  # of effects on colours, in the order in which they may come


@dataclass(frozen=True)
class Step:
    """One step of a chain of images.

    Attributes:
        source: Output of the renderer that the chain begins with.
        in_place: It may write the image that it reads.
        bind: Gives its stages for source, target, truth, worlds and mask.
        reads_bytes: It may read bytes of colours.
        writes_bytes: It may write bytes of colours.
        starts_with_bytes: It makes bytes of what it reads.
    """

    source: str
    in_place: bool
    bind: BindStep
    reads_bytes: bool = False
    writes_bytes: bool = False
    starts_with_bytes: bool = False


class Measurement:
    """What one camera measures.

    Attributes:
        images: Tensors of the outputs that effects change; all outputs and ``frame_age`` of a camera with a delivery.
        parameters: Of the effects.
        deliveries: State of the delivery, None without one.
        timed: Name of an effect that needs the simulation's time, or "".
        width: Of the images [pixels].
        height: Of the images [pixels].
    """

    def __init__(
        self,
        renderer: Renderer,
        camera: str | int,
        effects: Sequence[Effect],
        *,
        first_stream: int,
        randomness: Callable[[int, range], Randomness],
        clock: Clock,
    ):
        self._renderer, self._camera = renderer, camera
        self._first_stream, self._randomness, self._clock = first_stream, randomness, clock
        if camera not in tuple(renderer.images):
            known = ", ".join(map(repr, renderer.images))
            raise WarpcamError(f"Rig: camera {camera!r} came, the renderer draws {known}")
        if isinstance(effects, str) or not isinstance(effects, Sequence):
            raise WarpcamError(f"{self._where}: effects must be a list of effects, got {effects!r}")
        self._effects = list(effects)
        names = tuple(renderer.images[camera])
        self._truth: Mapping[str, wp.array] = {name: renderer.rendered(camera, name) for name in names}
        self._sources: Mapping[str, wp.array] = {name: renderer.array(camera, name) for name in names}
        some = next(iter(self._truth.values()))
        self._num_worlds, self.height, self.width = some.shape[:3]
        self._renders: Any = torch_interop.as_array(renderer.frames)
        self._device = some.device
        self._check()
        self.timed = next((type(effect).__name__ for effect in self._effects if effect.timed), "")
        self._names = names_of(self._effects)
        self._arrays = [
            {
                entry.name: parameter_array(effect, entry, self._where, self._num_worlds, self._device)
                for entry in parameters_of(effect)
            }
            for effect in self._effects
        ]
        self.parameters = self._parameters()
        self._unclipped = self._make_unclipped()
        # What chains begin with: a stereo camera's depth is as it was measured, 0 where nothing matches.
        self._starts = dict(self._sources)
        if self._unclipped is not None and self._sources["depth"] is self._truth["depth"]:
            self._starts["depth"] = self._unclipped
        self._memories: dict[tuple[int, range], dict[str, wp.array]] = {}
        self._chains = [chain for chain in (self._depth_steps(), self._color_steps()) if chain]
        self._buffers = [self._make_buffers(chain) for chain in self._chains]
        self._measured = self._make_images()
        self._delivered = self._make_delivery()
        shown = self._delivered.images if self._delivered else self._measured
        self.images = {name: torch_interop.to_torch(array) for name, array in shown.items()}
        self.deliveries = self._delivered.status if self._delivered else None
        if self.deliveries is not None:
            self.images["frame_age"] = self.deliveries.age

    def bind(self, worlds: range, mask: wp.array) -> list[Stage]:
        """Bind the stages that measure some worlds."""
        within = slice(worlds.start, worlds.stop)
        truth = {name: array[within] for name, array in self._truth.items()}
        stages: list[Stage] = []
        if self._unclipped is not None:
            drawn, unclipped = truth["depth"], self._unclipped[within]
            source, target = _as_rows(drawn), _as_rows(unclipped)
            stages.append(self._exchange_misses(source, target, worlds, mask, hides=True))
            truth["depth"] = unclipped
        for steps, buffers in zip(self._chains, self._buffers, strict=True):
            source = _as_rows(self._starts[steps[0].source][within])
            targets = [buffers[place][within] for place in _places(steps, self._buffered(steps))]
            if self._stored and steps is self._chains[-1]:
                targets.append(_as_rows(self._measured[self._stored][within]))
            for step, target in zip(steps, targets, strict=True):
                stages += step.bind(source, target, truth, worlds, mask)
                source = target
        for name in ("rgb", "rgba"):
            if name in self._measured and name != self._stored:
                images = [self._buffers[-1][0][within], _as_rows(truth[name]), _as_rows(self._measured[name][within])]
                kernel = kernels.store_light if self._ends_linear else kernels.store_display
                tables = [curves.byte_table(self._device)] if self._ends_linear else []
                stages.append(self._per_strip(kernel, worlds, [mask, self._size, *tables, *images]))
        if self._delivered:
            none = wp.empty(0, dtype=wp.float32, device=self._device)
            frame = self._frame(len(self._effects) - 1, none, none, truth, worlds, mask)
            stages += self._delivered.bind(frame)
        return stages

    def bind_reset(self, mask: wp.array) -> list[Stage]:
        """Bind the stages that forget what effects keep from frame to frame."""
        stages = []
        for (_, worlds), memory in self._memories.items():
            for array in memory.values():
                words = shared(array, (len(worlds), array.capacity // (4 * len(worlds))), wp.int32)
                inputs = [mask[worlds.start : worlds.stop], words]
                stages.append(bind_launch(kernels.clear, words.size, inputs, self._device))
        return stages

    @property
    def _where(self) -> str:
        return f"Rig: {self._camera!r}"

    def _check(self) -> None:
        """Raise for effects that do not fit the camera or each other."""
        grade, before = 0, ""
        for effect in self._effects:
            name = type(effect).__name__
            if not isinstance(effect, Effect):
                raise WarpcamError(f"{self._where}: effects of warpcam.sensors are allowed, got {effect!r}")
            if not dataclasses.is_dataclass(effect):
                raise WarpcamError(f"{self._where}: {name} must be a dataclass: @dataclass(frozen=True, eq=False)")
            effect.check(f"{self._where}: {name}")
            if getattr(effect, "kind", None) not in get_args(Kind):
                allowed = ", ".join(map(repr, get_args(Kind)))
                raise WarpcamError(
                    f"{self._where}: {name}: kind must be one of {allowed}, got {getattr(effect, 'kind', None)!r}"
                )
            if effect.kind == "delivery":
                if effect is not self._effects[-1]:
                    raise WarpcamError(f"{self._where}: {name} delivers all images and must be the last effect")
                continue
            wanted = ["depth"] if effect.kind == "depth" else []
            missing = [output for output in (*wanted, *effect.reads) if output not in self._truth]
            if effect.kind != "depth" and not {"rgb", "rgba"} & set(self._truth):
                missing.insert(0, "rgb")
            if missing:
                raise WarpcamError(
                    f"{self._where}: {name} needs {' and '.join(map(repr, missing))} among the camera's outputs, which "
                    f"are {', '.join(map(repr, self._truth))}"
                )
            if min(self.width, self.height) < effect.least_size:
                raise WarpcamError(
                    f"{self._where}: {name} needs images of at least {effect.least_size} x {effect.least_size} pixels, "
                    f"got {self.width} x {self.height}"
                )
            if effect.needs_pinhole and not self._is_pinhole():
                raise WarpcamError(f"{self._where}: {name} needs a camera with a pinhole lens (warpcam.Pinhole)")
            if effect.kind == "depth":
                continue
            if (curve := self._drawn_camera().tone_mapping) != "clip":
                raise WarpcamError(
                    f"{self._where}: {name} makes colours of light by sRGB alone, for which the camera's tone_mapping "
                    f"must be 'clip', got {curve!r}"
                )
            if GRADES[effect.kind] < grade:
                raise WarpcamError(
                    f"{self._where}: {name} changes linear light and must come before {before}, which gives or changes "
                    "display colours"
                )
            if GRADES[effect.kind] > grade or effect.encodes:
                grade, before = 1, name

    def _drawn_camera(self) -> Camera:
        return drawn_cameras(self._renderer, "Rig")[1][self._camera].camera

    def _is_pinhole(self) -> bool:
        lenses = {key.lens for key in self._renderer.plan[self._camera].keys if hasattr(key, "lens")}
        return lenses == {Lens.PINHOLE}

    def _parameters(self) -> WorldArrays:
        arrays, ranges = {}, {}
        for name, effect, own in zip(self._names, self._effects, self._arrays, strict=True):
            for entry in parameters_of(effect):
                arrays[f"{name}_{entry.name}"] = own[entry.name]
                ranges[f"{name}_{entry.name}"] = (entry.metadata["low"], entry.metadata["high"])
        return WorldArrays(self._where, arrays, self._num_worlds, self._device, ranges)

    def _depth_steps(self) -> list[Step]:
        depth = [number for number, effect in enumerate(self._effects) if effect.kind == "depth"]
        steps = [self._step(number, "depth") for number in depth]
        if steps and self._starts["depth"] is self._unclipped:
            steps.append(Step("depth", True, self._show_misses))
        return steps

    def _make_unclipped(self) -> wp.array | None:
        """The true depth for effects, where the camera's own is a number where nothing is hit, and one asks for it."""
        asks = any(effect.kind == "depth" or "depth" in effect.reads for effect in self._effects)
        clips = self._drawn_camera().depth_clipping != "none"
        return wp.zeros_like(self._truth["depth"]) if asks and clips else None

    def _color_steps(self) -> list[Step]:
        """Effects on colours, with the curves between bytes, linear light and display values."""
        colors = [number for number, effect in enumerate(self._effects) if effect.kind in GRADES]
        self._ends_linear, self._stored = True, ""
        if not colors:
            return []
        source = next(name for name in ("hdr", "rgb", "rgba") if name in self._truth)
        steps: list[Step] = []
        for place, number in enumerate(colors):
            effect = self._effects[number]
            is_linear = self._ends_linear
            if effect.kind == "display" and is_linear and not effect.takes_light:
                before = self._effects[colors[place - 1]]
                if place == 0 or not (before.reads_bytes and before.writes_bytes):
                    steps.append(Step(source, True, self._bind_srgb, reads_bytes=True))
                else:  # the one before goes through the curve itself
                    steps[-1] = self._step(colors[place - 1], source, True, True, through_srgb=True)
                is_linear = False
            self._ends_linear &= effect.kind == "linear" and not effect.encodes
            steps.append(self._step(number, source, is_linear, self._ends_linear))
        if source != "hdr":
            if not steps[0].reads_bytes:
                light = curves.light_table(self._device)
                steps.insert(0, Step(source, False, self._bind_curve(kernels.decode_bytes, [light])))
        elif self._renderer.scene.tables().physical is None:  # unbounded, but as a display takes it
            steps.insert(0, Step(source, True, self._bind_curve(kernels.decode_light, [])))
        results = [name for name in ("rgb", "rgba") if name in self._truth]
        if steps[-1].writes_bytes and len(results) == 1:
            self._stored = results[0]
        return steps

    def _buffered(self, steps: Sequence[Step]) -> int:
        """How many steps of a chain do not write bytes of the result."""
        return len(steps) - (1 if self._stored and steps is self._chains[-1] else 0)

    def _step(
        self,
        number: int,
        source: str,
        is_linear: bool = False,
        gives_light: bool = False,
        *,
        through_srgb: bool = False,
    ) -> Step:
        effect = self._effects[number]

        def bind(source: wp.array, target: wp.array, truth: Images, worlds: range, mask: wp.array) -> Sequence[Stage]:
            frame = self._frame(number, source, target, truth, worlds, mask)
            frame = dataclasses.replace(frame, is_linear=is_linear, gives_light=gives_light)
            return effect.bind(dataclasses.replace(frame, through_srgb=through_srgb))

        return Step(source, effect.in_place, bind, effect.reads_bytes, effect.writes_bytes, effect.starts_with_bytes)

    def _frame(
        self, number: int, source: wp.array, target: wp.array, truth: Images, worlds: range, mask: wp.array
    ) -> EffectFrame:
        within = slice(worlds.start, worlds.stop)
        return EffectFrame(
            source=source,
            target=target,
            truth=truth,
            views=self._renderer.views(self._camera)[within],
            times=self._clock.times[within],
            elapsed=self._clock.elapsed[within],
            renders=self._renders[within],
            mask=mask,
            params=SimpleNamespace(**{name: array[within] for name, array in self._arrays[number].items()}),
            randomness=self._randomness(self._first_stream + number, worlds),
            width=self.width,
            height=self.height,
            device=self._device,
            memory=self._memories.setdefault((number, worlds), {}),
            worlds=worlds,
            pinhole=self._is_pinhole(),
        )

    def _show_misses(
        self, source: wp.array, target: wp.array, truth: Images, worlds: range, mask: wp.array
    ) -> Sequence[Stage]:
        return [self._exchange_misses(source, target, worlds, mask, hides=False)]

    def _exchange_misses(self, source: wp.array, target: wp.array, worlds: range, mask: wp.array, hides: bool) -> Stage:
        views = self._renderer.views(self._camera)[worlds.start : worlds.stop]
        inputs = [mask, self._size, views, int(hides), source, target]
        return self._per_strip(kernels.exchange_misses, worlds, inputs)

    def _bind_curve(self, kernel: wp.Kernel, tables: Sequence[wp.array]) -> BindStep:
        def bind(source: wp.array, target: wp.array, truth: Images, worlds: range, mask: wp.array) -> Sequence[Stage]:
            return [self._per_strip(kernel, worlds, [mask, self._size, *tables, source, target])]

        return bind

    def _bind_srgb(
        self, source: wp.array, target: wp.array, truth: Images, worlds: range, mask: wp.array
    ) -> Sequence[Stage]:
        images = [color_source(source), color_target(target, truth, False)]
        return [self._per_strip(apply_srgb, worlds, [mask, self._size, *images], COLOR_STRIP)]

    def _per_strip(self, kernel: wp.Kernel, worlds: range, inputs: Sequence[Any], rows: int = STRIP) -> Stage:
        return bind_launch(kernel, len(worlds) * strips_of(self.width, self.height, rows), inputs, self._device)

    @property
    def _size(self) -> wp.vec2i:
        return wp.vec2i(self.width, self.height)

    def _make_buffers(self, steps: Sequence[Step]) -> dict[int, wp.array]:
        """Images that steps write, by place: the measured one, and others that are read on the way to it."""
        dtype = wp.float32 if steps[0].source == "depth" else wp.vec3
        shape = (self._num_worlds, self.height * self.width)
        places = _places(steps, self._buffered(steps))
        buffers = {place: wp.zeros(shape, dtype=dtype, device=self._device) for place in {*places} - {BYTES}}
        if BYTES in places:
            buffers[BYTES] = wp.zeros((*shape, 3), dtype=wp.uint8, device=self._device)
        return buffers

    def _make_images(self) -> dict[str, wp.array]:
        """Images that effects change."""
        measured = {}
        for steps, buffers in zip(self._chains, self._buffers, strict=True):
            if steps[0].source == "depth":
                measured["depth"] = shared(buffers[0], (self._num_worlds, self.height, self.width, 1), wp.float32)
            else:
                measured |= {name: wp.zeros_like(self._truth[name]) for name in ("rgb", "rgba") if name in self._truth}
        return measured

    def _make_delivery(self) -> DeliveredImages | None:
        """The delivery of all outputs, measured where effects change them."""
        if not self._effects or not isinstance(self._effects[-1], Delivery):
            return None
        return DeliveredImages(self._effects[-1], self._arrays[-1], {**self._sources, **self._measured}, self._where)


def _places(steps: Sequence[Step], count: int) -> list[int]:
    """Which buffer each of the first so many steps writes.

    The last of numbers writes the first one, and a step that looks at neighbours not what it reads. What begins with
    bytes is given bytes.
    """
    places, place = [], 0
    for number in reversed(range(count)):
        follows = steps[number + 1 : number + 2]
        gives_bytes = any(step.starts_with_bytes for step in follows) and steps[number].writes_bytes
        places.append(BYTES if gives_bytes else place)
        place = place if steps[number].in_place else 1 - place
    return places[::-1]


def _as_rows(image: wp.array) -> wp.array:
    """An image as (world, pixel) numbers or colours; one of bytes as (world, pixel, channel)."""
    worlds, height, width, channels = image.shape
    if image.dtype is wp.uint8:
        return image.reshape((worlds, height * width, channels))
    return shared(image, (worlds, height * width), wp.vec3 if channels == 3 else wp.float32)
