"""Ray-cast sensors beside mjlab's and Isaac Lab's own: ``python -m warpcam.benchmarks.ray_casts``.

A G1 with a height scan of 16 x 11 rays on its pelvis, of the terrain alone, and a lidar of 32 x 360 on its torso that
sees all that is drawn, on hills (a height field) and on blocks (900 boxes). All read the same state, in turns: mjlab's
``SensorContext`` as ``Simulation.sense`` does it, in a CUDA graph; what Isaac Lab's ray caster for Newton runs, in a
CUDA graph; and warpcam's sensors. A time is the median of rounds, of which each reads some times over and waits for
the device once; on a CPU it is processor time, of all threads, which other work on the machine changes less.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import Any, Protocol

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import torch._dynamo  # mjlab imports triton, which crashes where Warp's compiler was loaded before
import warp as wp
from mjlab import sensor as theirs
from mjlab.sim.sim_data import WarpBridge

from warpcam.benchmarks import cases, machine, problem, scenes
from warpcam.compat import mjlab as ours
from warpcam.compat.mjlab.simulations import sensors_of

ROWS, COLUMNS = 32, 360
POSES = 4  # sets that rounds go through
TOLERANCE = 1e-4  # of distances that count as equal, relative above 1 m


class SpinningPattern:
    """A lidar as mjlab's sensors take patterns: rows from 15 degrees up to 25 down, columns all around."""

    def generate_rays(self, mj_model: Any, device: str) -> tuple[torch.Tensor, torch.Tensor]:
        up, around = torch.meshgrid(
            torch.deg2rad(torch.linspace(15.0, -25.0, ROWS)),
            2.0 * torch.pi * torch.arange(COLUMNS) / COLUMNS,
            indexing="ij",
        )
        rays = torch.stack((torch.cos(up) * torch.cos(around), torch.cos(up) * torch.sin(around), torch.sin(up)), -1)
        rays = rays.reshape(-1, 3).to(device)
        return torch.zeros_like(rays), rays


SENSORS: dict[str, dict[str, Any]] = {
    "height scan 16x11": {
        "frame": theirs.ObjRef(type="body", name="pelvis"),
        "pattern": theirs.GridPatternCfg(size=(1.5, 1.0), resolution=0.1),
        "ray_alignment": "yaw",
        "max_distance": 5.0,
        "include_geom_groups": (0,),
    },
    "lidar 32x360": {
        "frame": theirs.ObjRef(type="body", name="torso_link"),
        "pattern": SpinningPattern(),
        "max_distance": 30.0,
    },
}


def g1_on_blocks() -> mujoco.MjSpec:
    """Unitree G1 on 30 x 30 blocks of random heights."""
    spec, random = scenes.from_mjlab("unitree_g1/xmls/g1.xml"), np.random.default_rng(0)
    for row, column in np.ndindex(30, 30):
        half = float(random.uniform(0.25, 0.4))
        place = [0.6 * (row - 15), 0.6 * (column - 15), half - 0.5]
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.3, half], pos=place)
    scenes.look_at(spec, (1.7, -1.1, 1.1), (0.0, 0.0, 0.65))
    return spec


TERRAINS: dict[str, Callable[[], mujoco.MjSpec]] = {"hills": scenes.g1_on_terrain, "blocks": g1_on_blocks}


class Mjlab:
    """mjlab's own sensors, as ``Simulation.sense`` reads them."""

    def __init__(self, shared: problem.Problem, settings: dict[str, dict[str, Any]], device: str):
        self._m, self._d = shared.m, shared.d
        self.sensors = [theirs.RayCastSensorCfg(name=name, **given).build() for name, given in settings.items()]
        bridges = WarpBridge(shared.m, nworld=shared.worlds), WarpBridge(shared.d)
        for sensor in self.sensors:
            sensor.initialize(shared.mjm, *bridges, device)
        self._context = theirs.SensorContext(shared.mjm, *bridges, [], self.sensors, device)
        self._context.prepare()
        self._cast()
        self._graph = None
        if wp.get_device(device).is_cuda:
            with wp.ScopedCapture() as capture:
                self._cast()
            self._graph = capture.graph

    def place(self, index: int) -> None:
        """Nothing: it reads MuJoCo-Warp's data."""

    @property
    def distances(self) -> torch.Tensor:
        """(world, ray) [m], -1 where nothing is met."""
        return torch.cat([sensor.data.distances for sensor in self.sensors], dim=1)

    def read(self) -> None:
        self._context.prepare()
        if self._graph is None:
            self._cast()
        else:
            wp.capture_launch(self._graph)
        self._context.finalize()

    def _cast(self) -> None:
        mjw.refit_bvh(self._m, self._d, self._context.render_context)
        for sensor in self.sensors:
            sensor.raycast_kernel(self._context.render_context)


