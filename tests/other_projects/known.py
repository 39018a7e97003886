"""Tests of other projects that fail with a front end in place, by a pattern of ``Class.test``, and why they do."""

from collections.abc import Mapping

MUJOCO: Mapping[str, str] = {}
MUJOCO_WARP: Mapping[str, str] = {}
NEWTON: Mapping[str, str] = {}
DM_CONTROL: Mapping[str, str] = {}
GYMNASIUM: Mapping[str, str] = {}
