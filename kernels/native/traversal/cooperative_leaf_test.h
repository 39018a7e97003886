// Leaves of triangle meshes that several rays of a warp have come to, on CUDA. Every lane tests one face for one of the
// rays: where few rays are at leaves, or leaves have many faces, a warp would else wait face after face.
#pragma once
#include "accel/alpha_test.h"
#include "traversal/ray_queue.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int MIN_LEAF_PAIRS = 16;  // of a ray and a face; fewer wait for company

// Bits of all lanes.
WARPCAM_DEVICE unsigned warp_reduce_or(unsigned bits)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_or_sync(FULL_WARP, bits);
#else
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        bits |= __shfl_xor_sync(FULL_WARP, bits, step);
    return bits;
#endif
}

// Finds the ray's nearest hit among a leaf's faces, if it is before its hit so far.
template <class Types, class Meshes, class Ray>
WARPCAM_DEVICE void test_leaf(const ShapeRecord& record, const Meshes& meshes, const Ray& ray, int leaf, float near,
                              float& depth, int& shape, int& face)
{
    const int code = -leaf - 1, first = code >> 4, end = first + (code & 15);
    const RayFrame frame = ray.template frame<Types>(record);
    const unsigned faces = as_int(record.size.z);
    constexpr int TOGETHER = faces_together<Types>();
    for (int begin = first; begin < end; begin += TOGETHER) {
        Float3Int corners[TOGETHER][3];
        load_faces(meshes.faces.data, faces, begin, end, corners);
#pragma unroll
        for (int i = 0; i < TOGETHER; ++i) {
            const int f = face_of<TOGETHER>(begin, i, end);
            const Float3Int &a = corners[i][0], &b = corners[i][1], &c = corners[i][2];
            const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                           project(frame, c.x, c.y, c.z), has_back<Types>(b.w));
            if (t < depth && t > near && is_there<Types>(meshes, record, ray.local(record), f, t)) {
                depth = t;
                shape = record.axis_y.w;
                face = f;
            }
        }
    }
}

// The faces of all leaves that lanes of a warp have come to, lane after lane, each with its lane's ray.
struct RayFacePairs {
    int first;  // the lane's first face
    int begin, end;  // where its faces stand
    int count;  // of all

    // Number of faces of a leaf; 0 for anything else.
    WARPCAM_DEVICE static int faces_of(int node) { return node < 0 ? (-node - 1) & 15 : 0; }

    // Lanes whose `node` is no leaf have none. They are added up by their bits; of all lanes there are `all`.
    WARPCAM_DEVICE RayFacePairs(int node, int all)
    {
        const int code = node < 0 ? -node - 1 : 0, faces = code & 15;
        const unsigned before = (1u << threadIdx.x % WARP_SIZE) - 1;
        first = code >> 4;
        begin = 0;
        count = all;
#pragma unroll
        for (int bit = 0; bit < 4; ++bit) {
            const unsigned with = __ballot_sync(FULL_WARP, faces >> bit & 1);
            begin += __popc(with & before) << bit;
        }
        end = begin + faces;
    }

    // Whose pair stands so many places behind `window` as the lane's number is, and where his begin in the window.
    WARPCAM_DEVICE int owner(unsigned char (&owners)[WARP_SIZE], int window, int& start) const
    {
        const int lane = threadIdx.x % WARP_SIZE, place = begin > window ? begin - window : 0;
        const bool begins = end > begin && begin < window + WARP_SIZE && end > window;
        const unsigned places = warp_reduce_or(begins ? 1u << place : 0);
        __syncwarp();  // the last window's owners are read
        if (begins)
            owners[place] = static_cast<unsigned char>(lane);
        __syncwarp();
        start = WARP_SIZE - 1 - __clz(places & ((2u << lane) - 1));
        return owners[start];
    }

    // The face there, of lane `from`.
    WARPCAM_DEVICE int face(int window, int from) const
    {
        return __shfl_sync(FULL_WARP, first - begin, from) + window + threadIdx.x % WARP_SIZE;
    }

    // Rest of the lane's leaf if only the first `tested` pairs were tested: a leaf's code, or NO_NODE.
    WARPCAM_DEVICE int left_of(int tested) const
    {
        const int from = max(begin, tested);
        return from < end ? -((first + from - begin) * 16 + end - from) - 1 : NO_NODE;
    }

    // The lane's own places in a window, by bit.
    WARPCAM_DEVICE unsigned places(int window) const
    {
        const int last = min(end - window, WARP_SIZE);
        const unsigned until = last <= 0 ? 0 : FULL_WARP >> (WARP_SIZE - last),
                       from = begin > window ? begin - window : 0;
        return from < WARP_SIZE ? until >> from << from : 0;
    }
};

// A warp's room for such pairs.
struct PairRoom {
    unsigned char owners[WARP_SIZE];
    float depth[WARP_SIZE];  // of the lanes' nearest hits
    int face[WARP_SIZE];
};

// Shared memory for rays that end at any face.
struct AnyPairRoom {
    unsigned char owners[WARP_SIZE];
};

