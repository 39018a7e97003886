"""Assets: what actors are made of, read by Newton's importers."""

import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.common.scalars import real
from warpcam.compat.isaacgym.api.enums import DOF_PROPERTIES, DOF_STATE, DofDriveMode, DofType
from warpcam.compat.isaacgym.api.math_types import Transform
from warpcam.compat.isaacgym.api.params import AssetOptions
from warpcam.compat.isaacgym.api.property_types import ForceSensorProperties, TendonProperties, masses_of, surfaces_of
from warpcam.compat.isaacgym.assets.merge_fixed_joints import Builder
from warpcam.compat.isaacgym.assets.mjcf import MjcfDetails
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.optional import import_source

JOINT = newton.JointType
MODE = newton.JointTargetMode
DRIVES = {
    MODE.NONE: DofDriveMode.DOF_MODE_NONE,
    MODE.POSITION: DofDriveMode.DOF_MODE_POS,
    MODE.VELOCITY: DofDriveMode.DOF_MODE_VEL,
    MODE.POSITION_VELOCITY: DofDriveMode.DOF_MODE_POS,
    MODE.EFFORT: DofDriveMode.DOF_MODE_EFFORT,
}
ENDLESS = 1e6  # limits beyond are none


@dataclass(frozen=True)
class Dof:
    """One degree of freedom.

    Attributes:
        coordinate: Its place among the asset's joint positions.
        speed: Its place among the asset's joint velocities.
    """

    name: str
    kind: DofType
    coordinate: int
    speed: int


