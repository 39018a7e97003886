"""A scene in a browser: whoever opens the page looks around in it with a camera of their own."""

import socket
import time
from typing import Any, NamedTuple

import numpy as np

from warpcam import outputs, visualize
from warpcam.camera.camera import Camera
from warpcam.camera.lens import Pinhole
from warpcam.core.errors import WarpcamError
from warpcam.render.looks import LookName, looks_of
from warpcam.render.paths import PathOptions
from warpcam.render.renderer import Renderer
from warpcam.scene.environments import Environments
from warpcam.scene.scene import Scene
from warpcam.sensors import Rig
from warpcam.sensors.depth_cameras import CAMERA_MODELS
from warpcam.sources.mujoco import batch_file

try:
    import viser
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.viewer needs it: pip install 'warpcam[view]'"
    ) from error

__all__ = ["Viewer"]

FREE = "free"  # the camera that each page moves
OUTPUTS = tuple(name for name in outputs.OUTPUTS if name not in ("rgba", "flow_valid"))
LIT = ("rgb", "hdr")  # outputs with smooth edges, which looks are of
TRUTH = "none"  # in place of a sensor's name: what is there
QUALITY = 85  # of the pictures, which are sent as JPEG
MOST_SAMPLES = 4096  # paths of each pixel, after which a picture is left as it is
MOST_ADDED = 256  # between two pictures
PACE = 1.0 / 15.0  # of pictures that are refined [s]: about so long are paths added to each


class ClientCamera(NamedTuple):
    """A page's camera, in viser's words: it looks along its +Z, with +X right and +Y down.

    Attributes:
        position: In the world [m].
        wxyz: Rotation to the world's frame.
        fov: Vertical field of view [radians].
        aspect: Width of the window over its height.
    """

    position: tuple[float, ...]
    wxyz: tuple[float, ...]
    fov: float
    aspect: float


class ViewSelection(NamedTuple):
    """Settings of the controls beside the picture, shared by all pages."""

    output: str
    camera: str
    world: int
    sensor: str = TRUTH
    look: LookName | None = None  # None is the scene's own

    @property
    def traces_paths(self) -> bool:
        return self.look == "path" and self.output in LIT


class ShownPicture(NamedTuple):
    """What a page shows.

    Attributes:
        choice: With which controls it was drawn.
        eye: The page's camera.
        samples: Paths of each pixel; 0 where none are traced.
    """

    choice: ViewSelection
    eye: ClientCamera
    samples: int

    def is_of(self, view: "tuple[ViewSelection, ClientCamera] | None") -> bool:
        return (self.choice, self.eye) == view


