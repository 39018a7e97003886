"""Forces in Isaac Gym's front end: of contacts, at sensors and along joints, and what turns the latter into motion."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def add_contacts(
    counts: wp.array(dtype=wp.int32),  # (1,)
    geoms: wp.array(dtype=wp.vec2i),  # (contact,)
    worlds: wp.array(dtype=wp.int32),  # (contact,)
    places: wp.array(dtype=wp.vec3),  # (contact,)
    forces: wp.array(dtype=wp.spatial_vector),  # (contact,) on the second geom, in its world's frame
    shapes: wp.array2d(dtype=wp.int32),  # (world, geom)
    bodies: wp.array(dtype=wp.int32),  # (shape,)
    felt: wp.array2d(dtype=wp.float32),  # (body, 6) force and its moment about the origin
):
    contact = wp.tid()
    if contact >= counts[0]:
        return
    force = wp.spatial_top(forces[contact])
    moment = wp.cross(places[contact], force)
    for side in range(2):
        geom = geoms[contact][side]
        body = wp.int32(-1)
        if geom >= 0:
            shape = shapes[worlds[contact], geom]
            if shape >= 0:
                body = bodies[shape]
        if body >= 0:
            sign = float(2 * side - 1)
            for axis in range(3):
                wp.atomic_add(felt, body, axis, sign * force[axis])
                wp.atomic_add(felt, body, 3 + axis, sign * moment[axis])


@wp.kernel(enable_backward=False)
def read_forces(
    felt: wp.array2d(dtype=wp.float32),  # (model's body, 6)
    bodies: wp.array(dtype=wp.int32),  # (body,)
    forces: wp.array2d(dtype=wp.float32),  # (body, 3)
):
    row, axis = wp.tid()
    forces[row, axis] = felt[bodies[row], axis]


@wp.kernel(enable_backward=False)
def read_sensors(
    felt: wp.array2d(dtype=wp.float32),  # (model's body, 6)
    poses: wp.array(dtype=wp.transform),  # (model's body,)
    bodies: wp.array(dtype=wp.int32),  # (sensor,) -1 for one that feels nothing
    places: wp.array(dtype=wp.transform),  # (sensor,) in the body's frame
    level: wp.array(dtype=wp.int32),  # (sensor,) 1: along the world's axes
    readings: wp.array2d(dtype=wp.float32),  # (sensor, 6)
):
    sensor = wp.tid()
    body = bodies[sensor]
    force = wp.vec3()
    torque = wp.vec3()
    if body >= 0:
        pose = poses[body] * places[sensor]
        force = wp.vec3(felt[body, 0], felt[body, 1], felt[body, 2])
        torque = wp.vec3(felt[body, 3], felt[body, 4], felt[body, 5])
        torque = torque - wp.cross(wp.transform_get_translation(pose), force)
        if level[sensor] == 0:
            back = wp.quat_inverse(wp.transform_get_rotation(pose))
            force = wp.quat_rotate(back, force)
            torque = wp.quat_rotate(back, torque)
    for axis in range(3):
        readings[sensor, axis] = force[axis]
        readings[sensor, 3 + axis] = torque[axis]


@wp.kernel(enable_backward=False)
def read_efforts(
    driven: wp.array2d(dtype=wp.float32),  # (world, speed) by drives
    applied: wp.array2d(dtype=wp.float32),  # (world, speed) by programs
    worlds: wp.array(dtype=wp.int32),  # (dof,)
    places: wp.array(dtype=wp.int32),  # (dof,) speed of each
    efforts: wp.array(dtype=wp.float32),  # (dof,)
):
    dof = wp.tid()
    world = worlds[dof]
    place = places[dof]
    efforts[dof] = driven[world, place] + applied[world, place]


@wp.kernel(enable_backward=False)
def gather_jacobians(
    full: wp.array3d(dtype=wp.float32),  # (articulation, 6 joint, speed)
    articulations: wp.array(dtype=wp.int32),  # (actor,)
    joints: wp.array(dtype=wp.int32),  # (link,)
    out: wp.array4d(dtype=wp.float32),  # (actor, link, 6, speed)
):
    actor, link, row, speed = wp.tid()
    out[actor, link, row, speed] = full[articulations[actor], 6 * joints[link] + row, speed]


@wp.kernel(enable_backward=False)
def gather_masses(
    full: wp.array3d(dtype=wp.float32),  # (articulation, speed, speed)
    articulations: wp.array(dtype=wp.int32),  # (actor,)
    out: wp.array3d(dtype=wp.float32),  # (actor, speed, speed)
):
    actor, row, column = wp.tid()
    out[actor, row, column] = full[articulations[actor], row, column]


ENVIRONMENT = 0  # spaces that pushes are given in
LOCAL = 1  # each body's own frame
GLOBAL = 2  # the frame that all environments share


@wp.kernel(enable_backward=False)
def add_pushes(
    poses: wp.array(dtype=wp.transform),
    centres: wp.array(dtype=wp.vec3),  # (model's body,) of mass, in its frame
    bodies: wp.array(dtype=wp.int32),  # (row,)
    origins: wp.array(dtype=wp.vec3),  # (model's body,) of its environment's frame in that of all
    forces: wp.array2d(dtype=wp.float32),  # (row, 3)
    torques: wp.array2d(dtype=wp.float32),  # (row, 3)
    places: wp.array2d(dtype=wp.float32),  # (row, 3) where forces act, or (0, 3): at the centres
    space: wp.int32,
    pushes: wp.array(dtype=wp.spatial_vector),  # (model's body,) about its centre, along the world's axes
):
    row = wp.tid()
    body = bodies[row]
    pose = poses[body]
    force = wp.vec3(forces[row, 0], forces[row, 1], forces[row, 2])
    torque = wp.vec3(torques[row, 0], torques[row, 1], torques[row, 2])
    if space == LOCAL:
        force = wp.transform_vector(pose, force)
        torque = wp.transform_vector(pose, torque)
    if places.shape[0] > 0:
        place = wp.vec3(places[row, 0], places[row, 1], places[row, 2])
        if space == LOCAL:
            place = wp.transform_point(pose, place)
        elif space == GLOBAL:
            place = place - origins[body]
        torque = torque + wp.cross(place - wp.transform_point(pose, centres[body]), force)
    pushes[body] = pushes[body] + wp.spatial_vector(force, torque)
