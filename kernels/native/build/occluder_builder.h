// Finds occluder boxes of meshes, see shadow/occluder_boxes.h: boxes over a face, each by a thread, that go on until
// the mesh is in the way.
#pragma once
#include "build/horizon_builder.h"
#include "shadow/occluder_boxes.h"

namespace warpcam {
constexpr int OCCLUDER_TURNS = 4, OCCLUDER_SLABS = 24, OCCLUDER_FORMS = 5;
constexpr int OCCLUDER_VISITS = 8192;  // of nodes and leaves, for one box

// A box over a face: an end above it and one below, and how far it goes across and up in several forms.
struct OccluderCandidate {
    static constexpr float WIDEST = 2.5f;  // of a form: this much wider than a square, and narrower

    FaceAxes axes;
    Vec3 center;
    float low, high, inner, slack;
    float reach[OCCLUDER_FORMS];

    WARPCAM_DEVICE static float form(int number)  // how much wider than a square
    {
        constexpr float forms[OCCLUDER_FORMS] = { 1.0f / WIDEST, 0.63f, 1.0f, 1.6f, WIDEST };
        return forms[number];
    }

    WARPCAM_DEVICE float widest() const
    {
        float most = 0.0f;
        for (int k = 0; k < OCCLUDER_FORMS; ++k)
            most = max(most, reach[k]);
        return most;
    }

    // Ends the box before an object that lies at least so far across and up.
    WARPCAM_DEVICE void end_at(float across, float up)
    {
        for (int k = 0; k < OCCLUDER_FORMS; ++k)
            reach[k] = min(reach[k], max(across / form(k), up * form(k)));
    }

    WARPCAM_DEVICE static float min_abs(float from, float to) { return max(max(from, -to), 0.0f); }

    // True if an object in a box may be in the way.
    WARPCAM_DEVICE bool may_meet(Vec3 low_corner, Vec3 high_corner) const
    {
        const Vec3 at = axes.of(0.5f * (low_corner + high_corner) - center), half = 0.5f * (high_corner - low_corner);
        const auto out = [&](Vec3 n) { return abs(n.x) * half.x + abs(n.y) * half.y + abs(n.z) * half.z; };
        const float z = out(axes.normal), x = out(axes.along), y = out(axes.across);
        if (at.z - z > high + slack || at.z + z < low - slack)
            return false;
        const float across = min_abs(at.x - x, at.x + x), up = min_abs(at.y - y, at.y + y);
        bool meets = false;
        for (int k = 0; k < OCCLUDER_FORMS; ++k)
            meets |= max(across / form(k), up * form(k)) < reach[k];
        return meets;
    }

    // A face of the mesh. `own`: the one that the box is over; `open`: an odd number of faces has one of its edges.
    WARPCAM_DEVICE void look_at(const Vec3 (&corners)[3], bool own, bool open)
    {
        Vec3 places[3], from, to;
        for (int k = 0; k < 3; ++k)
            places[k] = axes.of(corners[k] - center);
        HorizonSampler::bounds(places, from, to);
        if (from.z > high + slack || to.z < low - slack)
            return;
        const float across = min_abs(from.x, to.x), up = min_abs(from.y, to.y);
        const bool within = from.z > low + slack && to.z < high - slack;
        if (!within || open)
            end_at(across, up);
        else if (!own && across < inner && up < inner && is_near(places))
            end_at(0.0f, 0.0f);  // the surface would be crossed twice here
    }

    WARPCAM_DEVICE bool is_near(const Vec3 (&places)[3]) const
    {
        bool left = true, right = true, near = false;
        for (int k = 0; k < 3; ++k) {
            const Vec3 a = places[k], b = places[k == 2 ? 0 : k + 1], e = b - a;
            const float side = a.x * b.y - a.y * b.x, length = e.x * e.x + e.y * e.y;
            left &= side >= 0.0f;
            right &= side <= 0.0f;
            const float t = min(max(-(a.x * e.x + a.y * e.y) / max(length, MIN_NORMAL), 0.0f), 1.0f);
            const float x = a.x + t * e.x, y = a.y + t * e.y;
            near |= x * x + y * y < inner * inner;
        }
        return left || right || near;
    }
};

// Orientation of a box over its face, turned about the face's normal, and its ends.
struct Way {
    int turn, slab;

