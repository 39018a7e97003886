"""Generation of labelled images: a plan, its shards, and workers that make them."""

from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.recipes import Recipes, read_recipes
from warpcam.datasets.generate.run import merge_shards, missing_shards, prepare, run_shard
from warpcam.datasets.generate.shards import ShardFolder
from warpcam.datasets.generate.workers import generate
from warpcam.datasets.generate.worlds import Worlds

__all__ = [
    "Plan",
    "Recipes",
    "ShardFolder",
    "Worlds",
    "generate",
    "merge_shards",
    "missing_shards",
    "prepare",
    "read_recipes",
    "run_shard",
]
