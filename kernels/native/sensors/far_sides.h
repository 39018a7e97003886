// Rays that begin within a solid shape meet its far side, as MuJoCo's rays do; cameras see out of shapes.
#pragma once
#include "geometry/intersect_exit.h"
#include "geometry/shape_state.h"

namespace warpcam {

constexpr int EXIT_RUN = 32;  // rays of a thread; warpcam/sensors/kernels/far_sides.py has the same

// A shape that rays leave by an exit, as those in its own frame are tested against it.
struct SolidShape {
    Shape shape;
    Vec3 scale;  // to the unit frame [1/m]
    ShapeRecord record;  // its size row alone
    float radius;  // of a ball about its position that holds it [m]; below 0: it is no such shape
};

template <class Shapes> WARPCAM_DEVICE SolidShape load_solid(const Shapes& shapes, int world, int id)
{
    SolidShape solid;
    solid.shape = load_shape(shapes, world, id);
    solid.radius = -1.0f;
    visit_shape<TYPES_WITH_EXIT>(solid.shape.type, [&](auto traits) {
        const Vec3 size = solid.shape.size, half = traits.half_extents(size);
        if (!traits.is_valid(size, half))
            return;
        solid.scale = traits.unit_scale(size, half);
        const Vec3 unit = traits.unit_size(size, solid.scale);
        solid.record.size = { unit.x, unit.y, unit.z, 0 };
        solid.radius = sqrt(dot(half, half));
    });
    return solid;
}

struct ExitHit {
    float distance;  // MISS: the ray does not begin within the shape [m]
    Vec3 normal;  // outwards, world frame
};

// Exit of a ray, in the world frame, from the shape that it begins in.
WARPCAM_DEVICE ExitHit exit_of(const SolidShape& solid, Vec3 start, Vec3 direction)
{
    const Mat3& turn = solid.shape.rotation;
    const Vec3 local = transform_transposed(turn, start - solid.shape.position);
    const Vec3 along = transform_transposed(turn, direction);
    ExitHit exit { MISS, {} };
    visit_shape<TYPES_WITH_EXIT>(solid.shape.type, [&](auto traits) {
        const Vec3 o = mul(local, solid.scale), d = mul(along, solid.scale);
        const float enter = traits.intersect(solid.record.size, o, d);
        const float leave = intersect_exit(traits, solid.record, o, d);
        if (enter <= 0.0f && leave > 0.0f && leave < MISS) {
            exit.distance = leave;
            exit.normal = transform(turn, traits.surface(solid.shape.size, -along, local + leave * along).normal);
        }
    });
    return exit;
}

// Put exits in place of what rays meet behind them; a thread for each run of rays of each world. Images of rays may be
// upside down, see ScanRays.
template <class Shapes, class Materials, class Rays, class Poses, class Traced>
WARPCAM_DEVICE void meet_far_sides(const wp::array_t<uint8_t>& mask, const Shapes& shapes, const Materials& materials,
                                   const Rays& rays, const Poses& poses, const Traced& traced, int index)
{
    const int count = rays.rows * rays.columns, runs = (count + EXIT_RUN - 1) / EXIT_RUN;
    const int world = index / runs, first = index % runs * EXIT_RUN, end = min(first + EXIT_RUN, count);
    if (!wp::index(mask, world))
        return;
    const Vec3 position = as_vec3(wp::index(poses.positions, world));
    const auto turn = wp::index(poses.rotations, world);
    const bool apart = rays.origins.shape[0] > 0;
    const auto start_of = [&](int ray) {
        return apart ? position + as_vec3(wp::quat_rotate(turn, wp::index(rays.origins, ray))) : position;
    };
    const Vec3 middle = start_of((first + end) / 2);
    float reach = 0.0f;
    for (int ray = first; apart && ray < end; ++ray) {
        const Vec3 off = start_of(ray) - middle;
        reach = max(reach, dot(off, off));
    }
    reach = sqrt(reach);
    for (int k = 0; k < shapes.drawn.shape[0]; ++k) {
        const int id = wp::index(shapes.drawn, k);
        const SolidShape solid = load_solid(shapes, world, id);
        const Vec3 off = solid.shape.position - middle;
        const float near = solid.radius + reach;
        if (solid.radius < 0.0f || !(dot(off, off) <= near * near) || transparent(shapes, materials, world, id))
            continue;
        for (int ray = first; ray < end; ++ray) {
            const int row = ray / rays.columns;
            const int pixel = rays.flipped ? ray + (rays.rows - 1 - 2 * row) * rays.columns : ray;
            float& distance = *wp::address(traced.distance, world, pixel);
            const Vec3 direction = as_vec3(wp::quat_rotate(turn, wp::index(rays.directions, ray)));
            const ExitHit exit = exit_of(solid, start_of(ray), direction);
            if (!(exit.distance < min(distance, MISS)))
                continue;
            distance = exit.distance;
            if (traced.shapes.shape[0] > 0)
                *wp::address(traced.shapes, world, pixel) =
                    shapes.ids.shape[0] > 0 ? wp::index(shapes.ids, world, id) : id;
            if (traced.bodies.shape[0] > 0)
                *wp::address(traced.bodies, world, pixel) =
                    shapes.body_ids.shape[0] > 0 ? wp::index(shapes.body_ids, world, id) : wp::index(shapes.bodies, id);
            if (traced.normals.shape[0] > 0)
                for (int c = 0; c < 3; ++c)
                    *wp::address(traced.normals, world, pixel, c) = component(exit.normal, c);
        }
    }
}

}  // namespace warpcam