    WARPCAM_DEVICE explicit Way(int number) : turn(number % OCCLUDER_TURNS), slab(number / OCCLUDER_TURNS) {}
};

// A box over a mesh's face, in leaf order, as far as it goes: how much it is worth, and its rows, if there is room for
// them.
template <class Meshes, class Open, class Rows>
WARPCAM_DEVICE float find_occluder_box(const Meshes& meshes, const Open& open, int mesh, int face, Way way, int at,
                                       const Rows& rows)
{
    const MeshFaces<Meshes> around(meshes, mesh);
    const Vec3 sides = around.high - around.low;
    const float size = max(max(sides.x, sides.y), sides.z);
    Vec3 corners[3];
    const int given = around.load_face(face, corners);
    OccluderCandidate box;
    FaceAxes axes = face_axes(corners[0], corners[1], corners[2]);
    if (!axes.reliable)
        return 0.0f;
    // along a side of the mesh's own box, then turned
    const Vec3 n = axes.normal;
    const float x = abs(n.x), y = abs(n.y), z = abs(n.z);
    const Vec3 flat = x <= y && x <= z ? Vec3 { 1.0f, 0.0f, 0.0f }
                      : y <= z         ? Vec3 { 0.0f, 1.0f, 0.0f }
                                       : Vec3 { 0.0f, 0.0f, 1.0f };
    const Vec3 first = cross(n, flat);
    const Vec3 side = rsqrt(max(dot(first, first), MIN_NORMAL)) * first, other = cross(n, side);
    const float angle = 1.5707964f / OCCLUDER_TURNS * float(way.turn);
    axes.along = wp::cos(angle) * side + wp::sin(angle) * other;
    axes.across = cross(n, axes.along);
    box.axes = axes;
    box.center = (1.0f / 3.0f) * (corners[0] + corners[1] + corners[2]);
    box.slack = 2.0e-5f * around.extent;
    float inner = MISS;
    for (int k = 0; k < 3; ++k) {
        const Vec3 edge = corners[k == 2 ? 0 : k + 1] - corners[k], away = cross(edge, box.center - corners[k]);
        inner = min(inner, sqrt(dot(away, away) / max(dot(edge, edge), MIN_NORMAL)));
    }
    box.inner = 0.5f * inner;
    float thick = 0.3f * size;
    for (int k = 0; k < way.slab / 3; ++k)
        thick *= 0.6f;
    const float thin = 2.0e-3f * size + 2.0f * box.slack;
    const int side_of_face = way.slab % 3;
    box.low = side_of_face == 0 ? -thick : side_of_face == 1 ? -thin : -0.5f * thick;
    box.high = side_of_face == 0 ? thin : side_of_face == 1 ? thick : 0.5f * thick;
    for (int k = 0; k < OCCLUDER_FORMS; ++k)
        box.reach[k] = size;
    const float depth = box.high - box.low;
    int stack[STACK + 4], height = 0;
    stack[height++] = 0;
    for (int visits = 0; height > 0 && box.widest() > depth; ++visits) {
        if (visits == OCCLUDER_VISITS)  // so much lies in it that it is not worth the search
            return 0.0f;
        const int node = stack[--height];
        if (node < 0) {
            const int code = -node - 1, start = code >> 4, end = start + (code & 15);
            for (int number = start; number < end; ++number) {
                const int its = around.load_face(number, corners);
                box.look_at(corners, its == given, wp::index(open, int(around.faces) / FACE_ROWS + number) != 0);
            }
            continue;
        }
        for (int child = 0; child < 4; ++child) {
            const NodeChild it = around.child_of(node, child);
            if (it.there && box.may_meet(it.low, it.high))
                stack[height++] = it.child;
        }
    }
    float best = 0.0f, across = 0.0f, up = 0.0f;
    for (int k = 0; k < OCCLUDER_FORMS; ++k) {
        const float half_across = box.reach[k] * OccluderCandidate::form(k) - box.slack,
                    half_up = box.reach[k] / OccluderCandidate::form(k) - box.slack;
        const float area = max(half_across - depth, 0.0f) * max(half_up - depth, 0.0f);  // of what slanting rays pass
        if (area > best) {
            best = area;
            across = half_across;
            up = half_up;
        }
    }
    if (!(best > 0.0f) || rows.shape[0] == 0)
        return best;
    const Vec3 middle = box.center + 0.5f * (box.low + box.high) * n;
    const auto row = [&](int number, Vec3 axis, float half) {
        const float rate = 1.0f / half;
        reinterpret_cast<Float3Int*>(rows.data)[OCCLUDER_ROWS * at + number] = { rate * axis.x, rate * axis.y,
                                                                                 rate * axis.z,
                                                                                 as_int(-rate * dot(axis, middle)) };
    };
    row(0, axes.along, across);
    row(1, axes.across, up);
    row(2, n, 0.5f * depth);
    return best;
}

}  // namespace warpcam