class Warpcam:
    """warpcam's sensors."""

    def __init__(self, shared: problem.Problem, settings: dict[str, dict[str, Any]], device: str):
        self.sensors = [ours.RayCastSensorCfg(name=name, **given).build() for name, given in settings.items()]
        for sensor in self.sensors:
            sensor.initialize(shared.mjm, shared.m, shared.d, device)
        self._simulation = sensors_of(shared.mjm, shared.m, shared.d)

    def place(self, index: int) -> None:
        """Nothing: it reads MuJoCo-Warp's data."""

    @property
    def distances(self) -> torch.Tensor:
        """(world, ray) [m], -1 where nothing is met."""
        return torch.cat([sensor.data.distances for sensor in self.sensors], dim=1)

    def read(self) -> None:
        self._simulation.render()


class Reader(Protocol):
    """What reads sensors: ``place`` goes to a set of poses before time is taken."""

    def place(self, index: int) -> None: ...

    def read(self) -> None: ...

    @property
    def distances(self) -> torch.Tensor: ...


def isaaclab(shared: problem.Problem, settings: dict[str, dict[str, Any]], device: str) -> Reader:
    """Isaac Lab's, which needs it and Newton."""
    from warpcam.benchmarks.peers.isaaclab_rays import IsaacLab

    return IsaacLab(shared, settings, device)


PEERS: dict[str, Callable[[problem.Problem, dict[str, dict[str, Any]], str], Reader]] = {
    "mjlab": Mjlab,
    "isaaclab": isaaclab,
}

INSTALLED = [name for name in PEERS if find_spec(name)]


def compare(
    terrain: str,
    settings: dict[str, dict[str, Any]],
    worlds: int,
    rounds: int,
    repeats: int,
    device: wp.Device,
    peers: Sequence[str],
) -> dict[str, Any]:
    """Medians [ms], how many times longer those of peers are, and how many of their distances are ours."""
    case = replace(cases.CASES["g1_terrain"], name=f"g1_{terrain}", spec=TERRAINS[terrain])
    shared = problem.build(case, worlds, 16, 16)
    readers: dict[str, Reader] = {name: PEERS[name](shared, settings, str(device)) for name in peers}
    ours = readers["warpcam"] = Warpcam(shared, settings, str(device))
    times: dict[str, list[float]] = {name: [] for name in readers}
    agreeing: dict[str, list[float]] = {name: [] for name in peers}
    clock = time.perf_counter if device.is_cuda else time.process_time
    for number in range(rounds + 1):
        shared.d.qpos.assign(shared.positions(number % POSES))
        mjw.kinematics(shared.m, shared.d)
        for name, reader in readers.items():
            reader.place(number % POSES)
            wp.synchronize_device(device)
            start = clock()
            for _ in range(repeats):
                reader.read()
            wp.synchronize_device(device)
            if number > 0:
                times[name].append(1e3 * (clock() - start) / repeats)
        for name in peers:
            expected = readers[name].distances
            same = (ours.distances - expected).abs() <= TOLERANCE * expected.abs().clamp(min=1.0)
            agreeing[name].append(same.float().mean().item())
    medians = {name: statistics.median(each) for name, each in times.items()}
    return {
        "terrain": terrain,
        "sensors": list(settings),
        "worlds": worlds,
        "rays_per_world": ours.distances.shape[1],
        **{f"{name}_ms": median for name, median in medians.items()},
        **{f"{name}_ms_range": [min(each), max(each)] for name, each in times.items()},
        "agreeing": {name: statistics.mean(each) for name, each in agreeing.items()},
        "ratio": {name: medians[name] / medians["warpcam"] for name in peers},
    }


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--worlds", type=int, default=None, help="4096; on a CPU 16")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--repeats", type=int, default=None, help="reads of a round: 10; on a CPU 1")
    parser.add_argument("--terrain", nargs="+", choices=TERRAINS, default=list(TERRAINS))
    parser.add_argument("--peers", nargs="+", choices=PEERS, default=INSTALLED, help="those that are installed")
    parser.add_argument("--out", help="JSON file")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device)
    worlds = options.worlds or (4096 if device.is_cuda else 16)
    repeats = options.repeats or (10 if device.is_cuda else 1)
    torch.set_num_threads(1)
    report: dict[str, Any] = {"about": __doc__, "machine": machine.describe(device), "results": []}
    with wp.ScopedDevice(device):
        for terrain in options.terrain:
            for names in ([*SENSORS], *([name] for name in SENSORS)):
                settings = {name: SENSORS[name] for name in names}
                result = compare(terrain, settings, worlds, options.rounds, repeats, device, options.peers)
                report["results"].append(result)
                print(f"{terrain}, {' and '.join(names)}, {worlds} worlds: warpcam {result['warpcam_ms']:.3f} ms")
                for peer in options.peers:
                    same, ratio = 100.0 * result["agreeing"][peer], result["ratio"][peer]
                    print(f"  {peer} {result[f'{peer}_ms']:.3f} ms, {ratio:.1f}x, {same:.2f} % agree", flush=True)
                if options.out:
                    with open(options.out, "w") as file:
                        json.dump(report, file, indent=1)


if __name__ == "__main__":
    main()
