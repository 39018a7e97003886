"""The page about Isaac Gym's calls names what there is."""

import re
from pathlib import Path

import pytest

import warpcam as wc

pytest.importorskip("newton")
from warpcam.compat.isaacgym import gymapi, gymtorch
from warpcam.compat.isaacgym.api.unsupported import UNSUPPORTED

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "compat" / "isaacgym.md").read_text()


def test_the_table_names_every_call_and_no_other() -> None:
    table = PAGE.split("## Calls")[1].split("Refused by name")[0]
    of_gymtorch = {"gymtorch", *gymtorch.__all__}
    named = set(re.findall(r"`([a-z_]+)`", table)) - of_gymtorch - {"_indexed"}
    calls = {name for name in dir(gymapi.Gym) if not name.startswith("_")}
    assert named == calls
    assert all(f"`{name}`" in table for name in gymtorch.__all__)
    assert not calls & set(UNSUPPORTED)


def test_refused_calls_that_the_page_names_are_refused() -> None:
    refused = PAGE.split("Refused by name")[1]
    named = set(re.findall(r"`([a-z_]+)`", refused))
    assert len(named) > 8 and named <= set(UNSUPPORTED)


def test_every_name_of_gymapi_is_there() -> None:
    for name in gymapi.__all__:
        assert getattr(gymapi, name) is not None


def test_what_is_held_can_be_filled_in() -> None:
    """Fill in parameters as programs do before they load an asset."""
    options = gymapi.AssetOptions()
    options.mesh_normal_mode = gymapi.COMPUTE_PER_VERTEX
    options.vhacd_enabled = True
    options.vhacd_params.resolution = 300000
    options.vhacd_params = gymapi.VhacdParams()
    options.vhacd_params.max_convex_hulls = 512
    assert gymapi.AssetOptions().vhacd_params.max_convex_hulls == 1024
    params = gymapi.SimParams()
    params.physx.contact_collection = gymapi.ContactCollection(1)
    assert params.physx.contact_collection is gymapi.CC_LAST_SUBSTEP
    with pytest.raises(wc.WarpcamError, match="VhacdParams has no 'hulls'"):
        options.vhacd_params.hulls = 3
