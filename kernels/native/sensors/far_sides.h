// Rays that begin within a solid shape meet its far side, as MuJoCo's rays do; cameras see out of shapes. On CUDA a warp
// works on a run of rays: its lanes look at a shape each, and then at a ray each of those that may begin in a shape.
#pragma once
#include "core/warp.h"
#include "geometry/intersect_exit.h"
#include "geometry/shape_state.h"

namespace warpcam {

// A shape that rays leave by an exit, as those in its own frame are tested against it.
struct SolidShape {
    Shape shape;
    Vec3 scale;  // to the unit frame [1/m]
    ShapeRecord record;  // its size row alone
    Vec3 half;  // half extents of its box [m]; below 0: it is no such shape
};

template <class Shapes> WARPCAM_DEVICE SolidShape load_solid(const Shapes& shapes, int world, int id)
{
    SolidShape solid;
    solid.shape = load_shape(shapes, world, id);
    solid.half = { -1.0f, -1.0f, -1.0f };
    visit_shape<TYPES_WITH_EXIT>(solid.shape.type, [&](auto traits) {
        const Vec3 size = solid.shape.size, half = traits.half_extents(size);
        if (!traits.is_valid(size, half))
            return;
        solid.half = half;
        solid.scale = traits.unit_scale(size, half);
        const Vec3 unit = traits.unit_size(size, solid.scale);
        solid.record.size = { unit.x, unit.y, unit.z, 0 };
    });
    return solid;
}

struct ExitHit {
    float distance;  // MISS: the ray does not begin within the shape [m]
    Vec3 normal;  // outwards, world frame
};

// Exit of a ray, in the world frame, from the shape that it begins in. `direction` is called if it may begin there.
template <class Direction>
WARPCAM_DEVICE ExitHit exit_of(const SolidShape& solid, Vec3 start, const Direction& direction)
{
    const Mat3& turn = solid.shape.rotation;
    const Vec3 local = transform_transposed(turn, start - solid.shape.position);
    ExitHit exit { MISS, {} };
    if (abs(local.x) > solid.half.x || abs(local.y) > solid.half.y || abs(local.z) > solid.half.z)
        return exit;
    const Vec3 along = transform_transposed(turn, direction());
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

// Rays of a lidar in one world. Images of rays may be upside down, see ScanRays.
template <class Rays, class Poses> struct RaysOfLidar {
    const Rays& rays;
    const Poses& poses;
    int world;

    WARPCAM_DEVICE Vec3 turned(Vec3 v) const
    {
        const wp::vec3 local { v.x, v.y, v.z };
        return as_vec3(wp::quat_rotate(wp::index(poses.rotations, world), local));
    }
    WARPCAM_DEVICE Vec3 start(int ray) const
    {
        const Vec3 position = as_vec3(wp::index(poses.positions, world));
        return rays.origins.shape[0] > 0 ? position + turned(as_vec3(wp::index(rays.origins, ray))) : position;
    }
    WARPCAM_DEVICE Vec3 direction(int ray) const { return turned(as_vec3(wp::index(rays.directions, ray))); }
    WARPCAM_DEVICE int pixel(int ray) const
    {
        return rays.flipped ? ray + (rays.rows - 1 - 2 * (ray / rays.columns)) * rays.columns : ray;
    }
};

// Rays of a camera at the world's origin: of its table, see camera/ray_table.h, the rows of pixels.
struct RaysOfTable {
    const float* rows;

    WARPCAM_DEVICE Vec3 start(int ray) const { return as_vec3(rows + 8 * size_t(ray)); }
    WARPCAM_DEVICE Vec3 direction(int ray) const { return as_vec3(rows + 8 * size_t(ray) + 4); }
    WARPCAM_DEVICE int pixel(int ray) const { return ray; }
};

#if defined(__CUDA_ARCH__)
constexpr int EXIT_LANES = WARP_SIZE;
#else
constexpr int EXIT_LANES = 1;
#endif

// Runs of so many rays in the order of worlds; so many lanes for each.
struct ExitRun {
    int world, first, end, lane;
};

WARPCAM_DEVICE ExitRun exit_run(int count, int length, int index)
{
    const int runs = (count + length - 1) / length, number = index / EXIT_LANES, first = number % runs * length;
    return { number / runs, first, min(first + length, count), index % EXIT_LANES };
}

// A bit for each lane whose `mine` is true.
WARPCAM_DEVICE unsigned lanes_of(bool mine)
{
#if defined(__CUDA_ARCH__)
    return __ballot_sync(FULL_WARP, mine);
#else
    return mine;
#endif
}

// A ball about the starts of a run's rays.
struct StartBall {
    Vec3 middle;
    float radius;
};

template <class Rays> WARPCAM_DEVICE StartBall ball_of(const Rays& rays, ExitRun run)
{
    const Vec3 middle = rays.start((run.first + run.end) / 2);
    float reach = 0.0f;
    for (int ray = run.first + run.lane; ray < run.end; ray += EXIT_LANES) {
        const Vec3 off = rays.start(ray) - middle;
        reach = max(reach, dot(off, off));
    }
#if defined(__CUDA_ARCH__)
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        reach = max(reach, __shfl_xor_sync(FULL_WARP, reach, step));
#endif
    return { middle, sqrt(reach) };
}

template <class Shapes> WARPCAM_DEVICE bool may_hold(const Shapes& shapes, int world, int id, StartBall starts)
{
    const Vec3 off = as_vec3(wp::index(shapes.positions, world, id)) - starts.middle;
    const Vec3 size = as_vec3(per_world(shapes.sizes, world, id));
    const float near = starts.radius + abs(size.x) + abs(size.y) + abs(size.z);  // no shape with an exit is wider
    return dot(off, off) <= near * near;
}

// Puts exits from one shape, up to a distance, in place of what a run's rays meet behind them.
template <class Shapes, class Rays, class Traced>
WARPCAM_DEVICE void leave_shape(const Shapes& shapes, const SolidShape& solid, int id, const Rays& rays,
                                const Traced& traced, float farthest, ExitRun run)
{
    for (int ray = run.first + run.lane; ray < run.end; ray += EXIT_LANES) {
        const int pixel = rays.pixel(ray);
        float& distance = *wp::address(traced.distance, run.world, pixel);
        const ExitHit exit = exit_of(solid, rays.start(ray), [&] { return rays.direction(ray); });
        if (!(exit.distance < min(distance, MISS)) || exit.distance > farthest)
            continue;
        distance = exit.distance;
        if (traced.shapes.shape[0] > 0)
            *wp::address(traced.shapes, run.world, pixel) =
                shapes.ids.shape[0] > 0 ? wp::index(shapes.ids, run.world, id) : id;
        if (traced.bodies.shape[0] > 0)
            *wp::address(traced.bodies, run.world, pixel) =
                shapes.body_ids.shape[0] > 0 ? wp::index(shapes.body_ids, run.world, id) : wp::index(shapes.bodies, id);
        if (traced.normals.shape[0] > 0)
            for (int c = 0; c < 3; ++c)
                *wp::address(traced.normals, run.world, pixel, c) = component(exit.normal, c);
    }
}

// Puts exits from all shapes in place likewise.
template <class Shapes, class Materials, class Rays, class Traced>
WARPCAM_DEVICE void find_exits(const Shapes& shapes, const Materials& materials, const Rays& rays, const Traced& traced,
                               float farthest, ExitRun run)
{
    const StartBall starts = ball_of(rays, run);
    const int count = shapes.drawn.shape[0], world = run.world;
    for (int begin = 0; begin < count; begin += EXIT_LANES) {
        const int mine = begin + run.lane;
        bool holds = mine < count;
        if (holds)
            holds = may_hold(shapes, world, wp::index(shapes.drawn, mine), starts);
        for (unsigned left = lanes_of(holds); left; left &= left - 1) {
            const int id = wp::index(shapes.drawn, begin + ctz(left));
            const SolidShape solid = load_solid(shapes, world, id);
            const Vec3 off = solid.shape.position - starts.middle;
            const float radius = starts.radius + sqrt(dot(solid.half, solid.half));
            if (solid.half.x >= 0.0f && dot(off, off) <= radius * radius && !transparent(shapes, materials, world, id))
                leave_shape(shapes, solid, id, rays, traced, farthest, run);
        }
    }
}

template <class Mask, class Ranges, class Shapes, class Materials, class Rays, class Poses, class Traced>
WARPCAM_DEVICE void meet_far_sides(const Mask& mask, const Ranges& max_range, const Shapes& shapes,
                                   const Materials& materials, const Rays& rays, const Poses& poses,
                                   const Traced& traced, int length, int index)
{
    const ExitRun run = exit_run(rays.rows * rays.columns, length, index);
    if (wp::index(mask, run.world))
        find_exits(shapes, materials, RaysOfLidar<Rays, Poses> { rays, poses, run.world }, traced,
                   wp::index(max_range, run.world), run);
}

// `first_row`: floats of the table before those of pixels.
template <class Shapes, class Materials, class Table, class Traced>
WARPCAM_DEVICE void meet_far_sides_of_table(const Shapes& shapes, const Materials& materials, const Table& table,
                                            int first_row, int count, const Traced& traced, int length, int index)
{
    const ExitRun run = exit_run(count, length, index);
    const RaysOfTable rays { wp::address(table, run.world, first_row) };
    find_exits(shapes, materials, rays, traced, MISS, run);
}

}  // namespace warpcam
