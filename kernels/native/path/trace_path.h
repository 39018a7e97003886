// What a ray in any direction meets first, and whether it meets anything: over the list of a world's shapes, with the
// intersections of analytic shapes, the walk of height fields and the trees of meshes that a view's rays have, too.
#pragma once
#include "accel/alpha_test.h"
#include "accel/heightfield.h"
#include "geometry/intersect_exit.h"
#include "path/path_shapes.h"
#if !defined(__CUDA_ARCH__)
#include "accel/bvh4_simd.h"
#endif

namespace warpcam {

struct PathHit {
    float t;
    int slot;  // in the list of shapes, or -1
    int shape, face;
};

// How a ray meets shapes.
struct PathQuery {
    float far;
    bool any;      // the first that is found will do
    bool backs;    // meshes are met from behind, too
    bool camera;   // shapes that the camera does not see are left out
    int convex;    // the analytic shape that the ray leaves, which it cannot meet again; or -1
    int inside;    // the shape that it runs in, of which it meets the far side; or -1
};

// The faces of a mesh that a ray meets before `hit`.
template <class Types, class Meshes> WARPCAM_INLINED void walk_mesh(const Meshes& meshes, const ShapeRecord& record,
                                                                    const PathRay& world_ray, bool backs, bool any,
                                                                    PathHit& hit)
{
    const Ray ray = world_ray.local(record);
    const RayFrame frame = frame_along(ray);
    const int mesh = record.axis_z.w;
    int face = -1;
#if defined(__CUDA_ARCH__)
    struct Waiting {
        int node;
        float enter;
    } stack[STACK];
    const unsigned nodes = as_int(record.size.y), faces = as_int(record.size.z);
    NodeRay<by_child<Types>()> boxes;
    boxes.set(ray.origin, ray.direction, record.size.x);
    int node = 0, height = 0;
    while (node != NO_NODE) {
        if (node < 0) {
            const int code = -node - 1, first = code >> 4, end = first + (code & 15);
            for (int f = first; f < end; ++f) {
                Float3Int corners[1][3];
                load_faces(meshes.faces.data, faces, f, end, corners);
                const Float3Int &a = corners[0][0], &b = corners[0][1], &c = corners[0][2];
                const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                               project(frame, c.x, c.y, c.z), backs || has_back<Types>(b.w));
                if (t < hit.t && t > 0.0f && is_there<Types>(meshes, record, ray, f, t)) {
                    hit.t = t;
                    face = f;
                }
            }
            if (any && face >= 0)
                break;
            node = NO_NODE;
        } else {
            float enter[4], t_far[4], best = MISS;
            int child[4];
            boxes.test(node_rows<Types>(meshes, nodes, node), 0.0f, hit.t, enter, t_far, child);
            node = NO_NODE;
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                const bool met = enter[k] <= t_far[k], nearer = met && enter[k] < best;
                const int other = nearer ? node : child[k];
                if (k > 0 && met && other != NO_NODE)
                    stack[height++] = { other, nearer ? best : enter[k] };
                node = nearer ? child[k] : node;
                best = nearer ? enter[k] : best;
            }
        }
        while (node == NO_NODE && height > 0) {
            const Waiting waiting = stack[--height];
            node = waiting.enter < hit.t ? waiting.node : NO_NODE;
        }
    }
#else
    MeshRays walk(node_rows(meshes, mesh), face_rows(meshes, mesh));
    walk.put(0, slabs(ray.origin, ray.direction, record.size.x), frame, 0.0f, hit.t);
    walk.face[0] = -1;
    walk.start(0, 0);
    const auto there = [&](int, int met, float t) { return is_there<Types>(meshes, record, ray, met, t); };
    constexpr Sides SIDES = SIDES_OF<Types, false>;
    if (backs)
        any ? walk.walk<BOTH_SIDES, true>(there) : walk.walk<BOTH_SIDES, false>(there);
    else
        any ? walk.walk<SIDES, true>(there) : walk.walk<SIDES, false>(there);
    face = walk.face[0];
    hit.t = face >= 0 ? walk.depth[0] : hit.t;
#endif
    if (face >= 0) {
        hit.shape = record.axis_y.w;
        hit.face = face;
    }
}

WARPCAM_DEVICE ShapeRecord load_record(const Float3Int* rows)
{
    return { load(rows, 1), load(rows, 2), load(rows, 3), load(rows, 4), load(rows, 5) };
}

// True if the ray may meet the shape in that ball before `far`.
WARPCAM_DEVICE bool may_meet(const Float3Int& ball, const PathRay& ray, float far)
{
    const float radius = as_float(ball.w);
    if (radius >= MISS)
        return true;
    const Vec3 away = as_vec3(ball) - ray.point;
    const float along = dot(away, ray.direction);
    const Vec3 aside = away - along * ray.direction;
    return dot(aside, aside) <= radius * radius && along + radius > 0.0f && along - radius < far;
}

// `rows` and `count`: the list of a world's shapes.
template <class Types, class Meshes, class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_INLINED PathHit trace_path(const Float3Int* rows, int count, const Meshes& meshes,
                                                        const HeightFields& fields, const PathRay& ray,
                                                        const PathQuery& query)
{
    PathHit hit { query.far, -1, -1, -1 };
    for (int slot = 0;; ++slot) {
        // The next shape that the ray may meet: rays that run side by side meet others, and each finds its own first.
        while (slot < count && !may_meet(load(rows, PATH_SHAPE_ROWS * slot), ray, hit.t))
            ++slot;
        if (slot >= count)
            return hit;
        const Float3Int* const own = rows + PATH_SHAPE_ROWS * slot;
        const ShapeRecord record = load_record(own);
        const int type = record.axis_x.w, shape = record.axis_y.w;
        if (query.camera && (record.origin.w & UNSEEN_BY_CAMERA))
            continue;
        const float before = hit.t;
        if (Types::has(MESH) && type == MESH) {
            walk_mesh<Types>(meshes, record, ray, query.backs || shape == query.inside, query.any, hit);
        } else if (Types::has(HEIGHT_FIELD) && type == HEIGHT_FIELD) {
            Hit met { hit.t, -1, -1 };
            walk_height_field(fields, record, ray, 0.0f, met);
            if (met.depth < hit.t)
                hit = { met.depth, slot, shape, met.face };
        } else if (shape != query.convex || shape == query.inside) {
            const Ray local = ray.local(record);
            const float t = shape == query.inside ? intersect_exit_any<Types::ANALYTIC>(record, local)
                                                  : intersect_any<Types::ANALYTIC>(record, local);
            if (t > 0.0f && t < hit.t)
                hit = { t, slot, shape, -1 };
        }
        if (hit.t < before) {
            hit.slot = slot;
            if (query.any)
                return hit;
        }
    }
}

}  // namespace warpcam
