// Tiles of rays at triangle meshes on a CPU: rays that meet the same node or leaf test it eight at once. Where few are
// left they go on one by one, see accel/bvh4_simd.h.
#pragma once
#include "accel/bvh4_simd.h"

namespace warpcam {

constexpr int RAYS_TOGETHER = 16;  // so many at a node test it together

// A node or leaf that rays have still to test, and where each enters it.
struct PendingNode {
    int child;
    unsigned rays;
    float enter[WARP_SIZE];
};

inline Float8 load_float8(const float* from)
{
    Float8 r;
    __builtin_memcpy(&r, from, sizeof r);
    return r;
}

// Calls look(first, bits) for each eight of the rays of which some are meant.
template <class Look> inline void for_eights(unsigned rays, const Look& look)
{
    for (int first = 0; first < WARP_SIZE; first += SIMD_WIDTH)
        if (const unsigned some = rays >> first & ((1u << SIMD_WIDTH) - 1); some != 0)
            look(first, some);
}

// Eight rays, `first` and those after it, as boxes are tested against them.
struct EightRays {
    Float8 scale[3], in[3], out[3], near, depth;
    Int8 back[3];

    EightRays(const MeshRays& rays, int first)
        : near(load_float8(rays.near + first)), depth(load_float8(rays.depth + first))
    {
        for (int axis = 0; axis < 3; ++axis) {
            scale[axis] = load_float8(rays.scale[axis] + first);
            in[axis] = load_float8(rays.in[axis] + first);
            out[axis] = load_float8(rays.out[axis] + first);
            back[axis] = scale[axis] < 0.0f;
        }
    }

