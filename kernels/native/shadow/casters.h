// The shapes that may stand in a light's way, and the rays that ask whether they do.
#pragma once
#include "accel/horizon_map.h"
#include "shadow/light_space.h"
#include "traversal/visibility.h"

namespace warpcam {

// The ray from a point along a direction, both along the world's axes and from the view's camera. Records for such
// rays hold the camera's place in the shape's frame in `origin`, and take world directions to the shape's frame.
struct WorldRay {
    Vec point, direction;

    WARPCAM_FN static Vec turned(const Record& record, Vec v, Vec start)
    {
        const Row ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
        return { ax.x * v.x + ax.y * v.y + ax.z * v.z + start.x, ay.x * v.x + ay.y * v.y + ay.z * v.z + start.y,
                 az.x * v.x + az.y * v.y + az.z * v.z + start.z };
    }

    WARPCAM_FN Ray local(const Record& record) const
    {
        const Row o = record.origin;
        return { turned(record, point, { o.x, o.y, o.z }), turned(record, direction, { 0.0f, 0.0f, 0.0f }) };
    }

    template <int TYPES> WARPCAM_FN RayFrame frame(const Record& record) const
    {
        if constexpr ((TYPES >> SCALED & 1) != 0)
            return frame_along(local(record));
        const Vec d = direction, none { 0.0f, 0.0f, 0.0f };
        // any vector that is not along d, made perpendicular to it
        const bool steep = magnitude(d.z) > magnitude(d.x);
        const Vec across = steep ? Vec { 0.0f, d.z, -d.y } : Vec { d.y, -d.x, 0.0f };
        return { local(record).origin, turned(record, across, none), turned(record, cross(across, d), none),
                 turned(record, 1.0f / dot(d, d) * d, none) };
    }
};

// A mesh's box in its own frame.
struct Box {
    Vec center, half;
};

// A shape and what a light sees of it.
struct Caster {
    Record record;
    // In the shape's frame: the light's position, or the direction to it if it is distant. w: first row of a mesh's
    // faces; that of its nodes is with the record's origin.
    Row aim;
    Box box;  // of a mesh
    Window window;
    float height;
};

// Casters, part by part. MESHES: whether some are meshes. OUTLINED: on CUDA, whether lists have diagonals.
template <int SIZE, bool MESHES, bool OUTLINED_ = false> struct CasterList {
    static constexpr int CAPACITY = SIZE, WORDS = (SIZE + 31) / 32;
    static constexpr bool OUTLINED = OUTLINED_;

    Record records[CAPACITY];
    Row aims[CAPACITY];
    Box boxes[MESHES ? CAPACITY : 1];
    Window windows[WORDS * 32];  // from `count` on to the end of its 32: empty
    float heights[WORDS * 32];
    Window diagonals[OUTLINED ? CAPACITY : 1];  // what they cover of u + v and u - v
    Window bounds;  // CUDA: what all cover together
    Window bounds_aslant;  // the same of their diagonals
    float ceiling;  // CUDA: how high they reach
    int count;
    int next_tile;  // of those that are drawn with the list
    unsigned strips;  // in place of it, see take_strip(): those that are still to be looked through
};

#if defined(__CUDA_ARCH__)

// Smallest of the values that the lanes of a warp have.
WARPCAM_FN float warp_min(float value)
{
#if __CUDA_ARCH__ >= 800
    const int bits = __float_as_int(value);  // turned so that integers order as the floats do
    const int least = __reduce_min_sync(ALL, bits ^ (bits >> 31 & 0x7fffffff));
    return __int_as_float(least ^ (least >> 31 & 0x7fffffff));
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        value = lower(value, __shfl_xor_sync(ALL, value, step));
    return value;
#endif
}

// What so many windows cover together, one after another. Called by one warp.
WARPCAM_FN Window window_of_all(const Window* windows, int count)
{
    Window all { FAR_AWAY, -FAR_AWAY, FAR_AWAY, -FAR_AWAY };
#pragma unroll 1
    for (int slot = threadIdx.x % LANES; slot < count; slot += LANES) {
        const Window w = windows[slot];
        all = { lower(all.left, w.left), upper(all.right, w.right), lower(all.bottom, w.bottom),
                upper(all.top, w.top) };
    }
    return { warp_min(all.left), -warp_min(-all.right), warp_min(all.bottom), -warp_min(-all.top) };
}

// Finds what all casters of a list cover together, and how high they reach. Called by one warp.
template <class List> WARPCAM_FN void find_bounds(List& list)
{
    float height = -FAR_AWAY;
#pragma unroll 1
    for (int slot = threadIdx.x % LANES; slot < list.count; slot += LANES)
        height = upper(height, list.heights[slot]);
    list.bounds = window_of_all(list.windows, list.count);
    list.ceiling = -warp_min(-height);
    if constexpr (List::OUTLINED)
        list.bounds_aslant = window_of_all(list.diagonals, list.count);
}

// May any of them shade this point?
template <class List> WARPCAM_FN bool may_be_shaded(const List& list, const Place& point)
{
    bool may = may_shade(list.bounds, list.ceiling, point);
    if constexpr (List::OUTLINED)
        may &= point.beside | within(list.bounds_aslant, point.u + point.v, point.u - point.v);
    return may;
}

#endif

// False if the shape casts no shadow in this light. TIGHT: see window_of().
template <int TYPES, bool TIGHT = false, class Meshes, class HeightFields>
WARPCAM_APART WARPCAM_FN bool prepare_caster(const Shape& shape, const LightView& light, const Camera& camera,
                                             const Meshes& meshes, const HeightFields& fields, Caster& caster)
{
    Extent extent {};
    Vec scale;
    Record& record = caster.record;
    record.size = { 0.0f, 0.0f, 0.0f, 0 };
    if (!describe<TYPES>(shape, meshes, fields, extent, scale, record))
        return false;
    const Matrix& r = shape.rotation;
    const Vec c { shape.position.x - camera.origin.x, shape.position.y - camera.origin.y,
                  shape.position.z - camera.origin.z };
    const Vec towards = turned_back(r, ray_to(light, c)), here = turned_back(r, c);
    caster.aim = { towards.x * scale.x, towards.y * scale.y, towards.z * scale.z, 0 };
    if (shape.type == PLANE && !(caster.aim.z < 0.0f))
        return false;  // its front sees the light
    record.axis_x = { r.at[0][0] * scale.x, r.at[1][0] * scale.x, r.at[2][0] * scale.x, shape.type };
    record.axis_y = { r.at[0][1] * scale.y, r.at[1][1] * scale.y, r.at[2][1] * scale.y, shape.id };
    record.axis_z = { r.at[0][2] * scale.z, r.at[1][2] * scale.z, r.at[2][2] * scale.z, shape.asset };
    record.origin = { -here.x * scale.x, -here.y * scale.y, -here.z * scale.z, 0 };
    if ((TYPES >> MESH & 1) && shape.type == MESH) {
        record.origin.w = wp::index(meshes.node_start, shape.asset);
        caster.aim.w = wp::index(meshes.face_start, shape.asset);
        caster.box = { extent.center, extent.half };
        if (TYPES >> SCALED & 1) {
            const Extent own = stretched_by(extent, scale);
            caster.box = { own.center, own.half };
        }
    }
    caster.window = { -FAR_AWAY, FAR_AWAY, -FAR_AWAY, FAR_AWAY };
    caster.height = FAR_AWAY;
    if (extent.half.x >= 0.0f)  // not an endless plane
        caster.window = window_of<TIGHT>(light, shape.type, c, r, extent, caster.height);
    return true;
}

// Marks an analytic caster that is seen through: what stands inside of it lies in its shadow.
template <int TYPES, class Shapes, class Materials>
WARPCAM_FN void mark_glass(Row& aim, const Record& record, const Shapes& shapes, const Materials& materials, int world,
                           int id)
{
    if constexpr ((TYPES >> GLASS & 1) != 0)
        if (record.axis_x.w != MESH)
            aim.w = opacity(shapes, materials, world, id) < SOLID;
}

// Fills the list with shapes from `begin` on until it is full, but for its bounds; returns where to go on. TEAM: so
// many threads do it, a block or one of its warps.
template <int TYPES, int TEAM, class List, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_APART WARPCAM_FN int collect_casters(List& list, int begin, const Shapes& shapes, const Materials& materials,
                              const Meshes& meshes, const HeightFields& fields, const LightView& light,
                              const Camera& camera, int world, int thread)
{
    const int total = shapes.drawn.shape[0];
    while (begin < total) {
        const int i = begin + thread;
        begin += TEAM;
        if (i < total) {
            Caster caster;
            const int id = wp::index(shapes.drawn, i);
            if (prepare_caster<TYPES>(load_shape(shapes, world, id), light, camera, meshes, fields, caster)
                && !transparent(shapes, materials, world, id)) {
                const int slot = claimed(list.count);
                list.records[slot] = caster.record;
                list.aims[slot] = caster.aim;
                mark_glass<TYPES>(list.aims[slot], caster.record, shapes, materials, world, id);
                if (TYPES >> MESH & 1)
                    list.boxes[slot] = caster.box;
                list.windows[slot] = caster.window;
                list.heights[slot] = caster.height;
                if constexpr (List::OUTLINED) {
                    const Window& w = caster.window;
                    list.diagonals[slot] = { w.left + w.bottom, w.right + w.top, w.left - w.top, w.right - w.bottom };
                }
            }
        }
        if (total > List::CAPACITY) {  // the next round may overflow the list
            team_barrier<TEAM>();
            const bool full = list.count + TEAM > List::CAPACITY;
            team_barrier<TEAM>();
            if (full)
                break;
        }
    }
    team_barrier<TEAM>();
    const int count = list.count;
    for (int slot = count + thread; slot < (count + 31) / 32 * 32; slot += TEAM) {
        list.windows[slot] = { FAR_AWAY, -FAR_AWAY, FAR_AWAY, -FAR_AWAY };
        list.heights[slot] = -FAR_AWAY;
    }
    return begin;
}

// The same with its bounds, by a whole block.
template <int TYPES, class List, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_FN int gather_casters(List& list, int begin, const Shapes& shapes, const Materials& materials,
                              const Meshes& meshes, const HeightFields& fields, const LightView& light,
                              const Camera& camera, int world, int thread)
{
    begin =
        collect_casters<TYPES, THREADS>(list, begin, shapes, materials, meshes, fields, light, camera, world, thread);
#if defined(__CUDA_ARCH__)
    if (thread < LANES)
        find_bounds(list);
#endif
    block_barrier();
    return begin;
}

// How a light reaches a pixel's point on a face of a mesh.
struct Facing {
    bool
        front;  // the light shines on the side that the pixel shows, anywhere on the face; true where that is not known
    bool clear;  // nothing of the mesh itself is in the way; false where that is not known
};

// How a light looks from a mesh, all in the mesh's frame.
struct MeshLight {
    Vec aim;  // as Caster.aim
    Vec way;  // from a point of a face to it
    Vec sight;  // of the ray that sees the point
};

// Light that shines on the other side only adds nothing but its ambient part, so that the shadow of one without does
// not matter.
template <int TYPES, class Meshes>
WARPCAM_FN Facing face_light(const Meshes& meshes, int mesh, int face, bool distant, const MeshLight& light)
{
    const unsigned row = unsigned(wp::index(meshes.face_start, mesh)) + unsigned(face * FACE_ROWS);
    int given = load(meshes.faces.data, row).w;
    bool back = false, flat = false;
    Vec normal { 0.0f, 0.0f, 0.0f };
    if constexpr ((TYPES >> TWO_SIDED & 1) != 0) {
        const Row first = load(meshes.faces.data, row), second = load(meshes.faces.data, row + 1);
        const Row third = load(meshes.faces.data, row + 2);
        if (has_back<TYPES>(second.w)) {
            flat = is_flat<TYPES>(second.w, third.w);
            normal = normalized(cross(to_vec(second) - to_vec(first), to_vec(third) - to_vec(first)));
            back = dot(normal, light.sight) > 0.0f;
            if (back) {
                given = second.w;
                normal = -normal;
            }
        }
    }
    const int corner = 3 * (wp::index(meshes.corner_start, mesh) + given);
    bool faces = false;
    Row corners[3];
    for (int k = 0; k < 3; ++k) {
        const Row at = corners[k] = load(meshes.faces.data, row + k);
        const Vec n = flat ? normal : to_vec(wp::index(meshes.normals, corner + (back && k > 0 ? 3 - k : k)));
        const Vec aim = light.aim, to = distant ? aim : Vec { aim.x - at.x, aim.y - at.y, aim.z - at.z };
        const float slack = 1.0e-5f * (magnitude(to.x) + magnitude(to.y) + magnitude(to.z));
        faces |= n.x * to.x + n.y * to.y + n.z * to.z > -slack;
    }
    bool clear = false;
    if constexpr (has_horizons(TYPES)) {
        const FaceAxes axes = face_axes(to_vec(corners[0]), to_vec(corners[1]), to_vec(corners[2]));
        clear = is_clear(unsigned(corners[2].w), axes, light.way);
    }
    return { faces, clear };
}

// The same of a shape's face. The point is seen from `origin`, by a ray along `sight`; both in the world's axes.
template <int TYPES, class Shapes, class Meshes>
WARPCAM_FN Facing face_light(const Shapes& shapes, const Meshes& meshes, int world, int id, int face,
                             const LightView& light, Vec origin, Vec sight, Vec point)
{
    if (wp::index(shapes.types, id) != MESH)
        return { true, false };
    const Shape shape = load_shape(shapes, world, id);
    const Vec c { shape.position.x - origin.x, shape.position.y - origin.y, shape.position.z - origin.z };
    const auto local = [&](Vec v) {
        const Vec own = turned_back(shape.rotation, v);
        return TYPES >> SCALED & 1 ? Vec { own.x / shape.size.x, own.y / shape.size.y, own.z / shape.size.z } : own;
    };
    return face_light<TYPES>(meshes, shape.asset, face, light.distant,
                             { local(ray_to(light, c)), local(ray_to(light, point)), local(sight) });
}

}  // namespace warpcam
