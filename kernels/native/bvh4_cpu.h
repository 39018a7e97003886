// Triangle meshes on a CPU: a tile's rays meet one mesh after another; a ray tests the four children of a node, and four
// faces of a leaf, at once.
#pragma once
#include "mask.h"

namespace warpcam {

typedef float Float4 __attribute__((ext_vector_type(4)));
typedef int Int4 __attribute__((ext_vector_type(4)));

inline Float4 lower4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 upper4(Float4 a, Float4 b) { return a > b ? a : b; }

inline Float4 muladd4(Float4 a, float b, float c)
{
#if defined(__FMA__)
    return __builtin_elementwise_fma(a, (Float4)b, (Float4)c);
#else
    return a * b + c;
#endif
}

inline Float4 load4(const float* rows, unsigned row)
{
    Float4 r;
    __builtin_memcpy(&r, rows + 4u * row, sizeof r);
    return r;
}

// Bit k is set where element k is true (all ones).
inline unsigned bits_of(Int4 truth)
{
#if defined(__x86_64__)
    return static_cast<unsigned>(__builtin_ia32_movmskps((Float4)truth));
#else
    return static_cast<unsigned>(__builtin_reduce_or(truth & Int4 { 1, 2, 4, 8 }));
#endif
}

// Four points: first rows, each a point, in; then a coordinate each.
inline void transpose(Float4 a, Float4 b, Float4 c, Float4 d, Float4& x, Float4& y, Float4& z)
{
    const Float4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    x = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
    y = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
    const Float4 abz = __builtin_shufflevector(a, b, 2, 6, 2, 6), cdz = __builtin_shufflevector(c, d, 2, 6, 2, 6);
    z = __builtin_shufflevector(abz, cdz, 0, 1, 4, 5);
}

// As Corner and project() of triangle.h, for four faces.
struct Corner4 {
    Float4 x, y, along;
};

inline Corner4 project4(const RayFrame& f, Float4 x, Float4 y, Float4 z)
{
#pragma clang fp contract(off)
    x -= f.origin.x;
    y -= f.origin.y;
    z -= f.origin.z;
    return { f.across.x * x + (f.across.y * y + f.across.z * z), f.up.x * x + (f.up.y * y + f.up.z * z),
             f.depth.x * x + f.depth.y * y + f.depth.z * z };
}

inline Float4 edge4(const Corner4& a, const Corner4& b)
{
#pragma clang fp contract(off)
    return a.x * b.y - a.y * b.x;
}

// Which sides of faces a ray meets: fronts; backs, too, of those that have one; both of all.
enum Sides { FRONTS, FRONTS_AND_MARKED, BOTH_SIDES };

struct MeshHit {
    float depth;
    int face;
};

// The faces `first` to `end` - 1 of a mesh against one ray. there(face, depth): the face is there where it is met.
template <Sides SIDES, class There>
inline bool test_leaf(const float* faces, int first, int end, const RayFrame& frame, float near, const There& there,
                      MeshHit& hit)
{
    bool any = false;
    for (int face = first; face < end; face += 4) {
        Corner4 corners[3];
        unsigned rows[4];
        for (int k = 0; k < 4; ++k)
            rows[k] = unsigned(lower_int(face + k, end - 1)) * FACE_ROWS;
        for (unsigned corner = 0; corner < 3; ++corner) {
            Float4 x, y, z;
            transpose(load4(faces, rows[0] + corner), load4(faces, rows[1] + corner), load4(faces, rows[2] + corner),
                      load4(faces, rows[3] + corner), x, y, z);
            corners[corner] = project4(frame, x, y, z);
        }
        const Float4 wc = edge4(corners[0], corners[1]), wa = edge4(corners[1], corners[2]);
        const Float4 wb = edge4(corners[2], corners[0]), total = wa + wb + wc;
        Int4 inside = (wa >= 0.0f) & (wb >= 0.0f) & (wc >= 0.0f) & (total > 0.0f);
        if constexpr (SIDES != FRONTS) {
            Int4 both = -1;
            if constexpr (SIDES == FRONTS_AND_MARKED)
                for (int k = 0; k < 4; ++k)
                    both[k] = as_int(faces[4u * (rows[k] + 1) + 3]) != 0 ? -1 : 0;
            inside |= both & (wa <= 0.0f) & (wb <= 0.0f) & (wc <= 0.0f) & (total < 0.0f);
        }
        if (!bits_of(inside))
            continue;
        const Float4 t = (wa * corners[0].along + wb * corners[1].along + wc * corners[2].along) / total;
        for (unsigned left = bits_of(inside & (t < hit.depth) & (t > near)); left; left &= left - 1) {
            const int k = lowest_bit(left);
            const int met = lower_int(face + k, end - 1);
            if (t[k] < hit.depth && there(met, t[k])) {
                hit = { t[k], met };
                any = true;
            }
        }
    }
    return any;
}

// A child of a node, and where the ray enters its box.
struct Waiting {
    int node;
    float entry;
};

// A ray as boxes see it: which of a box's planes it comes through first, and those moved as Slabs says.
struct BoxRay {
    Vec scale, in, out;
    unsigned near_x, near_y, near_z, far_x, far_y, far_z;  // rows of a node

