// Transparent shapes, over what is seen behind them.
//
// MuJoCo's renderer sorts them by distance and draws them twice: in that order from near to far, and from far to near.
// Both are steps c -> a C + (1 - a) c of a colour c, one for each shape that lies before what is solid. The first
// passage is made as it comes; that of the second, which begins with the last shape, is kept as P + Q c.
#pragma once
#include "shading/appearance.h"
#include "accel/alpha_test.h"
#include "geometry/shape_state.h"
#include "traversal/trace_tile.h"

namespace warpcam {

constexpr int MAX_LAYERS = 8;           // of one shape in one ray that can be seen through one another
constexpr float FROM_BEHIND = 0.3f;  // how solid a plane is that is seen from behind, of what it is from its front
constexpr float NOTEWORTHY = 0.2929f;  // opacity from which a shape, drawn twice, covers half of what lies behind
constexpr float AS_FAR = 1.000001f;  // of the depth of what is solid: what lies there is drawn over it
constexpr float PLANES_LAST = 1.0e10f;  // the distance by which planes are sorted [m]

// Transparent shapes of a region.
template <int CAPACITY> struct TransparentShapes {
    ShapeRecord records[CAPACITY];
    float distance[CAPACITY];  // by slot
    float opacity[CAPACITY];  // by slot
    int ids[CAPACITY];  // by slot
    TileRect touched[CAPACITY];  // by slot
    unsigned char order[CAPACITY];  // by rank: the slot
    int count;
};

// Radius of a sphere around a shape that holds it, for shapes that are not geoms.
template <class Types> WARPCAM_DEVICE float bounding_radius(const Shape& shape)
{
    const Vec3 s = shape.size;
    float radius = sqrt(dot(s, s));
    visit_shape<Types::GEOMETRY & ~(1 << PLANE)>(shape.type,
                                                 [&](auto traits) { radius = traits.bounding_radius(s.x, s.y, s.z); });
    return radius;
}

// Fills the list. `eye` is where MuJoCo's camera is: distances and backs count from there, in mirrors too. A `mirror`
// does not show itself. BACKS: planes are seen from behind.
template <class Types, int LENS, bool BACKS, int CAPACITY, class Scene_>
WARPCAM_DEVICE void gather_transparent(TransparentShapes<CAPACITY>& list, const Scene_& scene, const Camera& camera,
                                       const Region& region, Vec3 eye, int mirror, int world, int thread)
{
    const auto& shapes = scene.shapes;
    const bool not_drawn = !(abs(camera.origin.x) < MISS);
    if (thread == 0)
        list.count = 0;
    block_sync();
    for (int i = thread; i < scene.frame.transparent_shapes.shape[0] && !not_drawn; i += THREADS) {
        const int id = wp::index(scene.frame.transparent_shapes, i);
        float alpha = opacity(shapes, scene.materials, world, id);
        Shape shape = load_shape(shapes, world, id);
        const Vec3 away = eye - shape.position;
        const Mat3& r = shape.rotation;
        const bool plane = Types::has(PLANE) && shape.type == PLANE;
        const bool behind = BACKS && plane && r.at[0][2] * away.x + r.at[1][2] * away.y + r.at[2][2] * away.z < 0.0f;
        if (alpha == 0.0f || id == mirror)
            continue;
        bool mapped = false;
        if constexpr (Types::has(ALPHA_TESTED))
            mapped = has_opacity_map(scene.shapes, scene.materials, world, id);
        if (alpha >= SOLID && !behind && !mapped)
            continue;
        if (behind) {  // traced as the plane that faces the other way
            alpha *= FROM_BEHIND;
            for (int k = 0; k < 3; ++k)
                for (int axis = 1; axis < 3; ++axis)
                    shape.rotation.at[k][axis] = -shape.rotation.at[k][axis];
        }
        ShapeRecord record;
        TileRect tiles;
        if (setup_shape<Types, LENS>(shape, camera, region, scene.meshes, scene.fields, record, tiles) != SEEN)
            continue;
        const int slot = atomic_append(list.count);
        list.records[slot] = record;
        const float reach = wp::index(scene.frame.reach, id);
        list.distance[slot] =
            plane ? PLANES_LAST : sqrt(dot(away, away)) - (reach < 0.0f ? bounding_radius<Types>(shape) : reach);
        list.opacity[slot] = alpha;
        list.ids[slot] = id;
        list.touched[slot] = tiles;
    }
    block_sync();
    for (int i = thread; i < list.count; i += THREADS) {
        int rank = 0;
        for (int j = 0; j < list.count; ++j)
            rank += list.distance[j] < list.distance[i]
                    || (list.distance[j] == list.distance[i] && list.ids[j] < list.ids[i]);
        list.order[rank] = static_cast<unsigned char>(i);
    }
    block_sync();
}

#if defined(__CUDA_ARCH__)
// Nearest front face of one mesh between `near` and the hit's depth, for one lane.
template <class Types, class Meshes, class RayOf>
WARPCAM_DEVICE void walk_mesh(const Meshes& meshes, const ShapeRecord& record, const RayOf& source, float near,
                              Hit& hit)
{
    const Ray ray = source.local(record);
    const RayFrame frame = source.template frame<Types>(record);
    NodeRay<by_child<Types>()> boxes;
    boxes.set(ray.origin, ray.direction, record.size.x);
    const unsigned nodes = wp::index(meshes.node_start, record.axis_z.w);
    const unsigned faces = wp::index(meshes.face_start, record.axis_z.w);
    int stack[STACK], height = 0, node = 0;
    while (node != NO_NODE) {
        if (node >= 0) {
            float enter[4], t_far[4], best = MISS;
            int child[4];
            boxes.test(node_rows<Types>(meshes, nodes, node), near, hit.depth, enter, t_far, child);
            node = NO_NODE;
#pragma unroll
            for (int k = 0; k < 4; ++k)
                if (enter[k] <= t_far[k]) {
                    const bool nearer = enter[k] < best;
                    if (node != NO_NODE)
                        stack[height++] = nearer ? node : child[k];
                    node = nearer ? child[k] : node;
                    best = nearer ? enter[k] : best;
                }
        } else {
            const int code = -node - 1, first = code >> 4, end = first + (code & 15);
            for (int f = first; f < end; ++f) {
                const unsigned at = faces + unsigned(f * FACE_ROWS);
                const Float3Int a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
                const Float3Int c = load(meshes.faces.data, at + 2);
                const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                               project(frame, c.x, c.y, c.z), has_back<Types>(b.w));
                if (t < hit.depth && t > near && is_not_cut<Types>(meshes, record, ray, f, t))
                    hit = { t, record.axis_y.w, f };
            }
            node = NO_NODE;
        }
        if (node == NO_NODE && height > 0)
            node = stack[--height];
    }
}
#else
template <class Types, class Meshes, class RayOf>
inline void walk_mesh(const Meshes& meshes, const ShapeRecord& record, const RayOf& source, float near, Hit& hit)
{
    const Ray ray = source.local(record);
    const int mesh = record.axis_z.w;
    MeshRays walk(node_rows(meshes, mesh), face_rows(meshes, mesh));
    walk.put(0, slabs(ray.origin, ray.direction, record.size.x), source.template frame<Types>(record), near, hit.depth);
    find_faces<SIDES_OF<Types, false>, false>(
        walk, 1u, [&](int, int face, float t) { return is_not_cut<Types>(meshes, record, ray, face, t); });
    if (walk.face[0] >= 0)
        hit = { walk.depth[0], record.axis_y.w, walk.face[0] };
}
#endif