// Intersects a pair's ray with its face beyond `near` and before `depth`; MISS if there is no intersection.
template <class Types, class Meshes, class Ray> WARPCAM_DEVICE float meet_face(const ShapeRecord& record,
                                                                               const Meshes& meshes, const Ray& ray,
                                                                               int face, float near, float depth)
{
    const Float3Int* rows =
        reinterpret_cast<const Float3Int*>(meshes.faces.data) + (as_int(record.size.z) + unsigned(face * FACE_ROWS));
    const Float3Int a = load(rows, 0), b = load(rows, 1), c = load(rows, 2);
    const RayFrame frame = ray.template frame<Types>(record);
    const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                   project(frame, c.x, c.y, c.z), has_back<Types>(b.w));
    return t < depth && t > near && is_there<Types>(meshes, record, ray.local(record), face, t) ? t : MISS;
}

// Tests the leaves of all lanes whose `node` is a leaf, of the mesh at `slot` of the list, which have so many faces
// together; returns whether the lane's ray hits one. With `full` lanes wait again for others rather than leave most of
// a warp idle: `node` becomes the rest of the leaf.
template <class Types, class List, class Meshes, class Ray>
WARPCAM_DEVICE bool meet_leaves(PairRoom& room, const List& list, const Meshes& meshes, const Ray& ray, int slot,
                                int node, int faces, float near, bool full, float& depth, int& face, int& left)
{
    const int lane = threadIdx.x % WARP_SIZE;
    const RayFacePairs pairs(node, faces);
    const bool some = full && pairs.count > WARP_SIZE && pairs.count % WARP_SIZE < MIN_LEAF_PAIRS;
    const int tested = some ? pairs.count / WARP_SIZE * WARP_SIZE : pairs.count;
    room.depth[lane] = depth;
    for (int window = 0; window < tested; window += WARP_SIZE) {
        int start;
        const int from = pairs.owner(room.owners, window, start), number = pairs.face(window, from);
        Ray its = ray;
        its.x = __shfl_sync(FULL_WARP, ray.x, from);
        its.y = __shfl_sync(FULL_WARP, ray.y, from);
        const ShapeRecord& record = list.records[__shfl_sync(FULL_WARP, slot, from)];
        const float from_on = __shfl_sync(FULL_WARP, near, from);
        float t = MISS;
        if (window + lane < pairs.count)
            t = meet_face<Types>(record, meshes, its, number, from_on, room.depth[from]);
        const bool hits = t < MISS;
        if (!__any_sync(FULL_WARP, hits))
            continue;
        if (hits)
            atomicMin(reinterpret_cast<int*>(&room.depth[from]), as_int(t));  // none is negative
        __syncwarp();
        const unsigned nearest = __ballot_sync(FULL_WARP, hits && room.depth[from] == t);
        if ((nearest >> lane & 1) && !(nearest & ((1u << lane) - (1u << start))))  // of equals the first
            room.face[from] = number;
    }
    left = pairs.left_of(tested);
    __syncwarp();
    const bool met = node < 0 && room.depth[lane] < depth;
    if (met) {
        depth = room.depth[lane];
        face = room.face[lane];
    }
    return met;
}

// Tests leaves for rays that end at any hit: few faces are hit, so their lanes ask for them one after another.
template <class Types, class List, class Meshes, class Ray>
WARPCAM_DEVICE bool meet_leaves(AnyPairRoom& room, const List& list, const Meshes& meshes, const Ray& ray, int slot,
                                int node, int faces, float near, bool full, float& depth, int& face, int& left)
{
    const int lane = threadIdx.x % WARP_SIZE;
    const RayFacePairs pairs(node, faces);
    const bool some = full && pairs.count > WARP_SIZE && pairs.count % WARP_SIZE < MIN_LEAF_PAIRS;
    const int tested = some ? pairs.count / WARP_SIZE * WARP_SIZE : pairs.count;
    bool met = false;
    for (int window = 0; window < tested; window += WARP_SIZE) {
        int start;
        const int from = pairs.owner(room.owners, window, start), number = pairs.face(window, from);
        Ray its = ray;
        its.x = __shfl_sync(FULL_WARP, ray.x, from);
        its.y = __shfl_sync(FULL_WARP, ray.y, from);
        const ShapeRecord& record = list.records[__shfl_sync(FULL_WARP, slot, from)];
        const float from_on = __shfl_sync(FULL_WARP, near, from), until = __shfl_sync(FULL_WARP, depth, from);
        float t = MISS;
        if (window + lane < pairs.count)
            t = meet_face<Types>(record, meshes, its, number, from_on, until);
        const unsigned hits = __ballot_sync(FULL_WARP, t < MISS);
        for (unsigned mine = hits & pairs.places(window); __any_sync(FULL_WARP, mine); mine &= mine - 1) {
            const int giver = mine ? ctz(mine) : lane;
            const float its_depth = __shfl_sync(FULL_WARP, t, giver);
            const int its_face = __shfl_sync(FULL_WARP, number, giver);
            if (mine && its_depth < depth) {
                depth = its_depth;
                face = its_face;
                met = true;
            }
        }
    }
    left = pairs.left_of(tested);
    return met;
}

}  // namespace warpcam
#endif