class Asset:
    """Template of actors.

    Attributes:
        builder: Holds one of it, its first body at the origin.
        bodies: Names.
        shapes: (shape,) int32, the body of each, or -1.
        solid: Places of those that collide, body by body: rigid shapes are these alone, in this order.
        free: Whether its first body is free to move.
        properties: (dof,) of ``DOF_PROPERTIES``, as the file has them.
        rest: (dof,) of ``DOF_STATE``, where its joints begin.
        surfaces: (shape,) of ``SURFACE``, of actors that are made from now on.
        masses: (body,) of ``MASS``.
        joints: Names, without what a base is held by or floats with.
        extras: Motors and tendons of its file.
        tendons: Properties, where they are others than the file's.
        sensors: Force sensors: body, pose in its frame, properties.
    """

    def __init__(
        self,
        name: str,
        builder: newton.ModelBuilder,
        options: AssetOptions,
        joints: dict[str, list[str]],
        path: Path | None = None,
    ):
        self.name, self.builder, self.options = name, builder, replace(options)
        self.bodies = [_last(label) for label in builder.body_label]
        if not self.bodies:
            raise WarpcamError(f"load_asset: {name!r} has no bodies; at least one is needed")
        self.shapes = np.asarray(builder.shape_body, np.int32)
        solid = np.flatnonzero(np.asarray(builder.shape_flags, np.int64) & int(newton.ShapeFlags.COLLIDE_SHAPES))
        # Of bodies that were made one, shapes do not follow one another.
        self.solid = solid[np.argsort(self.shapes[solid], kind="stable")]
        self.free = builder.joint_type[0] == JOINT.FREE
        labels = [_last(label) for label in builder.joint_label]
        self.joints = labels[1:] if builder.joint_type[0] in (JOINT.FREE, JOINT.FIXED) else labels
        self.dofs = self._read_dofs(labels, joints)
        self.properties = self._read_properties()
        self.rest = np.zeros(len(self.dofs), DOF_STATE)
        self.rest["pos"] = [float(builder.joint_q[dof.coordinate]) for dof in self.dofs]
        self.surfaces, self.masses = surfaces_of(builder), masses_of(builder, bool(options.disable_gravity))
        self.first_surfaces = self.surfaces  # what the builder says
        self.sensors: list[tuple[int, Transform, ForceSensorProperties]] = []
        self.extras = MjcfDetails(path)
        self.tendons: list[TendonProperties] | None = None
        self._model: newton.Model | None = None
        self.colors = np.array([tuple(color) for color in builder.shape_color], np.float32).reshape(-1, 3)

    def shapes_of(self, body: int, flags: int) -> np.ndarray:
        """Places of the body's shapes that have any of the flags."""
        kinds = np.asarray(self.builder.shape_flags, np.int64)
        return np.flatnonzero((self.shapes == body) & ((kinds & flags) != 0))

    def bodies_at(self, states: np.ndarray) -> np.ndarray:
        """Its bodies with its joints there, on the host, its first body at the origin.

        Args:
            states: (dof,) of ``DOF_STATE``.

        Returns:
            (body, 13): position [m], quaternion x y z w, velocities.
        """
        if self._model is None:
            self._model = self.builder.finalize(device="cpu", skip_all_validations=True)
        state = self._model.state()
        state.joint_q.numpy()[[dof.coordinate for dof in self.dofs]] = states["pos"]
        state.joint_qd.numpy()[[dof.speed for dof in self.dofs]] = states["vel"]
        newton.eval_fk(self._model, state.joint_q, state.joint_qd, state)
        return np.concatenate((state.body_q.numpy(), state.body_qd.numpy()), axis=1)

    def _read_dofs(self, labels: list[str], joints: dict[str, list[str]]) -> list[Dof]:
        builder, dofs = self.builder, []
        for index, kind in enumerate(builder.joint_type):
            if kind in (JOINT.FREE, JOINT.FIXED):
                continue
            label = labels[index]
            if kind not in (JOINT.REVOLUTE, JOINT.PRISMATIC, JOINT.D6):
                raise WarpcamError(
                    f"load_asset: {self.name!r}: joint {label!r} is a {JOINT(kind).name}; allowed are hinges, slides "
                    "and what is made of them"
                )
            linear, angular = builder.joint_dof_dim[index]
            count = linear + angular
            names = [label] if count == 1 else joints.get(label, [f"{label}:{i}" for i in range(count)])
            for i in range(count):
                turns = i >= linear
                dofs.append(
                    Dof(
                        names[i],
                        DofType.DOF_ROTATION if turns else DofType.DOF_TRANSLATION,
                        int(builder.joint_q_start[index]) + i,
                        int(builder.joint_qd_start[index]) + i,
                    )
                )
        return dofs

    def _read_properties(self) -> np.ndarray:
        rows, builder = np.zeros(len(self.dofs), DOF_PROPERTIES), self.builder
        speeds = [dof.speed for dof in self.dofs]
        for name, values in (
            ("lower", builder.joint_limit_lower),
            ("upper", builder.joint_limit_upper),
            ("stiffness", builder.joint_target_ke),
            ("damping", builder.joint_target_kd),
            ("velocity", builder.joint_velocity_limit),
            ("effort", builder.joint_effort_limit),
            ("friction", builder.joint_friction),
            ("armature", builder.joint_armature),
        ):
            rows[name] = [float(values[speed]) for speed in speeds]
        rows["driveMode"] = [DRIVES[MODE(builder.joint_target_mode[speed])] for speed in speeds]
        if self.options.default_dof_drive_mode:
            rows["driveMode"] = self.options.default_dof_drive_mode
        rows["armature"] += self.options.armature
        rows["hasLimits"] = (rows["lower"] > -ENDLESS) & (rows["upper"] < ENDLESS)
        return rows


