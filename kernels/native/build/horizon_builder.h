// Finds the horizons of a mesh's faces, see accel/horizon_map.h: each face by itself, on all that its mesh's tree has
// around it.
#pragma once
#include "accel/bvh4.h"
#include "accel/horizon_map.h"

namespace warpcam {

constexpr int MOST_VISITS = 1024;  // of nodes and leaves, by one face

// Extent of an object in a face's own axes: distances along and across from any point of the face, and height above it.
struct FromFace {
    float left, right, low, high, rise;
};

// A face that looks around.
struct HorizonSampler {
    static constexpr int LEAST = 2;  // what rises less counts as high as this: rays do not begin quite on the face

    Vec3 corners[3], places[3];  // places: along the axes
    FaceAxes axes;
    Vec3 least, most;  // of its corners, along its axes
    float slack;  // more than rounding moves what the mesh has
    unsigned risen;  // four bits a sector: 15 - clearance

    WARPCAM_DEVICE explicit HorizonSampler(const Vec3 (&its)[3], float extent)
        : corners { its[0], its[1], its[2] }, axes(face_axes(its[0], its[1], its[2])), slack(1.0e-6f * extent), risen(0)
    {
        for (int k = 0; k < 3; ++k)
            places[k] = axes.of(its[k]);
        bounds(places, least, most);
        for (int sector = 0; sector < SECTORS; ++sector)
            risen |= unsigned(LEAST) << 4 * sector;
    }

    WARPCAM_DEVICE static void bounds(const Vec3 (&points)[3], Vec3& from, Vec3& to)
    {
        from = to = points[0];
        for (int k = 1; k < 3; ++k) {
            const Vec3 p = points[k];
            from = { min(from.x, p.x), min(from.y, p.y), min(from.z, p.z) };
            to = { max(to.x, p.x), max(to.y, p.y), max(to.z, p.z) };
        }
    }

    // Extent of a box, given by two corners along the face's axes.
    WARPCAM_DEVICE FromFace around(Vec3 from, Vec3 to) const
    {
        return { from.x - most.x - slack, to.x - least.x + slack, from.y - most.y - slack, to.y - least.y + slack,
                 to.z - least.z };
    }

    WARPCAM_DEVICE FromFace around_box(Vec3 center, Vec3 half) const
    {
        const auto reach = [&](Vec3 n) { return abs(n.x) * half.x + abs(n.y) * half.y + abs(n.z) * half.z; };
        const Vec3 at = axes.of(center), out { reach(axes.along), reach(axes.across), reach(axes.normal) };
        return around(at - out, at + out);
    }

    // Sixteenths, rounded down, of what is so high and so far away.
    WARPCAM_DEVICE static int sixteenths(float rise, float away_squared)
    {
        return clamp(int(16.002f * rise * rsqrt(max(rise * rise + away_squared, MIN_NORMAL))), LEAST, 15);
    }

    // The sectors with what lies `around` in them: risen() as it would be, but for more than `most_risen`.
    WARPCAM_DEVICE unsigned with(const FromFace& it, int most_risen) const
    {
        unsigned all = risen;
        if (it.rise <= slack)
            return all;
#pragma unroll
        for (int quarter = 0; quarter < 4; ++quarter) {
            const float x0 = max(quarter & 1 ? -it.right : it.left, 0.0f), x1 = quarter & 1 ? -it.left : it.right;
            const float y0 = max(quarter & 2 ? -it.high : it.low, 0.0f), y1 = quarter & 2 ? -it.low : it.high;
            if (x1 < 0.0f || y1 < 0.0f)
                continue;
            const unsigned level = unsigned(min(sixteenths(it.rise, x0 * x0 + y0 * y0), most_risen));
            if (x1 >= y0)
                all = raised(all, quarter, level);
            if (y1 >= x0)
                all = raised(all, quarter + 4, level);
        }
        return all;
    }

    WARPCAM_DEVICE static unsigned raised(unsigned all, int sector, unsigned level)
    {
        const unsigned before = all >> 4 * sector & 15u;
        return level > before ? all + ((level - before) << 4 * sector) : all;
    }

    // Bound on the slope at which another face rises as seen from this one, along one direction in this face's plane:
    // every part of the other face that lies `out` beyond this face is at least that far away. No point between its
    // corners rises more steeply than one of these ratios of height to distance. MISS if the other face does not lie
    // beyond.
    WARPCAM_DEVICE float steepness(const Vec3 (&others)[3], float x, float y) const
    {
        const float rate = rsqrt(max(x * x + y * y, MIN_NORMAL));
        float end = -MISS, steepest = 0.0f;
        for (int k = 0; k < 3; ++k)
            end = max(end, rate * (x * places[k].x + y * places[k].y));
        for (int k = 0; k < 3; ++k) {
            const float out = rate * (x * others[k].x + y * others[k].y) - end, rise = others[k].z - least.z;
            if (out < -slack || (rise > slack && out <= slack))
                return MISS;
            if (rise > slack)
                steepest = max(steepest, rise / (out - slack));
        }
        return steepest;
    }

