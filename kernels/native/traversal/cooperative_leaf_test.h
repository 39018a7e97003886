// Leaves of triangle meshes that several rays of a warp have come to, on CUDA. Every lane tests one face for one of the
// rays: where few rays are at leaves, or leaves have many faces, a warp would else wait face after face.
#pragma once
#include "accel/alpha_test.h"
#include "traversal/ray_queue.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int ENOUGH_PAIRS = 16;  // of a ray and a face; fewer wait for company

// Bits of all lanes.
WARPCAM_FN unsigned bits_of_all(unsigned bits)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_or_sync(ALL, bits);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        bits |= __shfl_xor_sync(ALL, bits, step);
    return bits;
#endif
}

// Finds the ray's nearest hit among a leaf's faces, if it is before its hit so far.
template <int TYPES, class Meshes, class Ray>
WARPCAM_FN void meet_leaf(const Record& record, const Meshes& meshes, const Ray& ray, int leaf, float near,
                          float& depth, int& shape, int& face)
{
    const int code = -leaf - 1, first = code >> 4, end = first + (code & 15);
    const RayFrame frame = ray.template frame<TYPES>(record);
    const unsigned faces = as_int(record.size.z);
    constexpr int TOGETHER = faces_together(TYPES);
    for (int begin = first; begin < end; begin += TOGETHER) {
        Row corners[TOGETHER][3];
        load_faces(meshes.faces.data, faces, begin, end, corners);
#pragma unroll
        for (int i = 0; i < TOGETHER; ++i) {
            const int f = face_of<TOGETHER>(begin, i, end);
            const Row &a = corners[i][0], &b = corners[i][1], &c = corners[i][2];
            const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z),
                                           project(frame, b.x, b.y, b.z), project(frame, c.x, c.y, c.z),
                                           has_back<TYPES>(b.w));
            if (t < depth && t > near && is_there<TYPES>(meshes, record, ray.local(record), f, t)) {
                depth = t;
                shape = record.axis_y.w;
                face = f;
            }
        }
    }
}

// The faces of all leaves that lanes of a warp have come to, lane after lane, each with its lane's ray.
struct LeafPairs {
    int first;       // the lane's first face
    int begin, end;  // where its faces stand
    int count;       // of all

    // Of a leaf; of what is none 0.
    WARPCAM_FN static int faces_of(int node) { return node < 0 ? (-node - 1) & 15 : 0; }

    // Lanes whose `node` is no leaf have none. They are added up by their bits; of all lanes there are `all`.
    WARPCAM_FN LeafPairs(int node, int all)
    {
        const int code = node < 0 ? -node - 1 : 0, faces = code & 15;
        const unsigned before = (1u << threadIdx.x % LANES) - 1;
        first = code >> 4;
        begin = 0;
        count = all;
#pragma unroll
        for (int bit = 0; bit < 4; ++bit) {
            const unsigned with = __ballot_sync(ALL, faces >> bit & 1);
            begin += __popc(with & before) << bit;
        }
        end = begin + faces;
    }

    // Whose pair stands so many places behind `window` as the lane's number is, and where his begin in the window.
    WARPCAM_FN int owner(unsigned char (&owners)[LANES], int window, int& start) const
    {
        const int lane = threadIdx.x % LANES, place = begin > window ? begin - window : 0;
        const bool begins = end > begin && begin < window + LANES && end > window;
        const unsigned places = bits_of_all(begins ? 1u << place : 0);
        if (begins)
            owners[place] = static_cast<unsigned char>(lane);
        __syncwarp();
        start = LANES - 1 - __clz(places & ((2u << lane) - 1));
        return owners[start];
    }

    // The face there, of lane `from`.
    WARPCAM_FN int face(int window, int from) const
    {
        return __shfl_sync(ALL, first - begin, from) + window + threadIdx.x % LANES;
    }

    // What is left of the lane's leaf if only the first so many pairs were tested: a leaf's code, or NO_NODE.
    WARPCAM_FN int left_of(int tested) const
    {
        const int from = upper_int(begin, tested);
        return from < end ? -((first + from - begin) * 16 + end - from) - 1 : NO_NODE;
    }

    // The lane's own places in a window, by bit.
    WARPCAM_FN unsigned places(int window) const
    {
        const int last = lower_int(end - window, LANES);
        const unsigned until = last <= 0 ? 0 : ALL >> (LANES - last), from = begin > window ? begin - window : 0;
        return from < LANES ? until >> from << from : 0;
    }
};

// A warp's room for such pairs.
struct PairRoom {
    unsigned char owners[LANES];
    float depth[LANES];  // of the lanes' nearest hits
    int face[LANES];
};

