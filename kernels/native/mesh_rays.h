// Fine triangle meshes behind a region's pixels, on CUDA. Where a mesh has more faces than the pixels it covers, few rays
// of a tile meet it and each walks its own way. Such rays wait in a queue of the block, and four lanes share a ray: each
// tests one child of a node, or one face of a leaf at a time; a ray that is done makes room for the next.
#pragma once
#include "tiles.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int GROUP = 4;  // lanes that share a ray, as many as a node has children
constexpr int GROUPS = LANES / GROUP;
constexpr int QUEUE = 512;     // rays of a block that wait
constexpr int MIN_LANES = 16;  // fewer than this at inner nodes wait until leaves have been tested
constexpr unsigned ALL = 0xffffffffu;

struct Waiting {
    int node;
    float entry;  // where the ray enters the node's box
};

// The fine meshes of a block's list, nearest first, and the rays that wait for them.
struct MeshRays {
    unsigned char fine[LANES];  // slots
    int num_fine;
    bool any_coarse;
    int count, next;              // rays in the queue; the first that nobody has taken
    float depth[QUEUE];           // of the nearest hit so far
    unsigned meshes[QUEUE];       // bits by place in `fine`: meshes whose boxes the ray meets
    unsigned short pixel[QUEUE];  // row * 64 + column in the region
    Waiting stacks[THREADS / LANES][STACK][GROUPS];

    // Is there room for one more tile of each warp?
    WARPCAM_FN bool has_room() const { return *const_cast<const volatile int*>(&count) <= QUEUE - THREADS; }
};

// Lists the fine meshes. More than a warp has lanes are too many: the farther ones count as coarse. For one warp.
template <int TYPES, int CAPACITY>
WARPCAM_FN void list_fine_meshes(ShapeList<CAPACITY>& list, MeshRays& rays)
{
    const int lane = threadIdx.x % LANES;
    int count = 0;
    bool coarse = false;
    for (int begin = 0; begin < list.count; begin += LANES) {
        const int slot = begin + lane < list.count ? list.order[begin + lane] : -1;
        const bool fine = slot >= 0 && is_fine<TYPES>(list.records[slot]);
        const unsigned all = __ballot_sync(ALL, fine);
        coarse |= slot >= 0 && !fine && list.records[slot].axis_x.w == MESH;
        const int at = count + __popc(all & ((1u << lane) - 1));
        if (fine && at < LANES)
            rays.fine[at] = static_cast<unsigned char>(slot);
        else if (fine)
            list.records[slot].origin.w = 0;
        count += __popc(all);
    }
    coarse = __any_sync(ALL, coarse) || count > LANES;
    if (lane == 0) {
        rays.num_fine = min(count, LANES);
        rays.any_coarse = coarse;
    }
}

// Puts the rays of a tile that meet fine meshes into the queue, which has room for them.
template <int LENS, int CAPACITY, class Meshes>
WARPCAM_FN void enqueue(const ShapeList<CAPACITY>& list, MeshRays& rays, int column, int row, const ViewRay<LENS>& ray,
                        float near, const Meshes& meshes, float depth)
{
    const int lane = threadIdx.x % LANES;
    const bool mine = lane < rays.num_fine && touches(list.touched[rays.fine[lane]], column, row);
    const unsigned mask = __ballot_sync(ALL, mine);
    if (mask == 0)
        return;
    const unsigned met = find_meshes(mask, list.records, rays.fine, ray, near, meshes, depth);
    const unsigned waiting = __ballot_sync(ALL, met != 0);
    if (waiting == 0)
        return;
    int at = 0;
    if (lane == 0)
        at = atomicAdd(&rays.count, __popc(waiting));
    at = __shfl_sync(ALL, at, 0) + __popc(waiting & ((1u << lane) - 1));
    if (met != 0) {
        rays.depth[at] = depth;
        rays.meshes[at] = met;
        rays.pixel[at] = static_cast<unsigned short>((row * TILE_HEIGHT + lane / TILE_WIDTH) * 64
                                                     + column * TILE_WIDTH + lane % TILE_WIDTH);
    }
}

// Takes the nearest node off a ray's stack that is nearer than `depth`; NO_NODE when there is none.
WARPCAM_FN int take(const Waiting (*stack)[GROUPS], int& height, float depth)
{
    while (height > 0) {
        const Waiting top = stack[--height][0];
        if (top.entry < depth)
            return top.node;
    }
    return NO_NODE;
}

// Smallest of a group's values, in all of its lanes.
WARPCAM_FN int group_min(int value)
{
    value = min(value, __shfl_xor_sync(ALL, value, 1));
    return min(value, __shfl_xor_sync(ALL, value, 2));
}

