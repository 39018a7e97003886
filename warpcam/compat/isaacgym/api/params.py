"""Parameters that Isaac Gym's programs fill in before they call: each with that system's defaults.

Of what concerns physics alone, a part is only held: docs/compat/isaacgym.md says what counts.
"""

from dataclasses import dataclass, field

from warpcam.compat.isaacgym.api.enums import ContactCollection, DofDriveMode, MeshNormalMode, UpAxis
from warpcam.compat.isaacgym.api.math_types import Transform, Vec3
from warpcam.core.errors import WarpcamError


class Strict:
    """Only what there is can be set: a misspelt name is an error, not silence."""

    def __setattr__(self, name: str, value: object) -> None:
        known = type(self).__dataclass_fields__  # type: ignore[attr-defined]
        if name not in known:
            raise WarpcamError(f"{type(self).__name__} has no {name!r}; it has {', '.join(known)}")
        super().__setattr__(name, value)


@dataclass
class CameraProperties(Strict):
    """Parameters of a camera.

    Attributes:
        width: Of the image [pixels].
        height: Of the image [pixels].
        horizontal_fov: Of the whole width [degrees]; pixels are square.
        near_plane: Nothing nearer is seen: planar depth [m].
        far_plane: Nothing farther is seen: planar depth [m].
        supersampling_horizontal: Samples across a pixel: 1, or 2 for smooth edges of colours, or 4 or 8.
        supersampling_vertical: Samples down a pixel: as many, or 2 with 4 across.
        use_collision_geometry: What collides is seen instead of what is to be seen.
        enable_tensors: Whether images may be had as tensors on the device; here on every device.
        shadows: Whether lights cast shadows. Not of Isaac Gym.
    """

    width: int = 1600
    height: int = 900
    horizontal_fov: float = 90.0
    near_plane: float = 0.001
    far_plane: float = 2000000.0
    supersampling_horizontal: int = 1
    supersampling_vertical: int = 1
    use_collision_geometry: bool = False
    enable_tensors: bool = False
    shadows: bool = False


@dataclass
class PhysXParams(Strict):
    """Held, but for ``use_gpu``."""

    use_gpu: bool = False
    num_threads: int = 0
    num_subscenes: int = 0
    solver_type: int = 1
    num_position_iterations: int = 4
    num_velocity_iterations: int = 1
    contact_offset: float = 0.02
    rest_offset: float = 0.001
    bounce_threshold_velocity: float = 0.2
    max_depenetration_velocity: float = 100.0
    max_gpu_contact_pairs: int = 1048576
    default_buffer_size_multiplier: float = 2.0
    friction_offset_threshold: float = 0.04
    friction_correlation_distance: float = 0.025
    contact_collection: int = ContactCollection.CC_ALL_SUBSTEPS
    always_use_articulations: bool = False


@dataclass
class Version(Strict):
    """A version of Isaac Gym."""

    major: int = 0
    minor: int = 0


@dataclass
class FlexParams(Strict):
    """Held."""

    solver_type: int = 5
    num_outer_iterations: int = 10
    num_inner_iterations: int = 200
    relaxation: float = 0.75
    warm_start: float = 0.4
    shape_collision_distance: float = 0.1
    shape_collision_margin: float = 0.1
    contact_regularization: float = 1e-6
    deterministic_mode: bool = False
    friction_mode: int = 1
    geometric_stiffness: float = 1.0
    max_rigid_contacts: int = 1048576
    max_soft_contacts: int = 1048576
    dynamic_friction: float = 0.35
    static_friction: float = 0.35
    particle_friction: float = 0.35
    return_contacts: bool = True


@dataclass
class SimParams(Strict):
    """Parameters of a simulation.

    Attributes:
        dt: Of one call of ``simulate`` [s].
        substeps: Each is cut into these.
        gravity: [m/s^2].
        up_axis: It decides which way a camera looks, see ``set_camera_transform``.
        use_gpu_pipeline: Whether state tensors are on the GPU.
        num_client_threads: Held.
        stress_visualization: Held, and so are ``stress_visualization_min`` and ``stress_visualization_max``.
        enable_actor_creation_warning: Held.
        physx: Held, but for ``use_gpu``.
        flex: Held.
    """

    dt: float = 1.0 / 60.0
    substeps: int = 2
    gravity: Vec3 = field(default_factory=lambda: Vec3(0.0, -9.8, 0.0))
    up_axis: UpAxis = UpAxis.UP_AXIS_Y
    use_gpu_pipeline: bool = False
    num_client_threads: int = 0
    stress_visualization: bool = False
    stress_visualization_min: float = 0.0
    stress_visualization_max: float = 1.0e5
    enable_actor_creation_warning: bool = True
    physx: PhysXParams = field(default_factory=PhysXParams)
    flex: FlexParams = field(default_factory=FlexParams)


