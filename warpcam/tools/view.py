"""The command ``warpcam view``: a scene in a browser."""

import argparse
import time
from typing import Any, NoReturn

import warpcam
from warpcam.core.file_access import FileAccess
from warpcam.sources.common import formats
from warpcam.sources.mujoco import batch_file
from warpcam.tools import scene_access, scene_options
from warpcam.tools.demo_simulation import Simulation

ABOUT = "look around in a scene, in a browser; MuJoCo simulates what it has read"
PERIOD = 1.0 / 30.0  # of pictures in a browser [s]
SLOWEST = 0.1  # what is simulated between two of them at most [s]


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.description = ABOUT
    scene_options.add(command, worlds=1, size="960x540")
    command.add_argument("--host", default="127.0.0.1", metavar="A", help="address to listen at (default: %(default)s)")
    command.add_argument(
        "--port", type=int, default=8080, metavar="P", help="there (default: %(default)s, or the next)"
    )
    scene_options.add_look(command)


def run(options: argparse.Namespace) -> int:
    from warpcam.viewer import Viewer  # which needs viser

    width, height, device = scene_options.check(options)
    splats = scene_options.splats_of(options)
    path, simulation = options.scene or batch_file.DEMO, None
    if path.suffix.lower() in (*formats.USD, *formats.MESHES):
        scene = warpcam.load(path, options.worlds, device=device, **scene_access.options_of(options))
    else:
        access = FileAccess(path, **scene_access.options_of(options))
        simulation = Simulation(path, options.worlds, options.seed, access)
        scene = warpcam.from_mujoco(simulation.host, simulation.states, device=device, splats=splats)
    viewer = Viewer(
        scene,
        width=width,
        height=height,
        host=options.host,
        port=options.port,
        look=options.look,
        environments=scene_options.environments_of(options, scene),
        **scene_options.rays_of(options),
    )
    print(f"{viewer.url} (Ctrl-C ends it)", flush=True)
    try:
        _look(viewer, simulation)
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.close()


def _look(viewer: Any, simulation: Simulation | None) -> NoReturn:
    """Simulate in real time, and draw what is seen, until interrupted."""
    if simulation is not None:
        simulation.add_controls(viewer.server.gui)
    last = time.perf_counter()
    while True:
        begun = time.perf_counter()
        moved = simulation is not None and simulation.advance(min(begun - last, SLOWEST))
        last = begun
        viewer.update(moved)
        time.sleep(max(0.0, PERIOD - (time.perf_counter() - begun)))