// Traces the rays of the queue and stores what they hit: store(pixel, depth, shape, face). `ray_of(pixel)` is a pixel's
// ray. All warps of the block come here together.
template <int CAPACITY, class Meshes, class RayOf, class Store>
WARPCAM_FN void trace_queue(MeshRays& rays, const ShapeList<CAPACITY>& list, const Meshes& meshes,
                            float near, const RayOf& ray_of, const Store& store)
{
    const int lane = threadIdx.x % LANES, member = lane % GROUP, first_lane = lane - member;
    const int count = rays.count;
    Waiting(*stack)[GROUPS]
        = reinterpret_cast<Waiting(*)[GROUPS]>(&rays.stacks[threadIdx.x / LANES][0][lane / GROUP]);
    // the same in all lanes of a group
    int entry = -1, slot = 0, node = NO_NODE, height = 0, shape = -1, face = -1;
    unsigned left = 0, nodes = 0, faces = 0;
    float depth = 0.0f;
    auto ray = ray_of(0);
    Slabs s {};
    while (true) {
        const bool idle = node == NO_NODE && left == 0;
        const unsigned idles = __ballot_sync(ALL, idle);
        if (idles) {
            int next = 0;
            if (lane == 0)
                next = atomicAdd(&rays.next, __popc(idles) / GROUP);
            next = __shfl_sync(ALL, next, 0);
            if (idle) {
                if (shape >= 0 && member == 0)
                    store(rays.pixel[entry], depth, shape, face);
                shape = -1;
                entry = next + __popc(idles & ((1u << first_lane) - 1)) / GROUP;
                if (entry < count) {
                    ray = ray_of(rays.pixel[entry]);
                    depth = rays.depth[entry];
                    left = rays.meshes[entry];
                }
            }
            if (!__any_sync(ALL, left != 0 || node != NO_NODE))
                return;
        }
        if (node == NO_NODE && left != 0) {  // on to the ray's next mesh
            slot = rays.fine[lowest_bit(left)];
            left &= left - 1;
            const Record& record = list.records[slot];
            if (as_float(record.size.w) < depth) {
                const Ray local = ray.local(record);
                s = slabs(local.origin, local.direction, record.size.x);
                nodes = wp::index(meshes.node_start, record.axis_z.w);
                faces = wp::index(meshes.face_start, record.axis_z.w);
                node = 0;
            } else {
                left = 0;  // what follows is farther still
            }
        }

        bool inner = node >= 0 && node != NO_NODE;
        unsigned stepping = __ballot_sync(ALL, inner);
        while (stepping) {
            float enter = FAR_AWAY;
            int child = NO_NODE;
            bool met = false;
            if (inner) {
                const unsigned at = nodes + unsigned(node * NODE_ROWS + member * 2);
                const Row low = load(meshes.nodes.data, at), high = load(meshes.nodes.data, at + 1);
                const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
                const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
                const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
                enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), near));
                met = enter <= lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), depth));
                child = low.w;
            }
            const unsigned group_met = __ballot_sync(ALL, met) >> first_lane & 15u;
            // the nearest child and, in the lowest bits, the lane that has it
            const int winner = group_min(met ? (as_int(enter) & ~3) | member : NO_NODE) & 3;
            const int nearest = __shfl_sync(ALL, child, winner, GROUP);
            const unsigned others = group_met & ~(1u << winner);
            if (met && member != winner)
                stack[height + __popc(others & ((1u << member) - 1))][0] = { child, enter };
            __syncwarp();
            if (inner) {
                height += __popc(others);
                node = group_met ? nearest : take(stack, height, depth);
            }
            inner = node >= 0 && node != NO_NODE;
            stepping = __ballot_sync(ALL, inner);
            if (__popc(stepping) < MIN_LANES)
                break;
        }

        const bool leaf = node < 0;
        if (__any_sync(ALL, leaf)) {
            float t = FAR_AWAY;
            int found = -1;
            if (leaf) {
                const int code = -node - 1, first = code >> 4, end = first + (code & 15);
                const RayFrame frame = ray.frame(list.records[slot]);
                for (int f = first + member; f < end; f += GROUP) {
                    const unsigned at = faces + unsigned(f * FACE_ROWS);
                    const Row a = load(meshes.faces.data, at), b = load(meshes.faces.data, at + 1);
                    const Row c = load(meshes.faces.data, at + 2);
                    const float reached = enter_triangle(frame, project(frame, a.x, a.y, a.z),
                                                         project(frame, b.x, b.y, b.z), project(frame, c.x, c.y, c.z));
                    if (reached < t && reached > near) {
                        t = reached;
                        found = f;
                    }
                }
            }
            const int best = group_min(as_int(t));
            const unsigned owners = __ballot_sync(ALL, as_int(t) == best) >> first_lane & 15u;
            found = __shfl_sync(ALL, found, lowest_bit(owners), GROUP);
            if (leaf) {
                if (as_float(best) < depth) {
                    depth = as_float(best);
                    shape = list.records[slot].axis_y.w;
                    face = found;
                }
                node = take(stack, height, depth);
            }
        }
    }
}

}  // namespace warpcam
#endif