@dataclass
class PlaneParams(Strict):
    """Parameters of the ground plane: the points p with normal . p + distance = 0."""

    normal: Vec3 = field(default_factory=lambda: Vec3(0.0, 1.0, 0.0))
    distance: float = 0.0
    static_friction: float = 1.0
    dynamic_friction: float = 1.0
    restitution: float = 0.0
    segmentation_id: int = 0


@dataclass
class TriangleMeshParams(Strict):
    """Parameters of a terrain of triangles."""

    nb_vertices: int = 0
    nb_triangles: int = 0
    transform: Transform = field(default_factory=Transform)
    static_friction: float = 1.0
    dynamic_friction: float = 1.0
    restitution: float = 0.0
    segmentation_id: int = 0


@dataclass
class HeightFieldParams(Strict):
    """Parameters of a terrain of heights, see ``add_heightfield``.

    Attributes:
        row_scale: From one row to the next [m].
        column_scale: From one column to the next [m].
        vertical_scale: What a height of 1 is [m].
        nbRows: How many rows.
        nbColumns: How many columns.
        transform: Where its first sample stands, and how it is turned.
        static_friction: Held.
        dynamic_friction: Where something slides on it.
        restitution: Held.
        segmentation_id: In segmentation images.
    """

    row_scale: float = 1.0
    column_scale: float = 1.0
    vertical_scale: float = 1.0
    nbRows: int = 0  # noqa: N815, that system's name
    nbColumns: int = 0  # noqa: N815
    transform: Transform = field(default_factory=Transform)
    static_friction: float = 1.0
    dynamic_friction: float = 1.0
    restitution: float = 0.0
    segmentation_id: int = 0


@dataclass
class VhacdParams(Strict):
    """Parameters of a decomposition into convex parts. Held: there is none."""

    resolution: int = 100000
    concavity: float = 0.001
    plane_downsampling: int = 4
    convex_hull_downsampling: int = 4
    alpha: float = 0.05
    beta: float = 0.05
    pca: int = 0
    mode: int = 0
    max_num_vertices_per_ch: int = 64
    min_volume_per_ch: float = 0.0001
    max_convex_hulls: int = 1024
    convex_hull_approximation: bool = True
    project_hull_vertices: bool = True
    ocl_acceleration: bool = False


@dataclass
class AssetOptions(Strict):
    """Options of the import of an asset file.

    Attributes:
        fix_base_link: Whether its first body is fixed where the actor is created.
        collapse_fixed_joints: Whether bodies that are fixed to one another become one.
        disable_gravity: Whether gravity passes its bodies over.
        density: Of created shapes, and of bodies whose mass is not in the file [kg/m^3].
        armature: Added to all joints.
        default_dof_drive_mode: What drives its degrees of freedom, unless told otherwise.
        flip_visual_attachments: Whether y is up in the files of meshes that a URDF file shows, but of .dae files.
    """

    fix_base_link: bool = False
    collapse_fixed_joints: bool = False
    disable_gravity: bool = False
    density: float = 1000.0
    armature: float = 0.0
    default_dof_drive_mode: int = DofDriveMode.DOF_MODE_NONE
    thickness: float = 0.02
    linear_damping: float = 0.0
    angular_damping: float = 0.5
    max_linear_velocity: float = 1000.0
    max_angular_velocity: float = 64.0
    flip_visual_attachments: bool = False
    replace_cylinder_with_capsule: bool = False
    slices_per_cylinder: int = 20
    min_particle_mass: float = 1e-12
    tendon_limit_stiffness: float = 0.0
    use_mesh_materials: bool = False
    mesh_normal_mode: int = MeshNormalMode.FROM_ASSET
    use_physx_armature: bool = True
    override_com: bool = False
    override_inertia: bool = False
    vhacd_enabled: bool = False
    vhacd_params: VhacdParams = field(default_factory=VhacdParams)
    enable_gyroscopic_forces: bool = True
    convex_decomposition_from_submeshes: bool = False