// Finds a ray's next intersection with a transparent shape between `near` and the hit's depth; leaves the hit's shape
// as it is if there is none.
template <class Types, class Meshes, class HeightFields, class RayOf>
WARPCAM_DEVICE void intersect_transparent(const ShapeRecord& record, const RayOf& ray, float near, const Meshes& meshes,
                                          const HeightFields& fields, Hit& hit)
{
    if (is_mesh<Types>(record)) {
        if constexpr (Types::has(MESH))
            walk_mesh<Types>(meshes, record, ray, near, hit);
    } else if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD) {
        if constexpr (Types::has(HEIGHT_FIELD))
            walk_height_field(fields, record, ray, near, hit);
    } else {
        const float t = intersect_any<Types::ANALYTIC>(record, ray.local(record));
        if (t < hit.depth && t > near)
            hit = { t, record.axis_y.w, -1 };
    }
}

// Blend of transparent shapes over a colour, in both passages: see above. `left`: part of the solid colour still seen.
struct MujocoBlend {
    Vec3 linear, display;
    Vec3 linear_over, display_over;
    float left;

    WARPCAM_DEVICE explicit MujocoBlend(Vec3 linear, Vec3 display)
        : linear(linear), display(display), linear_over {}, display_over {}, left(1.0f)
    {
    }

