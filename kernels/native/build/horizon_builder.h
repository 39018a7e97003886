// Finds the horizons of a mesh's faces, see accel/horizon_map.h: each face by itself, on all that its mesh's tree has
// around it.
#pragma once
#include "accel/bvh4.h"
#include "accel/horizon_map.h"

namespace warpcam {

constexpr int MOST_VISITS = 1024;  // of nodes and leaves, by one face

// Where something lies, by a face's own axes: how far along and across from any place on the face, and how high it
// rises.
struct FromFace {
    float left, right, low, high, rise;
};

// A face that looks around.
struct Onlooker {
    static constexpr int LEAST = 2;  // what rises less counts as high as this: rays do not begin quite on the face

    Vec corners[3], places[3];  // places: along the axes
    FaceAxes axes;
    Vec least, most;  // of its corners, along its axes
    float slack;      // more than rounding moves what the mesh has
    unsigned risen;   // four bits a sector: 15 - clearance

    WARPCAM_FN explicit Onlooker(const Vec (&its)[3], float extent)
        : corners { its[0], its[1], its[2] }, axes(face_axes(its[0], its[1], its[2])), slack(1.0e-6f * extent), risen(0)
    {
        for (int k = 0; k < 3; ++k)
            places[k] = axes.of(its[k]);
        bounds(places, least, most);
        for (int sector = 0; sector < SECTORS; ++sector)
            risen |= unsigned(LEAST) << 4 * sector;
    }

    WARPCAM_FN static void bounds(const Vec (&points)[3], Vec& from, Vec& to)
    {
        from = to = points[0];
        for (int k = 1; k < 3; ++k) {
            const Vec p = points[k];
            from = { lower(from.x, p.x), lower(from.y, p.y), lower(from.z, p.z) };
            to = { upper(to.x, p.x), upper(to.y, p.y), upper(to.z, p.z) };
        }
    }

    // Of what lies between two corners of a box along the face's axes.
    WARPCAM_FN FromFace around(Vec from, Vec to) const
    {
        return { from.x - most.x - slack, to.x - least.x + slack, from.y - most.y - slack, to.y - least.y + slack,
                 to.z - least.z };
    }

    WARPCAM_FN FromFace around_box(Vec center, Vec half) const
    {
        const auto reach = [&](Vec n) {
            return magnitude(n.x) * half.x + magnitude(n.y) * half.y + magnitude(n.z) * half.z;
        };
        const Vec at = axes.of(center), out { reach(axes.along), reach(axes.across), reach(axes.normal) };
        return around(at - out, at + out);
    }

    // Sixteenths, rounded down, of what is so high and so far away.
    WARPCAM_FN static int sixteenths(float rise, float away_squared)
    {
        return between(int(16.002f * rise * inverse_root(upper(rise * rise + away_squared, TINY))), LEAST, 15);
    }

    // The sectors with what lies `around` in them: risen() as it would be, but for more than `most_risen`.
    WARPCAM_FN unsigned with(const FromFace& it, int most_risen) const
    {
        unsigned all = risen;
        if (it.rise <= slack)
            return all;
#pragma unroll
        for (int quarter = 0; quarter < 4; ++quarter) {
            const float x0 = upper(quarter & 1 ? -it.right : it.left, 0.0f), x1 = quarter & 1 ? -it.left : it.right;
            const float y0 = upper(quarter & 2 ? -it.high : it.low, 0.0f), y1 = quarter & 2 ? -it.low : it.high;
            if (x1 < 0.0f || y1 < 0.0f)
                continue;
            const unsigned level = unsigned(lower_int(sixteenths(it.rise, x0 * x0 + y0 * y0), most_risen));
            if (x1 >= y0)
                all = raised(all, quarter, level);
            if (y1 >= x0)
                all = raised(all, quarter + 4, level);
        }
        return all;
    }

    WARPCAM_FN static unsigned raised(unsigned all, int sector, unsigned level)
    {
        const unsigned before = all >> 4 * sector & 15u;
        return level > before ? all + ((level - before) << 4 * sector) : all;
    }

    // How steeply another face can rise as seen from this one, as far as that shows along one way in the own plane:
    // what of it lies `out` beyond all of the own is at least so far away. As heights are to distances, so rises no
    // point between its corners more steeply than one of these. FAR_AWAY where it does not lie beyond.
    WARPCAM_FN float steepness(const Vec (&others)[3], float x, float y) const
    {
        const float rate = inverse_root(upper(x * x + y * y, TINY));
        float end = -FAR_AWAY, steepest = 0.0f;
        for (int k = 0; k < 3; ++k)
            end = upper(end, rate * (x * places[k].x + y * places[k].y));
        for (int k = 0; k < 3; ++k) {
            const float out = rate * (x * others[k].x + y * others[k].y) - end, rise = others[k].z - least.z;
            if (out < -slack || (rise > slack && out <= slack))
                return FAR_AWAY;
            if (rise > slack)
                steepest = upper(steepest, rise / (out - slack));
        }
        return steepest;
    }