class Viewer:
    """Shows a scene to all who open its page, one world at a time, as the state is at each ``update()``.

    Pictures are rendered as any others are, on the scene's device; the browser shows them and tells where it looks
    from. A page has controls for the output, the look, the camera (its own or one of the scene's) and the world. With
    the look "path" a picture gets more paths at each ``update(moved=False)``, until it has 4,096 a pixel.

    Attributes:
        server: The ``viser.ViserServer`` behind it, for controls of your own: ``viewer.server.gui``.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        width: int = 960,
        height: int = 540,
        host: str = "127.0.0.1",
        port: int = 8080,
        look: LookName | None = None,
        environments: Environments | None = None,
        ambient_occlusion: float | None = None,
        soft_shadows: bool = False,
        indirect_light: bool = False,
        reflections: bool = False,
    ):
        """Begin to serve the page.

        Args:
            scene: What to look at. Memory for a picture of each of its worlds is taken.
            width: Of the pictures, which are stretched to the window [pixels].
            height: Likewise.
            host: Address of this machine to listen at; "0.0.0.0" lets others in the network look, too.
            port: There. If it is taken, the next that is free.
            look: As ``Renderer`` takes it: the look of ``rgb`` and ``hdr`` that the page begins with.
            environments: As ``Renderer`` takes it; the look "mujoco", where a page changes to it, is without.
            ambient_occlusion: As ``Renderer`` takes it, in metres. The page must begin with the look "pbr"; the other
                looks, where a page changes to them, are without.
            soft_shadows: Likewise, as ``Renderer`` takes it.
            indirect_light: Likewise.
            reflections: Likewise.

        Raises:
            WarpcamError: An argument is not as described.
        """
        if not isinstance(scene, Scene):
            raise WarpcamError(f"Viewer: scene must be a Scene, got {type(scene).__name__}")
        for name, value, most in (("width", width, 8192), ("height", height, 8192), ("port", port, 65535)):
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= most:
                raise WarpcamError(f"Viewer: {name} must be a whole number from 1 to {most}, got {value!r}")
        _check_host(host)
        self._scene, self._width, self._height = scene, int(width), int(height)
        self._renderer: tuple[tuple[str | None, ...], Renderer, Rig | None] | None = None
        self._shown: dict[int, ShownPicture] = {}
        self._traced: tuple[ViewSelection, ClientCamera] | None = None  # view of the paths that the renderer has
        self._samples, self._added = 0, 1  # of these, and how many more come at once
        self._cameras = {name or str(index): index for index, name in enumerate(scene.cameras)}
        looks, self._environments = looks_of(scene), environments
        self._rays: dict[str, Any] = {
            "ambient_occlusion": ambient_occlusion,
            "soft_shadows": soft_shadows,
            "indirect_light": indirect_light,
            "reflections": reflections,
        }
        first_look = look or looks[0]
        _check_rays(self._rays, first_look)
        if environments is not None and first_look == "mujoco":
            raise WarpcamError("Viewer: environments light look='pbr' and look='path', and the look is 'mujoco'")
        self._renderer_of(ViewSelection("rgb", FREE, 0, look=look))
        lower, upper = scene.bounds()
        start = batch_file.free_camera(None, lower, upper, width / height)
        self.server = viser.ViserServer(host, int(port), label="warpcam", verbose=False)
        self.server.scene.set_up_direction("+z")
        first = self.server.initial_camera
        first.look_at, first.position = 0.5 * (lower + upper), start["position"]
        first.fov = float(np.radians(start["lens"].fovy))
        gui = self.server.gui
        self._output = gui.add_dropdown("Output", OUTPUTS, initial_value="rgb")
        self._look = gui.add_dropdown("Look", looks, initial_value=first_look, visible=len(looks) > 1)
        self._paths: Any = gui.add_number("Paths a pixel", 0, disabled=True, visible=False)
        self._camera = gui.add_dropdown("Camera", (FREE, *self._cameras), initial_value=FREE)
        self._sensor = gui.add_dropdown("Sensor", (TRUTH, *CAMERA_MODELS), initial_value=TRUTH)
        last = scene.num_worlds - 1
        self._world = gui.add_slider("World", min=0, max=max(last, 1), step=1, initial_value=0, visible=last > 0)

    @property
    def url(self) -> str:
        """Address of the page."""
        host = self.server.get_host()
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}"

    def update(self, moved: bool = True) -> int:
        """Draw the state as it is now for all who look; returns how many pictures were sent.

        Args:
            moved: False draws only for those whose camera or choice is another one than in their last picture, and
                adds paths to a picture of the look "path". The state must be as it was then.
        """
        if not isinstance(moved, bool | np.bool_):
            raise WarpcamError(f"Viewer.update: moved must be True or False, got {moved!r}")
        choice = ViewSelection(
            str(self._output.value),
            str(self._camera.value),
            int(self._world.value),
            str(self._sensor.value),
            self._look.value,
        )
        clients = self.server.get_clients()
        self._shown = {number: shown for number, shown in self._shown.items() if number in clients}
        sent = 0
        for number, client in clients.items():
            camera = client.camera
            eye = ClientCamera(tuple(camera.position), tuple(camera.wxyz), float(camera.fov), float(camera.aspect))
            last = None if moved else self._shown.get(number)
            if last is not None and last.is_of((choice, eye)):
                if not self._may_refine(last):
                    continue
                picture = self._refined if last.is_of(self._traced) else self.picture
            else:
                picture = self.picture
            client.scene.set_background_image(picture(choice, eye), "jpeg", jpeg_quality=QUALITY)
            self._shown[number] = ShownPicture(choice, eye, self._samples)
            sent += 1
        self._paths.visible, self._paths.value = choice.traces_paths, self._samples
        return sent

    def picture(self, choice: ViewSelection, eye: ClientCamera) -> np.ndarray:
        """Return the picture of a page, (height, width, 3) uint8.

        A scene's camera gets borders if the page is wider or higher.
        """
        begun = time.perf_counter()
        renderer, rig = self._renderer_of(choice)
        if choice.camera == FREE:
            self._place(renderer, choice.world, eye)
        if rig is None:
            renderer.render(worlds=[choice.world])
        else:
            rig.read(worlds=[choice.world])
        self._traced = (choice, eye) if choice.traces_paths else None
        self._samples = 1 if choice.traces_paths else 0
        return self._finished(choice, eye, self._added - 1, begun)

    def _refined(self, choice: ViewSelection, eye: ClientCamera) -> np.ndarray:
        """The last picture that was drawn, with more paths."""
        return self._finished(choice, eye, self._added, time.perf_counter())

    def _finished(self, choice: ViewSelection, eye: ClientCamera, added: int, begun: float) -> np.ndarray:
        """The picture of what the renderer has drawn since ``begun`` [s], and of so many more paths."""
        renderer, rig = self._renderer_of(choice)
        added = min(added, MOST_SAMPLES - self._samples) if choice.traces_paths else 0
        if added > 0:
            renderer.accumulate(added)
            self._samples += added
        (images,) = (renderer if rig is None else rig).images.values()
        image = images[choice.output][choice.world : choice.world + 1].cpu().numpy()
        if choice.traces_paths:
            self._added = _paced(self._added, time.perf_counter() - begun)
        shown = visualize.picture(choice.output, image)[0].copy()  # colours may be the renderer's own
        return shown if choice.camera == FREE else _bordered(shown, eye.aspect)

    def _may_refine(self, shown: ShownPicture) -> bool:
        """Whether a page's picture gets more paths now: pages that look from elsewhere do one after the other."""
        if not 0 < shown.samples < MOST_SAMPLES:
            return False
        others = (other for other in self._shown.values() if other is not shown)
        return shown.is_of(self._traced) or not any(
            other.is_of(self._traced) and other.samples < MOST_SAMPLES for other in others
        )

    def close(self) -> None:
        """End the page."""
        self.server.stop()

    def _renderer_of(self, choice: ViewSelection) -> tuple[Renderer, Rig | None]:
        """The renderer for an output and a camera, and the rig of a sensor; made where the last picture had others."""
        look = choice.look if choice.output in LIT else None
        wanted = choice.output, choice.camera, choice.sensor, look
        if self._renderer is None or self._renderer[0] != wanted:
            self._renderer = None  # its memory first
            model = None if choice.sensor == TRUTH else CAMERA_MODELS[choice.sensor]()
            free: dict[str, Any] = {}
            if choice.camera == FREE:
                free = {"position": (0.0, 0.0, 0.0), "lens": Pinhole(fx=1.0)}
            camera = Camera(
                FREE if free else self._cameras[choice.camera],
                width=self._width,
                height=self._height,
                outputs=tuple(dict.fromkeys((choice.output, *(() if model is None else model.outputs)))),
                shadows=True,
                antialiasing=4 if choice.output in LIT else 1,
                **free,
            )
            paths = PathOptions(samples=1) if choice.traces_paths else None
            drawn = look or looks_of(self._scene)[0]
            lights = None if drawn == "mujoco" else self._environments  # which they do not light
            rays = self._rays if drawn == "pbr" and choice.output in LIT else {}
            renderer = Renderer(self._scene, [camera], look=look, path=paths, environments=lights, **rays)
            self._renderer = wanted, renderer, None if model is None else Rig(renderer, {camera.name: model})
        return self._renderer[1:]

    def _place(self, renderer: Renderer, world: int, eye: ClientCamera) -> None:
        """Put the free camera of a world where a page looks from; its pixels are as wide as the window makes them."""
        w, x, y, z = eye.wxyz
        high = 0.5 * self._height / np.tan(0.5 * eye.fov)
        wide = high * self._width / (self._height * eye.aspect)
        arrays: Any = renderer.camera(FREE)
        arrays.position[world] = arrays.position.new_tensor(eye.position)
        arrays.rotation[world] = arrays.rotation.new_tensor((-x, w, z, -y))  # half a turn about its x
        arrays.intrinsics[world, :2] = arrays.intrinsics.new_tensor((wide, high))