    // Where the rays enter the k-th child of the node whose rows these are, and in `met` which of them do.
    Float8 enter(const float* rows, int k, Int8& met) const
    {
        Float8 enters[3], leaves[3];
        for (int axis = 0; axis < 3; ++axis) {
            const Float8 low = rows[4 * axis + k], high = rows[4 * (axis + 3) + k];
            enters[axis] = fma(back[axis] ? high : low, scale[axis], in[axis]);
            leaves[axis] = fma(back[axis] ? low : high, scale[axis], out[axis]);
        }
        const Float8 t_near = max(max(enters[0], enters[1]), max(enters[2], near));
        met = t_near <= min(min(leaves[0], leaves[1]), min(leaves[2], depth));
        return t_near;
    }
};

// Tests the children of a node against rays; puts those that any ray meets on a stack, the nearest on top, and returns
// how many these are.
inline int step_together(const MeshRays& all, int node, unsigned rays, PendingNode* stack)
{
    const float* const rows = all.nodes + size_t(unsigned(node)) * MeshRays::NODE;
    PendingNode children[4];
    Float8 nearest[4];
    for (int k = 0; k < 4; ++k) {
        children[k].rays = 0;
        nearest[k] = MISS;
    }
    for_eights(rays, [&](int first, unsigned some) {
        const EightRays eight(all, first);
        for (int k = 0; k < 4; ++k) {
            Int8 met;
            const Float8 enter = eight.enter(rows, k, met);
            children[k].rays |= (movemask(met) & some) << first;
            nearest[k] = min(nearest[k], met ? enter : (Float8)MISS);
            MeshRays::put(children[k].enter + first, enter);
        }
    });
    Int4 keys;
    for (int k = 0; k < 4; ++k)
        keys[k] = children[k].rays ? (as_int(reduce_min(nearest[k])) & 0x7ffffffc) | k : -1;
    keys = sorted4(keys);
    int count = 0;
    for (; count < 4 && keys[count] >= 0; ++count) {
        const int k = keys[count] & 3;
        stack[count] = children[k];
        stack[count].child = as_int(rows[4 * 6 + k]);
    }
    return count;
}

// Tests the faces of a leaf against rays, as MeshRays::test_leaf().
template <Sides SIDES, class There>
inline void test_leaf_together(MeshRays& all, unsigned rays, int leaf, const There& there)
{
    const int code = -leaf - 1, begin = code >> 4, end = begin + (code & 15);
    for (int number = begin; number < end; ++number) {
        const float* const rows = all.faces + size_t(unsigned(number)) * MeshRays::FACE;
        const Int8 both = SIDES == BOTH_SIDES || as_int(rows[7]) != 0 ? -1 : 0;
        for_eights(rays, [&](int first, unsigned some) {
            const auto of_frame = [&](int k) { return load_float8(all.frame[k] + first); };
            Corners corners[3];
            for (int corner = 0; corner < 3; ++corner) {
                const float* const at = rows + 4 * corner;
                corners[corner] = project(of_frame, at[0], at[1], at[2]);
            }
            const Weights weights(corners);
            const Int8 inside = weights.inside<SIDES>(both);
            if ((movemask(inside) & some) == 0)
                return;
            const Float8 t = weights.depth(corners);
            const Int8 between = (t < load_float8(all.depth + first)) & (t > load_float8(all.near + first));
            for (unsigned left = movemask(inside & between) & some; left; left &= left - 1) {
                const int k = ctz(left);
                if (there(first + k, number, t[k])) {
                    all.depth[first + k] = t[k];
                    all.face[first + k] = number;
                }
            }
        });
    }
}

// Rays of a node that have not found a nearer hit, with ANY none at all.
template <bool ANY> inline unsigned still_meeting(const MeshRays& all, const PendingNode& node)
{
    unsigned rays = 0;
    for_eights(node.rays, [&](int first, unsigned some) {
        Int8 meeting = load_float8(node.enter + first) < load_float8(all.depth + first);
        if (ANY)
            meeting &= load8(all.face + first) < 0;
        rays |= (movemask(meeting) & some) << first;
    });
    return rays;
}

// The nearest face of each of these rays, which were put, nearer than its depth; with ANY, the first one found.
// there(ray, face, depth): the face is there where it is met.
template <Sides SIDES, bool ANY, class There> inline void find_faces(MeshRays& all, unsigned rays, const There& there)
{
    PendingNode stack[STACK + 1];
    stack[0].child = 0;
    stack[0].rays = rays;
    for_eights(rays, [&](int first, unsigned) {
        store8(all.face + first, (Int8)-1);
        MeshRays::put(stack[0].enter + first, load_float8(all.near + first));
    });
    int height = 1;
    do {
        unsigned started = 0;  // that go on one by one, side by side, once one of them is to be started again
        while (height > 0) {
            const PendingNode& top = stack[height - 1];
            const int node = top.child;
            const unsigned going = still_meeting<ANY>(all, top);
            const bool many = __builtin_popcount(going) >= RAYS_TOGETHER;
            if (node >= 0 && !many && (started & going) != 0)
                break;
            --height;
            if (many && node >= 0) {
                height += step_together(all, node, going, stack + height);
            } else if (many) {
                test_leaf_together<SIDES>(all, going, node, there);
            } else if (node >= 0) {
                started |= going;
                for (unsigned left = going; left; left &= left - 1)
                    all.start(ctz(left), node);
            } else {
                for (unsigned left = going; left; left &= left - 1)
                    all.test_leaf<SIDES>(ctz(left), node, there);
            }
        }
        all.walk<SIDES, ANY>(there);
    } while (height > 0);
}

// The nearest faces of a mesh for a tile's rays, with ANY the first ones found: those that miss its box, most of them,
// are found together.
template <class Types, int LENS, bool ANY = false, class Meshes, class Near, class Rays>
inline void trace_mesh(const Meshes& meshes, const ShapeRecord& record, const Near& near, Rays& rays)
{
    const ShapeRecord r = record;
    const int mesh = r.axis_z.w;
    const auto low = wp::index(meshes.bounds_min, mesh), high = wp::index(meshes.bounds_max, mesh);
    const float lx = low[0], ly = low[1], lz = low[2], ux = high[0], uy = high[1], uz = high[2];
    const auto slabs_of = [&](int lane) {
        const Ray ray = CameraRay<LENS> { rays.x[lane], rays.y[lane] }.local(r);
        return slabs(ray.origin, ray.direction, r.size.x);
    };
    int met[WARP_SIZE], any = 0;
    for (int lane = 0; lane < WARP_SIZE; ++lane) {
        const Slabs s = slabs_of(lane);
        const float x0 = lx * s.scale.x + s.down.x, x1 = ux * s.scale.x + s.up.x;
        const float y0 = ly * s.scale.y + s.down.y, y1 = uy * s.scale.y + s.up.y;
        const float z0 = lz * s.scale.z + s.down.z, z1 = uz * s.scale.z + s.up.z;
        const float enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), near.at(lane)));
        const float t_far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), rays.depth[lane]));
        met[lane] = enter <= t_far;
        any |= met[lane];
    }
    if (!any)
        return;
    MeshRays walk(node_rows(meshes, mesh), face_rows(meshes, mesh));
    for (int lane = 0; lane < WARP_SIZE; ++lane)
        walk.put(lane, slabs_of(lane), CameraRay<LENS> { rays.x[lane], rays.y[lane] }.template frame<Types>(r),
                 near.at(lane), rays.depth[lane]);
    unsigned going = 0;
    for (int lane = 0; lane < WARP_SIZE; ++lane)
        going |= (met[lane] ? 1u : 0u) << lane;
    find_faces<SIDES_OF<Types, false>, ANY>(walk, going, [&](int lane, int face, float t) {
        return is_there<Types>(meshes, r, CameraRay<LENS> { rays.x[lane], rays.y[lane] }.local(r), face, t);
    });
    for (int lane = 0; lane < WARP_SIZE; ++lane)
        if (met[lane] && walk.face[lane] >= 0) {
            rays.depth[lane] = walk.depth[lane];
            rays.shape[lane] = r.axis_y.w;
            rays.face[lane] = walk.face[lane];
        }
}

}  // namespace warpcam