    // Looks at another face.
    WARPCAM_FN void look_at(const Vec (&others)[3])
    {
        const Vec there[3] = { axes.of(others[0]), axes.of(others[1]), axes.of(others[2]) };
        Vec from, to;
        bounds(there, from, to);
        const FromFace it = around(from, to);
        if (with(it, 15) == risen)
            return;
        const Vec n = cross(others[1] - others[0], others[2] - others[0]);
        const float rate = inverse_root(upper(dot(n, n), TINY));
        float before = FAR_AWAY;
        for (int k = 0; k < 3; ++k)
            before = lower(before, rate * dot(n, corners[k] - others[0]));
        int most_risen = 15;
        // If all of the own lies in front of one that is turned the same way by less than a right angle, rays that rise
        // more than that angle lead away.
        if (before >= -slack && dot(n, axes.normal) > 0.0f && dot(n, n) > 100.0f * TINY) {
            const Vec sine = rate * cross(n, axes.normal);
            most_risen = sixteenths(root(dot(sine, sine)), upper(1.0f - dot(sine, sine), 0.0f));
        }
        float steepest = FAR_AWAY;  // looking across the edges of both
        for (int k = 0; k < 3; ++k) {
            const int next = k == 2 ? 0 : k + 1;
            const Vec own = places[next] - places[k], edge = there[next] - there[k];
            steepest = lower(steepest, steepness(there, own.y, -own.x));
            steepest = lower(steepest, lower(steepness(there, edge.y, -edge.x), steepness(there, -edge.y, edge.x)));
        }
        if (steepest < 1.0e6f)
            most_risen = lower_int(most_risen, sixteenths(steepest, 1.0f));
        risen = with(it, most_risen);
    }
};

// One of a node's children and its box, as the device has them where no mesh moves: see Meshes.nodes.
struct NodeChild {
    Vec low, high;
    int child;
    bool there;
};

template <class Meshes>
WARPCAM_FN NodeChild child_of(const Meshes& meshes, unsigned nodes, int node, int number, float extent)
{
    const auto word = [&](unsigned row) {
        const Row four = load(meshes.nodes.data, row);
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
    Vec low, high;
    float extent;  // of what rounding says [m]

    WARPCAM_FN MeshFaces(const Meshes& all, int mesh)
        : meshes(all), nodes(unsigned(wp::index(all.node_start, mesh))),
          faces(unsigned(wp::index(all.face_start, mesh))), low(to_vec(wp::index(all.lower, mesh))),
          high(to_vec(wp::index(all.upper, mesh)))
    {
        extent = upper(upper(upper(magnitude(low.x), magnitude(low.y)), upper(magnitude(low.z), magnitude(high.x))),
                       upper(magnitude(high.y), magnitude(high.z)));
    }

    // The face's corners, and the number that it was given.
    WARPCAM_FN int load_face(int number, Vec (&corners)[3]) const
    {
        const unsigned row = faces + unsigned(number * FACE_ROWS);
        const Row first = load(meshes.faces.data, row);
        corners[0] = to_vec(first);
        corners[1] = to_vec(load(meshes.faces.data, row + 1));
        corners[2] = to_vec(load(meshes.faces.data, row + 2));
        return first.w;
    }

    WARPCAM_FN NodeChild child_of(int node, int child) const
    {
        return warpcam::child_of(meshes, nodes, node, child, extent);
    }
};

// Writes the horizon of a mesh's face, in leaf order.
template <class Meshes> WARPCAM_FN void find_horizon(const Meshes& meshes, int mesh, int face)
{
    const MeshFaces<Meshes> around(meshes, mesh);
    Vec corners[3];
    const int given = around.load_face(face, corners);
    Onlooker own(corners, around.extent);
    int stack[STACK + 4], height = 0;
    if (own.axes.known)
        stack[height++] = 0;
    else
        own.risen = ALL;
    for (int visits = 0; height > 0 && own.risen != ALL; ++visits) {
        if (visits == MOST_VISITS) {  // of what has so much around it nothing is said
            own.risen = ALL;
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
    reinterpret_cast<Row*>(meshes.faces.data)[around.faces + unsigned(face * FACE_ROWS) + 2].w = int(~own.risen);
}

}  // namespace warpcam
