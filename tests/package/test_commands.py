"""Every command in the README and the docs is run by a test, or at least read by the parser of the program it calls."""

import re
from pathlib import Path

import commands
import pytest
from PIL import Image

from tests.package.test_docs import MODEL, ROOT
from tests.package.test_promises import missing
from warpcam.tools import cli

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "benchmarks/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
# Programs of others, which not every environment has: what a module's parser comes after, or documentation's own.
OPTIONAL = {"mjlab", "isaaclab", "mkdocs", "mike"}
# Tests that run a command as the pages have it, with smaller numbers. Commands of several GPUs and hosts are parsed.
RUN = """
warpcam render: `tests/package/test_commands.py` `test_pictures_of_the_pages`
warpcam cache: `tests/accel/test_tree_cache.py`
warpcam --version: `tests/tools/test_cli.py` `test_the_package_is_the_command`
warpcam view: `tests/tools/test_viewer.py` `test_the_command_serves_a_file_until_interrupted`
warpcam doctor: `tests/tools/test_doctor.py` `test_every_device_of_this_machine_passes` `test_for_programs`
warpcam bench: `tests/benchmarks/test_benchmarks.py` `test_renderers_agree_and_the_json_says_so`
warpcam train: `tests/train/test_cartpole.py` `test_a_policy_learns_from_pixels`
warpcam dataset: `tests/datasets/test_generate.py` `test_the_example`
warpcam replay: `tests/datasets/test_replay.py` `test_the_command`
warpcam.train: `tests/train/test_cartpole.py` `test_the_module_is_the_command`
warpcam.benchmarks: `tests/benchmarks/test_benchmarks.py` `test_empty_caches_are_another_folder`
warpcam.benchmarks.compare_folders: `tests/benchmarks/test_compare_folders.py`
warpcam.benchmarks.corpus: `tests/sources/usd/test_usd_broken.py`
warpcam.benchmarks.conditions: `tests/benchmarks/test_conditions.py`
warpcam.benchmarks.datasets: `tests/benchmarks/test_dataset_rates.py`
warpcam.benchmarks.labels: `tests/benchmarks/test_label_costs.py`
warpcam.benchmarks.look_speed: `tests/benchmarks/test_look_speed.py` `test_the_command_draws_and_writes_results`
warpcam.benchmarks.looks: `tests/benchmarks/test_looks.py` `test_the_command_draws_a_scene_in_its_looks`
warpcam.benchmarks.ray_casts: `tests/compat/test_mjlab_ray_casts.py`
warpcam.benchmarks.training: `tests/benchmarks/test_training.py`
warpcam.benchmarks.training_table: `tests/benchmarks/test_training.py`
tests.fuzz: `tests/fuzz/test_fuzz.py`
tests.path.compare_looks: `tests/path/test_compare_looks.py` `test_the_table`
tests.other_projects: `tests/package/test_other_projects.py`
tests.sanitizers: `tests/sanitizers/test_sanitizers.py` `test_faults_of_cpu_kernels_are_found`
tests.soak: `tests/soak/test_soak.py` `test_frames_stay_as_a_new_renderer_draws_them`
torchrun: `tests/train/test_ranks.py` `test_two_processes_learn_the_same_weights_from_different_worlds`
"""
# Minutes on a CPU, or a GPU: each is parsed, and functions of it are tested (tests/benchmarks).
PARSED = {f"warpcam.benchmarks.{name}" for name in ("fidelity", "sensor_costs", "splats", "training_gpus")} | {"timeit"}
OTHERS = {"venv", "pip", "mkdocs", "mike", "apt-get"}


def program_of(command: list[str]) -> str:
    """What a command runs: a program, warpcam's command, or Python's module."""
    if command[0] == "warpcam":
        return " ".join(command[:2])
    return command[command.index("-m") + 1] if command[0].startswith("python") else command[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_are_those_of_their_programs(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in commands.commands_of(page.read_text()):
        try:
            commands.parse(command)
        except SystemExit as error:
            pytest.fail(f"{command}: {error} {capsys.readouterr().err}")
        except ModuleNotFoundError as error:
            if error.name not in OPTIONAL:
                raise


@pytest.mark.parametrize(
    "line",
    [
        "warpcam render --shape round",
        "warpcam paint scene.xml",
        "pip install 'warpcam[everything]'",
        "python -m warpcam.benchmarks.labels --wolrds 2",
        "torchrun --nproc-per-node 2 -m warpcam.train cartpole --iteration",
        'sbatch --wrap "warpcam dataset scene.xml --writer coco --cuont 1"',
    ],
)
def test_a_wrong_command_is_seen(line: str) -> None:
    (command,) = commands.commands_of(f"```sh\n{line}\n```\n")
    with pytest.raises(SystemExit) as error:
        commands.parse(command)
    assert error.value.code


def test_every_program_is_run_by_a_test() -> None:
    found = {program_of(command) for page in PAGES for command in commands.commands_of(page.read_text())}
    rows = dict(line.split(": ") for line in RUN.strip().splitlines())
    assert found - OTHERS - PARSED == rows.keys()
    assert missing(RUN) == []
    for program, tests in rows.items():
        name = program.split()[-1].rpartition(".")[2]
        file = re.findall(r"`(tests/\S+)`", tests)[0]
        assert name in (ROOT / file).read_text() or program == "torchrun", program


def smaller(command: list[str]) -> list[str]:
    """A command of ``warpcam render`` on a CPU, with one world and few pixels."""
    words = ["scene.xml" if word in ("SCENE", "FILE") else word for word in command[1:]]
    for name, value in (("--worlds", "1"), ("--size", "12x8")):
        if name in words:
            del words[words.index(name) : words.index(name) + 2]
        words += [name, value]
    return [*words, "--device", "cpu"]


def test_pictures_of_the_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.xml").write_text(MODEL)
    pages = "".join(page.read_text() for page in PAGES)
    asked = {tuple(smaller(each)) for each in commands.commands_of(pages) if program_of(each) == "warpcam render"}
    assert len(asked) >= 3
    for arguments in sorted(asked):
        assert cli.main(arguments) == 0
    with Image.open("warpcam-out/wrist-normals.png") as picture:
        assert picture.size == (12, 8)
    assert {"overview-rgb.png", "front-depth.png"} <= {path.name for path in Path("warpcam-out").iterdir()}


def test_programs_that_are_timed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of ``python -m timeit``, once, with fewer worlds and pixels."""
    monkeypatch.chdir(ROOT)
    timed = [each for page in PAGES for each in commands.commands_of(page.read_text()) if program_of(each) == "timeit"]
    assert timed
    for command in timed:
        setup, statement = command[command.index("-s") + 1 :]
        names: dict[str, object] = {}
        exec(setup.replace("nworld=4", "nworld=1").replace("128", "16"), names)
        exec(statement, names)