    WARPCAM_DEVICE void add(float opacity, Vec3 more_linear, Vec3 more_display)
    {
        const float rest = 1.0f - opacity;
        linear = rest * linear + opacity * more_linear;
        display = rest * display + opacity * more_display;
        linear_over = linear_over + (left * opacity) * more_linear;
        display_over = display_over + (left * opacity) * more_display;
        left *= rest;
    }

    WARPCAM_DEVICE Vec3 final_linear() const { return linear_over + left * linear; }
    WARPCAM_DEVICE Vec3 final_display() const { return display_over + left * display; }
};

// Covers a pixel's colour. `solid` is the depth of what is solid there, negative where nothing is to be covered.
// ONE_TILE: the pixels of a warp are those of a tile.
// `column` and `row` are the tile's in the list's region. shade(met, hit, linear, display) says the colour of a layer
// and returns which part of its shape's opacity it has; the whole warp comes there together, and those who have not met
// it do not look at what they get. note(hit, opacity) is told of each layer that is met.
template <class Types, bool ONE_TILE, class TransparentShapes_, class RayOf, class Scene_, class Shade, class Note>
WARPCAM_DEVICE void cover(const TransparentShapes_& transparent_shapes, const Scene_& scene, const RayOf& ray,
                          float near, float solid, int column, int row, const Shade& shade, const Note& note,
                          MujocoBlend& covered)
{
    const float limit = AS_FAR * solid;
    const auto draw = [&](int rank) {
        const int slot = transparent_shapes.order[rank], type = transparent_shapes.records[slot].axis_x.w;
        const int layers = type == MESH || type == HEIGHT_FIELD ? MAX_LAYERS : 1;
        float from = near, to = limit;
#pragma unroll 1
        for (int layer = 0; layer < layers; ++layer) {
            Hit hit { to, -1, -1 };
            intersect_transparent<Types>(transparent_shapes.records[slot], ray, from, scene.meshes, scene.fields, hit);
            const bool met = hit.shape >= 0;
            if (!warp_any(met))
                break;
            Vec3 linear, display;
            const float opacity = shade(met, hit, linear, display) * transparent_shapes.opacity[slot];
            if (met) {
                covered.add(opacity, linear, display);
                note(hit, opacity);
            }
            from = type == HEIGHT_FIELD ? 1.00001f * hit.depth : hit.depth;  // not the same ground once more
            to = met ? limit : -1.0f;
        }
    };
    const auto touched = [&](int rank) {
        return touches(transparent_shapes.touched[transparent_shapes.order[rank]], column, row);
    };
#if defined(__CUDA_ARCH__)
    if constexpr (ONE_TILE) {
        for (int begin = 0; begin < transparent_shapes.count; begin += WARP_SIZE) {
            const int rank = begin + threadIdx.x % WARP_SIZE;
            const bool mine = rank < transparent_shapes.count && touched(rank);
            for (unsigned mask = __ballot_sync(FULL_WARP, mine); mask; mask &= mask - 1)
                draw(begin + ctz(mask));
        }
        return;
    }
#endif
    for (int rank = 0; rank < transparent_shapes.count; ++rank)
        if (warp_any(touched(rank)))
            draw(rank);
}

}  // namespace warpcam