def _paced(added: int, seconds: float) -> int:
    """How many paths of each pixel to add next, when the last so many took so long [s]."""
    if seconds < 0.5 * PACE:
        return min(2 * added, MOST_ADDED)
    return max(added // 2, 1) if seconds > 2.0 * PACE else added


def _bordered(picture: np.ndarray, aspect: float) -> np.ndarray:
    """A picture in the middle of black of another aspect."""
    height, width = picture.shape[:2]
    beside, over = max(round(height * aspect) - width, 0), max(round(width / aspect) - height, 0)
    return np.pad(picture, ((over // 2, over - over // 2), (beside // 2, beside - beside // 2), (0, 0)))


def _check_rays(rays: dict[str, Any], look: str) -> None:
    """Refuse rays of the look "pbr" on a page that begins with another one."""
    for name, value in rays.items():
        is_off = value is None if name == "ambient_occlusion" else isinstance(value, bool | np.bool_) and not value
        if look in ("mujoco", "path") and not is_off:
            raise WarpcamError(f"Viewer: {name} is {value!r}, which is of look='pbr', and the look is {look!r}")


def _check_host(host: Any) -> None:
    """Refuse what no server of this machine can listen at, for which viser's would wait without end."""
    allowed = 'Viewer: host must be an address of this machine like "127.0.0.1"'
    if not isinstance(host, str):
        raise WarpcamError(f"{allowed}, got {host!r}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as free:
            free.bind(address)
    except (OSError, UnicodeError) as error:
        raise WarpcamError(f"{allowed}, got {host!r}: {error}") from None