def load(root: Any, file: Any, options: AssetOptions, up: newton.Axis) -> Asset:
    """Read .urdf, .xml or .mjcf, .usd, .usda, .usdc or .usdz."""
    try:
        path = Path(os.fspath(root)) / os.fspath(file)
    except TypeError:
        raise WarpcamError(f"load_asset: a folder and a file in it are needed, got {root!r} and {file!r}") from None
    if not path.is_file():
        raise WarpcamError(f"load_asset: there is no file {str(path)!r}")
    # An asset's frame is taken as it is, whichever way the world's up is.
    builder = Builder(up_axis=newton.Axis.Z)
    builder.default_shape_cfg.density = _density(options, "load_asset")
    readers: dict[str, Callable[[], Any]] = {
        ".urdf": lambda: import_source("newton.urdf", "meshes").add_urdf(
            lambda text: builder.add_urdf(text, floating=not options.fix_base_link),
            builder,
            path,
            FileAccess(path, trusted=True),  # the program names the asset, as for Newton's own readers
            standing=bool(options.flip_visual_attachments),
            in_order=True,  # so Isaac Gym goes through those of a body, each with all below it
        ),
        ".xml": lambda: builder.add_mjcf(str(path), floating=False if options.fix_base_link else None),
        ".usd": lambda: builder.add_usd(str(path), floating=False if options.fix_base_link else None),
    }
    kind = path.suffix.lower()
    kind = ".xml" if kind == ".mjcf" else ".usd" if kind.startswith(".usd") else kind
    if kind not in readers:
        raise WarpcamError(f"load_asset: {path.name!r} came; allowed are .urdf, .xml, .mjcf and .usd files")
    try:
        readers[kind]()
        if kind == ".urdf":
            builder.joint_target_mode[:] = [int(MODE.NONE)] * len(builder.joint_target_mode)  # the file names no drives
        if options.collapse_fixed_joints:
            _collapse(builder, _held(path) if kind == ".urdf" else set())
    except WarpcamError:
        raise
    except Exception as error:
        raise WarpcamError(f"load_asset: {str(path)!r} cannot be read: {type(error).__name__}: {error}") from error
    _settle(builder, options, up)
    return Asset(path.stem, builder, options, _joint_names(path) if kind == ".xml" else {}, path)


def made(
    name: str, options: AssetOptions, up: newton.Axis, add: Callable[[newton.ModelBuilder, int, Any], Any]
) -> Asset:
    """An asset of one body with one shape, which ``add`` adds."""
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    if options.fix_base_link:
        body = builder.add_link(label=name)
        builder.add_articulation([builder.add_joint_fixed(-1, body, label="fixed")], label=name)
    else:
        body = builder.add_body(label=name)
    add(builder, body, newton.ModelBuilder.ShapeConfig(density=_density(options, f"create_{name}")))
    _settle(builder, options, up)
    return Asset(name, builder, options, {})


def _density(options: AssetOptions, where: str) -> float:
    density = real(options.density)
    if not 0.0 <= density < math.inf:
        raise WarpcamError(f"{where}: AssetOptions.density must be finite and not negative, got {options.density!r}")
    return density


def _held(path: Path) -> set[str]:
    """Names of the joints of a URDF file that are not to be collapsed."""
    joints = ElementTree.parse(path).iter("joint")
    return {joint.get("name", "") for joint in joints if joint.get("dont_collapse", "").lower() == "true"}


def _collapse(builder: Builder, held: set[str]) -> None:
    """Make bodies that are fixed to one another one, but where their joint is held."""
    kept = [joint for joint, label in enumerate(builder.joint_label) if _last(label) in held]
    builder.collapse_fixed_joints(joints_to_keep=kept)


def _settle(builder: newton.ModelBuilder, options: AssetOptions, up: newton.Axis) -> None:
    """Make it ready to be put into a world, its first body at the origin."""
    builder.up_axis = up
    if builder.joint_count and builder.joint_type[0] == JOINT.FREE:
        first = int(builder.joint_q_start[0])
        builder.joint_q[first : first + 7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    if builder.joint_count and builder.joint_type[0] == JOINT.FIXED:
        builder.joint_X_p[0] = wp.transform_identity()


def _joint_names(path: Path) -> dict[str, list[str]]:
    """Names of the joints of each body of an MJCF file, by the name that Newton gives them together."""
    try:
        tree = ElementTree.parse(path)
    except (ElementTree.ParseError, LookupError, ValueError):  # no XML, or of an encoding that Python does not read
        return {}
    bodies = [[joint.get("name", "") for joint in body.findall("joint")] for body in tree.iter("body")]
    return {"_".join(names): names for names in bodies if len(names) > 1}


def _last(label: str) -> str:
    return label.rsplit("/", 1)[-1]
