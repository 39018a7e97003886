"""Data sets on a Ray cluster of several processes: the same bytes, and nothing lost with an actor."""

import dataclasses
import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from dataset_plans import files_of, plan_of

import warpcam as wc
from warpcam.datasets.generate import generate
from warpcam.tools import cli

ray = pytest.importorskip("ray", reason="pip install 'warpcam[ray]'")

from warpcam.datasets.generate import cluster  # noqa: E402

HELPERS = str(Path(__file__).parents[1] / "helpers")
pytestmark = pytest.mark.filterwarnings("ignore")  # of what ray starts and leaves open


@pytest.fixture(scope="module")
def two_processors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cluster on this machine, whose processes compile kernels as this one does."""
    site = tmp_path_factory.mktemp("site")
    (site / "sitecustomize.py").write_text(
        "import sys\nif any('default_worker' in each for each in sys.orig_argv):\n"
        "    import fast_compile\n    fast_compile.install(ours=True)\n"
    )
    root = str(Path(wc.__file__).parents[1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join((str(site), HELPERS, root)))
        ray.init("local", num_cpus=2, num_gpus=0, include_dashboard=False, log_to_driver=False)
        yield
        ray.shutdown()


def actors() -> list[int]:
    """Processes of this cluster that make shards."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            title, above = (folder / "cmdline").read_bytes(), int(folder.name)
            while above not in (0, os.getpid()):
                above = int(re.search(r"^PPid:\s*(\d+)", (Path("/proc") / str(above) / "status").read_text(), re.M)[1])
        except (OSError, TypeError):
            continue
        if title.startswith(b"ray::ShardMaker") and above:
            found.append(int(folder.name))
    return found


def test_the_same_as_without(tmp_path: Path, two_processors: None) -> None:
    plan, told = plan_of(tmp_path, "one", count=10, shard_size=2), []
    generate(plan)
    of_ray = dataclasses.replace(plan, out=str(tmp_path / "ray"))
    cluster.generate_on_ray(of_ray, progress=told.append)
    assert files_of(of_ray.out) == files_of(plan.out)
    assert told == [0, 2, 2, 2, 2, 2]
    before = {path: path.stat().st_mtime_ns for path in Path(of_ray.out).glob("shards/*/*")}
    cluster.generate_on_ray(dataclasses.replace(of_ray, count=12))
    assert before.items() <= {path: path.stat().st_mtime_ns for path in Path(of_ray.out).glob("shards/*/*")}.items()
    for _ in range(200):  # they end a little later
        if not actors():
            break
        time.sleep(0.1)
    assert not actors()


def test_a_killed_actor_s_shard_is_made_again(
    tmp_path: Path, two_processors: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of(tmp_path, "one", recipes=None, count=40, shard_size=2)
    generate(plan)
    told, lost, put_in_place = [], [], cluster._Makers._lost

    def kill_one(samples: int) -> None:
        told.append(samples)
        if len(told) == 4:
            os.kill(actors()[0], signal.SIGKILL)

    def note(makers: Any, actor: Any, shard: int, *rest: Any) -> None:
        lost.append(shard)
        put_in_place(makers, actor, shard, *rest)

    monkeypatch.setattr(cluster._Makers, "_lost", note)
    of_ray = dataclasses.replace(plan, out=str(tmp_path / "ray"))
    cluster.generate_on_ray(of_ray, workers=2, progress=kill_one)
    assert len(lost) == 1 and sum(told) == 40
    assert files_of(of_ray.out) == files_of(plan.out)


def test_a_shard_whose_actors_all_die(tmp_path: Path, two_processors: None, monkeypatch: pytest.MonkeyPatch) -> None:
    class Deadly(cluster.ShardMaker):
        def make(self, shard: int) -> str | None:
            if shard == 1:
                os._exit(1)
            return super().make(shard)

    monkeypatch.setattr(cluster, "ShardMaker", Deadly)
    plan = plan_of(tmp_path, recipes=None, count=6, shard_size=2)
    with pytest.raises(
        wc.WarpcamError, match="the actors that made shard 1 died, 3 of them; finished shards are whole"
    ):
        cluster.generate_on_ray(plan, workers=1)
    assert (Path(plan.out) / "shards" / "000000" / "shard.json").exists()
    assert not list(Path(plan.out).glob("shards/.*"))


def test_mistakes(tmp_path: Path, two_processors: None, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path, recipes="poses: {sofa: {low: [0, 0, 0], high: [1, 1, 1]}}", count=2)
    with pytest.raises(wc.WarpcamError, match=r"^poses: 'sofa' is no body of the scene"):
        cluster.generate_on_ray(plan)
    with pytest.raises(wc.WarpcamError, match="workers must be a whole number of at least 1, got 0"):
        cluster.generate_on_ray(plan, workers=0)
    arguments: list[Any] = ["dataset", plan.scene, "--writer", "yolo", "--count", "2", "--size", "16x12", "--ray"]
    arguments += ["--device", "cpu", "--worlds", "2", "--antialiasing", "1", "--out", str(tmp_path / "cli")]
    assert cli.main(arguments) == 0
    assert "2 samples in" in capsys.readouterr().out and (tmp_path / "cli" / "data.yaml").exists()