    // Looks at another face.
    WARPCAM_DEVICE void look_at(const Vec3 (&others)[3])
    {
        const Vec3 there[3] = { axes.of(others[0]), axes.of(others[1]), axes.of(others[2]) };
        Vec3 from, to;
        bounds(there, from, to);
        const FromFace it = around(from, to);
        if (with(it, 15) == risen)
            return;
        const Vec3 n = cross(others[1] - others[0], others[2] - others[0]);
        const float rate = rsqrt(max(dot(n, n), MIN_NORMAL));
        float before = MISS;
        for (int k = 0; k < 3; ++k)
            before = min(before, rate * dot(n, corners[k] - others[0]));
        int most_risen = 15;
        // If all of the own lies in front of one that is turned the same way by less than a right angle, rays that rise
        // more than that angle lead away.
        if (before >= -slack && dot(n, axes.normal) > 0.0f && dot(n, n) > 100.0f * MIN_NORMAL) {
            const Vec3 sine = rate * cross(n, axes.normal);
            most_risen = sixteenths(sqrt(dot(sine, sine)), max(1.0f - dot(sine, sine), 0.0f));
        }
        float steepest = MISS;  // looking across the edges of both
        for (int k = 0; k < 3; ++k) {
            const int next = k == 2 ? 0 : k + 1;
            const Vec3 own = places[next] - places[k], edge = there[next] - there[k];
            steepest = min(steepest, steepness(there, own.y, -own.x));
            steepest = min(steepest, min(steepness(there, edge.y, -edge.x), steepness(there, -edge.y, edge.x)));
        }
        if (steepest < 1.0e6f)
            most_risen = min(most_risen, sixteenths(steepest, 1.0f));
        risen = with(it, most_risen);
    }
};

// One of a node's children and its box, as the device has them where no mesh moves: see Meshes.nodes.
struct NodeChild {
    Vec3 low, high;
    int child;
    bool there;
};

template <class Meshes>
WARPCAM_DEVICE NodeChild child_of(const Meshes& meshes, unsigned nodes, int node, int number, float extent)
{
    const auto word = [&](unsigned row) {
        const Float3Int four = load(meshes.nodes.data, row);
        return number == 0 ? as_int(four.x) : number == 1 ? as_int(four.y) : number == 2 ? as_int(four.z) : four.w;
    };
    NodeChild it;
#if defined(__CUDA_ARCH__)
    const unsigned first = nodes + unsigned(node * SHORT_NODE_ROWS);
    const int x = word(first), y = word(first + 1), z = word(first + 2);
    const auto bound = [&](int halves) { return extent * BOUND_CELL * float((halves & 0xffff) - MIDDLE_BOUND); };
    it.low = { bound(x), bound(y), bound(z) };
    it.high = { bound(x >> 16), bound(y >> 16), bound(z >> 16) };
    it.child = word(first + 3);
#else
    const unsigned first = nodes + unsigned(node * NODE_ROWS);
    it.low = { as_float(word(first)), as_float(word(first + 1)), as_float(word(first + 2)) };
    it.high = { as_float(word(first + 3)), as_float(word(first + 4)), as_float(word(first + 5)) };
    it.child = word(first + 6);
#endif
    it.there = it.low.x <= it.high.x && it.low.x < 1.0e29f;
    return it;
}

// A mesh whose faces look around, each by its number in leaf order.
template <class Meshes> struct MeshFaces {
    const Meshes& meshes;
    unsigned nodes, faces;
    Vec3 low, high;
    float extent;  // of what rounding says [m]

    WARPCAM_DEVICE MeshFaces(const Meshes& all, int mesh)
        : meshes(all), nodes(unsigned(wp::index(all.node_start, mesh))),
          faces(unsigned(wp::index(all.face_start, mesh))), low(as_vec3(wp::index(all.bounds_min, mesh))),
          high(as_vec3(wp::index(all.bounds_max, mesh)))
    {
        extent = max(max(max(abs(low.x), abs(low.y)), max(abs(low.z), abs(high.x))), max(abs(high.y), abs(high.z)));
    }

    // The face's corners, and the number that it was given.
    WARPCAM_DEVICE int load_face(int number, Vec3 (&corners)[3]) const
    {
        const unsigned row = faces + unsigned(number * FACE_ROWS);
        const Float3Int first = load(meshes.faces.data, row);
        corners[0] = as_vec3(first);
        corners[1] = as_vec3(load(meshes.faces.data, row + 1));
        corners[2] = as_vec3(load(meshes.faces.data, row + 2));
        return first.w;
    }

    WARPCAM_DEVICE NodeChild child_of(int node, int child) const
    {
        return warpcam::child_of(meshes, nodes, node, child, extent);
    }
};

// Writes the horizon of a mesh's face, in leaf order.
template <class Meshes> WARPCAM_DEVICE void find_horizon(const Meshes& meshes, int mesh, int face)
{
    const MeshFaces<Meshes> around(meshes, mesh);
    Vec3 corners[3];
    const int given = around.load_face(face, corners);
    HorizonSampler own(corners, around.extent);
    int stack[STACK + 4], height = 0;
    if (own.axes.reliable)
        stack[height++] = 0;
    else
        own.risen = FULL_WARP;
    for (int visits = 0; height > 0 && own.risen != FULL_WARP; ++visits) {
        if (visits == MOST_VISITS) {  // of what has so much around it nothing is said
            own.risen = FULL_WARP;
            break;
        }
        const int node = stack[--height];
        if (node < 0) {
            const int code = -node - 1, first = code >> 4, end = first + (code & 15);
            for (int other = first; other < end; ++other)
                if (around.load_face(other, corners) != given)
                    own.look_at(corners);
            continue;
        }
        for (int child = 0; child < 4; ++child) {
            const NodeChild it = around.child_of(node, child);
            if (it.there
                && own.with(own.around_box(0.5f * (it.low + it.high), 0.5f * (it.high - it.low)), 15) != own.risen)
                stack[height++] = it.child;
        }
    }
    reinterpret_cast<Float3Int*>(meshes.faces.data)[around.faces + unsigned(face * FACE_ROWS) + 2].w = int(~own.risen);
}

}  // namespace warpcam
