// The shapes that may stand in a light's way, and the rays that ask whether they do.
#pragma once
#include "accel/horizon_map.h"
#include "shadow/light_space.h"
#include "traversal/visibility.h"

namespace warpcam {

// The ray from a point along a direction, both along the world's axes and from the view's camera. Records for such
// rays hold the camera's place in the shape's frame in `origin`, and take world directions to the shape's frame.
struct WorldRay {
    Vec3 point, direction;

    WARPCAM_DEVICE Ray local(const ShapeRecord& record) const
    {
        return { transform_rows(record, point, record.origin), transform_rows(record, direction) };
    }

    template <class Types> WARPCAM_DEVICE RayFrame frame(const ShapeRecord& record) const
    {
        if constexpr (Types::has(PER_SHAPE_SCALE))
            return frame_along(local(record));
        const Vec3 d = direction;
        // any vector that is not along d, made perpendicular to it
        const bool steep = abs(d.z) > abs(d.x);
        const Vec3 across = steep ? Vec3 { 0.0f, d.z, -d.y } : Vec3 { d.y, -d.x, 0.0f };
        return { local(record).origin, transform_rows(record, across), transform_rows(record, cross(across, d)),
                 transform_rows(record, 1.0f / dot(d, d) * d) };
    }
};

// A mesh's box in its own frame.
struct Box {
    Vec3 center, half;
};

// A shape and what a light sees of it.
struct Caster {
    ShapeRecord record;
    // In the shape's frame: the light's position, or the direction to it if it is distant. w: first row of a mesh's
    // faces; that of its nodes is with the record's origin.
    Float3Int aim;
    Box box;  // of a mesh
    LightSpaceBounds bounds_uv;
    float height;
};

// Casters, part by part. MESHES: whether some are meshes. OUTLINED: on CUDA, whether lists have diagonals.
template <int SIZE, bool MESHES, bool OUTLINED_ = false> struct CasterList {
    static constexpr int CAPACITY = SIZE, WORDS = (SIZE + 31) / 32;
    static constexpr bool OUTLINED = OUTLINED_;

    ShapeRecord records[CAPACITY];
    Float3Int aims[CAPACITY];
    Box boxes[MESHES ? CAPACITY : 1];
    LightSpaceBounds bounds_uv[WORDS * 32];  // from `count` on to the end of its 32: empty
    float heights[WORDS * 32];
    LightSpaceBounds diagonals[OUTLINED ? CAPACITY : 1];  // what they cover of u + v and u - v
    LightSpaceBounds bounds;  // CUDA: what all cover together
    LightSpaceBounds bounds_aslant;  // the same of their diagonals
    float ceiling;  // CUDA: how high they reach
    int count;
    int next_tile;  // of those that are drawn with the list
    unsigned strips;  // in place of it, see take_strip(): those that are still to be looked through
};

#if defined(__CUDA_ARCH__)

// Smallest of the values that the lanes of a warp have.
WARPCAM_DEVICE float warp_min(float value)
{
#if __CUDA_ARCH__ >= 800
    const int bits = __float_as_int(value);  // turned so that integers order as the floats do
    const int least = __reduce_min_sync(FULL_WARP, bits ^ (bits >> 31 & 0x7fffffff));
    return __int_as_float(least ^ (least >> 31 & 0x7fffffff));
#else
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        value = min(value, __shfl_xor_sync(FULL_WARP, value, step));
    return value;
#endif
}

// Union of several bounds. Called by one warp.
WARPCAM_DEVICE LightSpaceBounds bounds_uv_of_all(const LightSpaceBounds* bounds_uv, int count)
{
    LightSpaceBounds all { MISS, -MISS, MISS, -MISS };
#pragma unroll 1
    for (int slot = threadIdx.x % WARP_SIZE; slot < count; slot += WARP_SIZE) {
        const LightSpaceBounds w = bounds_uv[slot];
        all = { min(all.left, w.left), max(all.right, w.right), min(all.bottom, w.bottom), max(all.top, w.top) };
    }
    return { warp_min(all.left), -warp_min(-all.right), warp_min(all.bottom), -warp_min(-all.top) };
}

// Finds what all casters of a list cover together, and how high they reach. Called by one warp.
template <class List> WARPCAM_DEVICE void find_bounds(List& list)
{
    float height = -MISS;
#pragma unroll 1
    for (int slot = threadIdx.x % WARP_SIZE; slot < list.count; slot += WARP_SIZE)
        height = max(height, list.heights[slot]);
    list.bounds = bounds_uv_of_all(list.bounds_uv, list.count);
    list.ceiling = -warp_min(-height);
    if constexpr (List::OUTLINED)
        list.bounds_aslant = bounds_uv_of_all(list.diagonals, list.count);
}

// True if any caster may shade this point.
template <class List> WARPCAM_DEVICE bool may_be_shaded(const List& list, const LightSpacePoint& point)
{
    bool may = may_occlude(list.bounds, list.ceiling, point);
    if constexpr (List::OUTLINED)
        may &= point.beside | within(list.bounds_aslant, point.u + point.v, point.u - point.v);
    return may;
}

#endif

// False if the shape casts no shadow in this light.
template <class Types, class Meshes, class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE bool prepare_caster(const Shape& shape, const LightView& light,
                                                        const Camera& camera, const Meshes& meshes,
                                                        const HeightFields& fields, Caster& caster)
{
    LocalBounds extent {};
    Vec3 scale;
    ShapeRecord& record = caster.record;
    record.size = { 0.0f, 0.0f, 0.0f, 0 };
    if (!shape_bounds<Types>(shape, meshes, fields, extent, scale, record))
        return false;
    const Mat3& r = shape.rotation;
    const Vec3 c { shape.position.x - camera.origin.x, shape.position.y - camera.origin.y,
                   shape.position.z - camera.origin.z };
    const Vec3 towards = transform_transposed(r, ray_to(light, c)), here = transform_transposed(r, c);
    caster.aim = { towards.x * scale.x, towards.y * scale.y, towards.z * scale.z, 0 };
    if (shape.type == PLANE && !(caster.aim.z < 0.0f))
        return false;  // its front sees the light
    record.axis_x = { r.at[0][0] * scale.x, r.at[1][0] * scale.x, r.at[2][0] * scale.x, shape.type };
    record.axis_y = { r.at[0][1] * scale.y, r.at[1][1] * scale.y, r.at[2][1] * scale.y, shape.id };
    record.axis_z = { r.at[0][2] * scale.z, r.at[1][2] * scale.z, r.at[2][2] * scale.z, shape.asset };
    record.origin = { -here.x * scale.x, -here.y * scale.y, -here.z * scale.z, 0 };
    if (Types::has(MESH) && shape.type == MESH) {
        record.origin.w = wp::index(meshes.node_start, shape.asset);
        caster.aim.w = wp::index(meshes.face_start, shape.asset);
        caster.box = { extent.center, extent.half };
        if (Types::has(PER_SHAPE_SCALE)) {
            const LocalBounds own = stretched_by(extent, scale);
            caster.box = { own.center, own.half };
        }
    }
    caster.bounds_uv = { -MISS, MISS, -MISS, MISS };
    caster.height = MISS;
    if (extent.half.x >= 0.0f)  // not an endless plane
        caster.bounds_uv = bounds_uv_of(light, shape.type, c, r, extent, caster.height);
    return true;
}

// Marks an analytic caster that is seen through: what stands inside of it lies in its shadow.
template <class Types, class Shapes, class Materials>
WARPCAM_DEVICE void mark_glass(Float3Int& aim, const ShapeRecord& record, const Shapes& shapes,
                               const Materials& materials, int world, int id)
{
    if constexpr (Types::has(TRANSPARENT_CASTERS))
        if (record.axis_x.w != MESH)
            aim.w = opacity(shapes, materials, world, id) < SOLID;
}

// Any caster.
struct AllCasters {
    WARPCAM_DEVICE bool has(const Caster&) const { return true; }
};

// Fills the rest of a list's last 32 places, once all threads have listed theirs.
template <int WARP_OR_ONE, class List> WARPCAM_DEVICE void end_casters(List& list, int thread)
{
    team_barrier<WARP_OR_ONE>();
    const int count = list.count;
    for (int slot = count + thread; slot < (count + 31) / 32 * 32; slot += WARP_OR_ONE) {
        list.bounds_uv[slot] = { MISS, -MISS, MISS, -MISS };
        list.heights[slot] = -MISS;
    }
}

// Adds the shape at a place among the drawn ones to the list, if it is wanted.
template <class Types, class Wanted, class List, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE void put_caster(List& list, int place, const Wanted& wanted, const Shapes& shapes,
                                                    const Materials& materials, const Meshes& meshes,
                                                    const HeightFields& fields, const LightView& light,
                                                    const Camera& camera, int world)
{
    Caster caster;
    const int id = wp::index(shapes.drawn, place);
    if (prepare_caster<Types>(load_shape(shapes, world, id), light, camera, meshes, fields, caster)
        && wanted.has(caster) && !transparent(shapes, materials, world, id)) {
        const int slot = atomic_append(list.count);
        list.records[slot] = caster.record;
        list.aims[slot] = caster.aim;
        mark_glass<Types>(list.aims[slot], caster.record, shapes, materials, world, id);
        if (Types::has(MESH))
            list.boxes[slot] = caster.box;
        list.bounds_uv[slot] = caster.bounds_uv;
        list.heights[slot] = caster.height;
        if constexpr (List::OUTLINED) {
            const LightSpaceBounds& w = caster.bounds_uv;
            list.diagonals[slot] = { w.left + w.bottom, w.right + w.top, w.left - w.top, w.right - w.bottom };
        }
    }
}

// Fills the list with those of the `wanted` shapes from `begin` on until it is full, but for its bounds; returns where
// to go on. WARP_OR_ONE: so many threads do it, a block or one of its warps.
template <class Types, int WARP_OR_ONE, class Wanted, class List, class Shapes, class Materials, class Meshes,
          class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE int collect_casters(List& list, int begin, const Wanted& wanted,
                                                        const Shapes& shapes, const Materials& materials,
                                                        const Meshes& meshes, const HeightFields& fields,
                                                        const LightView& light, const Camera& camera, int world,
                                                        int thread)
{
    const int total = shapes.drawn.shape[0];
    while (begin < total) {
        const int i = begin + thread;
        begin += WARP_OR_ONE;
        if (i < total)
            put_caster<Types>(list, i, wanted, shapes, materials, meshes, fields, light, camera, world);
        if (total > List::CAPACITY) {  // the next round may overflow the list
            team_barrier<WARP_OR_ONE>();
            const bool full = list.count + WARP_OR_ONE > List::CAPACITY;
            team_barrier<WARP_OR_ONE>();
            if (full)
                break;
        }
    }
    end_casters<WARP_OR_ONE>(list, thread);
    return begin;
}

// Finds the bounds of a list that a block has filled.
template <class List> WARPCAM_DEVICE void close_list(List& list, int thread)
{
#if defined(__CUDA_ARCH__)
    if (thread < WARP_SIZE)
        find_bounds(list);
#endif
    block_sync();
}

// Builds the list with its bounds, by a whole block.
template <class Types, class Wanted, class List, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_DEVICE int gather_casters(List& list, int begin, const Wanted& wanted, const Shapes& shapes,
                                  const Materials& materials, const Meshes& meshes, const HeightFields& fields,
                                  const LightView& light, const Camera& camera, int world, int thread)
{
    begin = collect_casters<Types, THREADS>(list, begin, wanted, shapes, materials, meshes, fields, light, camera,
                                            world, thread);
    close_list(list, thread);
    return begin;
}

// Direction and reach of a light at a pixel's point on a face of a mesh.
struct Facing {
    bool
        front;  // the light shines on the side that the pixel shows, anywhere on the face; true where that is not known
    bool clear;  // nothing of the mesh itself is in the way; false where that is not known
};

// Light in a mesh's frame.
struct MeshLight {
    Vec3 aim;  // as Caster.aim
    Vec3 way;  // from a point of a face to it
    Vec3 view_direction;  // of the ray that sees the point
};

// Light that shines on the other side only adds nothing but its ambient part, so that the shadow of one without does
// not matter.
template <class Types, class Meshes>
WARPCAM_DEVICE Facing face_light(const Meshes& meshes, int mesh, int face, bool distant, const MeshLight& light)
{
    const unsigned row = unsigned(wp::index(meshes.face_start, mesh)) + unsigned(face * FACE_ROWS);
    int given = load(meshes.faces.data, row).w;
    bool back = false, flat = false;
    Vec3 normal { 0.0f, 0.0f, 0.0f };
    if constexpr (Types::has(TWO_SIDED)) {
        const Float3Int first = load(meshes.faces.data, row), second = load(meshes.faces.data, row + 1);
        const Float3Int third = load(meshes.faces.data, row + 2);
        if (has_back<Types>(second.w)) {
            flat = is_flat<Types>(second.w, third.w);
            normal = normalized(cross(as_vec3(second) - as_vec3(first), as_vec3(third) - as_vec3(first)));
            back = dot(normal, light.view_direction) > 0.0f;
            if (back) {
                given = second.w;
                normal = -normal;
            }
        }
    }
    const int corner = 3 * (wp::index(meshes.corner_start, mesh) + given);
    bool faces = false;
    Float3Int corners[3];
    for (int k = 0; k < 3; ++k) {
        const Float3Int at = corners[k] = load(meshes.faces.data, row + k);
        const Vec3 n = flat ? normal : as_vec3(wp::index(meshes.normals, corner + (back && k > 0 ? 3 - k : k)));
        const Vec3 aim = light.aim, to = distant ? aim : Vec3 { aim.x - at.x, aim.y - at.y, aim.z - at.z };
        const float slack = 1.0e-5f * (abs(to.x) + abs(to.y) + abs(to.z));
        faces |= n.x * to.x + n.y * to.y + n.z * to.z > -slack;
    }
    bool clear = false;
    if constexpr (has_horizons<Types>()) {
        const FaceAxes axes = face_axes(as_vec3(corners[0]), as_vec3(corners[1]), as_vec3(corners[2]));
        clear = is_clear(unsigned(corners[2].w), axes, light.way);
    }
    return { faces, clear };
}

// Tests a shape's face likewise. The point is seen from `origin`, by a ray along `view_direction`; both in the world's
// axes.
template <class Types, class Shapes, class Meshes>
WARPCAM_DEVICE Facing face_light(const Shapes& shapes, const Meshes& meshes, int world, int id, int face,
                                 const LightView& light, Vec3 origin, Vec3 view_direction, Vec3 point)
{
    if (wp::index(shapes.types, id) != MESH)
        return { true, false };
    const Shape shape = load_shape(shapes, world, id);
    const Vec3 c { shape.position.x - origin.x, shape.position.y - origin.y, shape.position.z - origin.z };
    const auto local = [&](Vec3 v) {
        const Vec3 own = transform_transposed(shape.rotation, v);
        return Types::has(PER_SHAPE_SCALE) ? Vec3 { own.x / shape.size.x, own.y / shape.size.y, own.z / shape.size.z }
                                           : own;
    };
    return face_light<Types>(meshes, shape.asset, face, light.distant,
                             { local(ray_to(light, c)), local(ray_to(light, point)), local(view_direction) });
}

}  // namespace warpcam