    explicit BoxRay(const Slabs& s): scale(s.scale)
    {
        const bool x = s.scale.x < 0.0f, y = s.scale.y < 0.0f, z = s.scale.z < 0.0f;
        near_x = x ? 3 : 0, near_y = y ? 4 : 1, near_z = z ? 5 : 2;
        far_x = x ? 0 : 3, far_y = y ? 1 : 4, far_z = z ? 2 : 5;
        in = { x ? s.up.x : s.down.x, y ? s.up.y : s.down.y, z ? s.up.z : s.down.z };
        out = { x ? s.down.x : s.up.x, y ? s.down.y : s.up.y, z ? s.down.z : s.up.z };
    }
};

// The nearest child of a node that the ray meets, or NO_NODE. The others wait on the stack, the farthest lowest.
inline int test_node(const float* nodes, int node, const BoxRay& ray, float near, float depth, Waiting* stack, int& height)
{
    const unsigned at = unsigned(node) * NODE_ROWS;
    const Float4 x0 = muladd4(load4(nodes, at + ray.near_x), ray.scale.x, ray.in.x);
    const Float4 y0 = muladd4(load4(nodes, at + ray.near_y), ray.scale.y, ray.in.y);
    const Float4 z0 = muladd4(load4(nodes, at + ray.near_z), ray.scale.z, ray.in.z);
    const Float4 x1 = muladd4(load4(nodes, at + ray.far_x), ray.scale.x, ray.out.x);
    const Float4 y1 = muladd4(load4(nodes, at + ray.far_y), ray.scale.y, ray.out.y);
    const Float4 z1 = muladd4(load4(nodes, at + ray.far_z), ray.scale.z, ray.out.z);
    const Float4 enter = upper4(upper4(x0, y0), upper4(z0, (Float4)near));
    const Float4 leave = lower4(lower4(x1, y1), lower4(z1, (Float4)depth));
    unsigned left = bits_of(enter <= leave);
    if (!left)
        return NO_NODE;
    const Int4 children = (Int4)load4(nodes, at + 6);
    int k = lowest_bit(left);
    left &= left - 1;
    Waiting best { children[k], enter[k] };
    const int bottom = height;
    for (; left; left &= left - 1) {
        k = lowest_bit(left);
        Waiting other { children[k], enter[k] };
        if (other.entry < best.entry) {
            const Waiting nearer = other;
            other = best;
            best = nearer;
        }
        int place = height++;
        for (; place > bottom && stack[place - 1].entry < other.entry; --place)
            stack[place] = stack[place - 1];
        stack[place] = other;
    }
    return best.node;
}

// Nearest face of one mesh that is nearer than `hit`; with ANY, the first one found. Says whether there is one.
template <int TYPES, bool ANY, class There>
inline bool walk_mesh(const float* nodes, const float* faces, const Slabs& slabs, const RayFrame& frame, float near,
                      const There& there, MeshHit& hit)
{
    Waiting stack[STACK];
    const BoxRay ray { slabs };
    int height = 0, node = 0;
    constexpr Sides SIDES = ANY && (TYPES >> SHADING_BACKS & 1) ? BOTH_SIDES
        : TYPES >> TWO_SIDED & 1 ? FRONTS_AND_MARKED : FRONTS;
    bool any = false;
    while (true) {
        while (node >= 0 && node != NO_NODE)
            node = test_node(nodes, node, ray, near, hit.depth, stack, height);
        if (node != NO_NODE) {
            const int code = -node - 1, first = code >> 4;
            any |= test_leaf<SIDES>(faces, first, first + (code & 15), frame, near, there, hit);
            if (ANY && any)
                return true;
        }
        do {
            if (height == 0)
                return any;
            --height;
        } while (stack[height].entry >= hit.depth);
        node = stack[height].node;
    }
}

template <class Meshes> inline const float* node_rows(const Meshes& meshes, int mesh)
{
    return reinterpret_cast<const float*>(meshes.nodes.data) + 4 * size_t(wp::index(meshes.node_start, mesh));
}

template <class Meshes> inline const float* face_rows(const Meshes& meshes, int mesh)
{
    return reinterpret_cast<const float*>(meshes.faces.data) + 4 * size_t(wp::index(meshes.face_start, mesh));
}

// Some front face, or any where backs shade, of any mesh among some records, nearer than `hit`. `words` are these records as bits by slot.
template <int TYPES, class Meshes, class RayOf>
inline void walk_meshes(const Meshes& meshes, const Record* records, const unsigned* words, int num_words,
                        const RayOf& source, float near, Hit& hit)
{
    for (int word = 0; word < num_words; ++word)
        for (unsigned left = words[word]; left; left &= left - 1) {
            const Record& record = records[word * 32 + lowest_bit(left)];
            const int mesh = record.axis_z.w;
            const Ray ray = source.local(record);
            const auto there = [&](int face, float t) { return is_there<TYPES>(meshes, record, ray, face, t); };
            MeshHit found { hit.depth, 0 };
            if (walk_mesh<TYPES, true>(node_rows(meshes, mesh), face_rows(meshes, mesh),
                                slabs(ray.origin, ray.direction, record.size.x), source.template frame<TYPES>(record), near, there, found)) {
                hit = { found.depth, record.axis_y.w, found.face };
                return;
            }
        }
}

// The nearest faces of a mesh for a tile's rays: those that miss its box, most of them, are found together.
template <int TYPES, int LENS, bool ANY = false, class Meshes, class Near, class Rays>
inline void trace_mesh(const Meshes& meshes, const Record& record, const Near& near, Rays& rays)
{
    const Record r = record;
    const int mesh = r.axis_z.w;
    const auto low = wp::index(meshes.lower, mesh), high = wp::index(meshes.upper, mesh);
    const float lx = low[0], ly = low[1], lz = low[2], ux = high[0], uy = high[1], uz = high[2];
    int met[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const Ray ray = ViewRay<LENS> { rays.x[lane], rays.y[lane] }.local(r);
        const Slabs s = slabs(ray.origin, ray.direction, r.size.x);
        const float x0 = lx * s.scale.x + s.down.x, x1 = ux * s.scale.x + s.up.x;
        const float y0 = ly * s.scale.y + s.down.y, y1 = uy * s.scale.y + s.up.y;
        const float z0 = lz * s.scale.z + s.down.z, z1 = uz * s.scale.z + s.up.z;
        const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), near.at(lane)));
        const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), rays.depth[lane]));
        met[lane] = enter <= leave;
    }
    for (int lane = 0; lane < LANES; ++lane) {
        if (!met[lane])
            continue;
        const ViewRay<LENS> source { rays.x[lane], rays.y[lane] };
        const Ray ray = source.local(r);
        const auto there = [&](int face, float t) { return is_there<TYPES>(meshes, r, ray, face, t); };
        MeshHit found { rays.depth[lane], 0 };
        if (!walk_mesh<TYPES, ANY>(node_rows(meshes, mesh), face_rows(meshes, mesh),
                              slabs(ray.origin, ray.direction, r.size.x), source.template frame<TYPES>(r),
                              near.at(lane), there, found))
            continue;
        rays.depth[lane] = found.depth;
        rays.shape[lane] = r.axis_y.w;
        rays.face[lane] = found.face;
    }
}

}  // namespace warpcam