// The same of a ray that ends at any face.
struct AnyPairRoom {
    unsigned char owners[LANES];
};

// Where a pair's ray enters its face beyond `near` and before `depth`, else FAR_AWAY.
template <int TYPES, class Meshes, class Ray> WARPCAM_FN float meet_face(const Record& record, const Meshes& meshes,
                                                                         const Ray& ray, int face, float near,
                                                                         float depth)
{
    const Row* rows =
        reinterpret_cast<const Row*>(meshes.faces.data) + (as_int(record.size.z) + unsigned(face * FACE_ROWS));
    const Row a = load(rows, 0), b = load(rows, 1), c = load(rows, 2);
    const RayFrame frame = ray.template frame<TYPES>(record);
    const float t = enter_triangle(frame, project(frame, a.x, a.y, a.z), project(frame, b.x, b.y, b.z),
                                   project(frame, c.x, c.y, c.z), has_back<TYPES>(b.w));
    return t < depth && t > near && is_there<TYPES>(meshes, record, ray.local(record), face, t) ? t : FAR_AWAY;
}

// The same for all lanes whose `node` is a leaf, of the mesh at `slot` of the list, which have so many faces together;
// says whether the lane's ray hits one. With `full` lanes wait for company again rather than leave most of a warp idle:
// `node` becomes what is left of the leaf.
template <int TYPES, class List, class Meshes, class Ray>
WARPCAM_FN bool meet_leaves(PairRoom& room, const List& list, const Meshes& meshes, const Ray& ray, int slot, int node,
                            int faces, float near, bool full, float& depth, int& face, int& left)
{
    const int lane = threadIdx.x % LANES;
    const LeafPairs pairs(node, faces);
    const bool some = full && pairs.count > LANES && pairs.count % LANES < ENOUGH_PAIRS;
    const int tested = some ? pairs.count / LANES * LANES : pairs.count;
    room.depth[lane] = depth;
    for (int window = 0; window < tested; window += LANES) {
        int start;
        const int from = pairs.owner(room.owners, window, start), number = pairs.face(window, from);
        Ray its = ray;
        its.x = __shfl_sync(ALL, ray.x, from);
        its.y = __shfl_sync(ALL, ray.y, from);
        const Record& record = list.records[__shfl_sync(ALL, slot, from)];
        const float from_on = __shfl_sync(ALL, near, from);
        float t = FAR_AWAY;
        if (window + lane < pairs.count)
            t = meet_face<TYPES>(record, meshes, its, number, from_on, room.depth[from]);
        const bool hits = t < FAR_AWAY;
        if (!__any_sync(ALL, hits))
            continue;
        if (hits)
            atomicMin(reinterpret_cast<int*>(&room.depth[from]), as_int(t));  // none is negative
        __syncwarp();
        const unsigned nearest = __ballot_sync(ALL, hits && room.depth[from] == t);
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

// The same of rays that end here if they hit: few faces are hit, so their lanes ask for them one after another.
template <int TYPES, class List, class Meshes, class Ray>
WARPCAM_FN bool meet_leaves(AnyPairRoom& room, const List& list, const Meshes& meshes, const Ray& ray, int slot,
                            int node, int faces, float near, bool full, float& depth, int& face, int& left)
{
    const int lane = threadIdx.x % LANES;
    const LeafPairs pairs(node, faces);
    const bool some = full && pairs.count > LANES && pairs.count % LANES < ENOUGH_PAIRS;
    const int tested = some ? pairs.count / LANES * LANES : pairs.count;
    bool met = false;
    for (int window = 0; window < tested; window += LANES) {
        int start;
        const int from = pairs.owner(room.owners, window, start), number = pairs.face(window, from);
        Ray its = ray;
        its.x = __shfl_sync(ALL, ray.x, from);
        its.y = __shfl_sync(ALL, ray.y, from);
        const Record& record = list.records[__shfl_sync(ALL, slot, from)];
        const float from_on = __shfl_sync(ALL, near, from), until = __shfl_sync(ALL, depth, from);
        float t = FAR_AWAY;
        if (window + lane < pairs.count)
            t = meet_face<TYPES>(record, meshes, its, number, from_on, until);
        const unsigned hits = __ballot_sync(ALL, t < FAR_AWAY);
        for (unsigned mine = hits & pairs.places(window); __any_sync(ALL, mine); mine &= mine - 1) {
            const int giver = mine ? lowest_bit(mine) : lane;
            const float its_depth = __shfl_sync(ALL, t, giver);
            const int its_face = __shfl_sync(ALL, number, giver);
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
