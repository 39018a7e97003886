// How a shape has moved in a camera's image since its world was last drawn.
#pragma once
#include "flow_places.h"

namespace warpcam {

// What of a surface was farther than what was seen around it was hidden: by more than this part of its depth and so many
// of a pixel's widths there. Of what bends inwards neighbouring pixels may be nearer than what lies between them.
constexpr float FARTHER = 0.004f, CONVEX = 0.25f, HOLLOW = 1.0f;

// So many of the 256 steps in which depths are counted may what is compared be apart, of which eight bits are kept.
constexpr float MOST_APART = 120.0f;

struct Reach {
    float part, shift;  // of a depth, and what is added to it [m]: nothing nearer may have been seen at a point's place
};

template <class View> WARPCAM_FN Reach reach_of(int kind, const View& view, bool pinhole)
{
    const bool hollow = kind == MESH || kind == HEIGHT_FIELD || kind == SPLATS;
    const float pixel = upper(view.scale[0], view.scale[1]);
    const float wide = kind == PLANE ? 0.0f : (hollow ? HOLLOW : CONVEX) * pixel;  // a plane hides nothing of itself
    if (pinhole)
        return { reciprocal(1.0f + FARTHER + wide), 0.0f };
    return { 1.0f / (1.0f + FARTHER), -wide };
}

// Where a shape is and which.
struct Pose {
    wp::vec3 position;
    wp::mat33 rotation;
    wp::vec3 size;
    int asset;
};

// Steps a metre in which the depths of a convex shape are counted.
template <class View> WARPCAM_FN float steps_of(int kind, const Pose& pose, const View& view, bool pinhole)
{
    if (kind == PLANE)
        return 0.0f;
    const wp::vec3 size = pose.size;
    wp::vec3 half = size;
    if (kind == SPHERE)
        half = wp::vec3(size[0], size[0], size[0]);
    else if (kind == CAPSULE)
        half = wp::vec3(size[0], size[0], size[0] + size[1]);
    else if (kind == CYLINDER || kind == CONE)
        half = wp::vec3(size[0], size[0], size[1]);
    else if (kind == BARREL)  // its side is bent by less than its half length
        half = wp::vec3(size[0] + size[1], size[0] + size[1], size[1]);
    const wp::vec3 axis(view.rotation.data[0][2], view.rotation.data[1][2], view.rotation.data[2][2]);
    const wp::vec3 along = wp::mul(wp::transpose(pose.rotation), axis);
    const float radius = magnitude(along[0]) * half[0] + magnitude(along[1]) * half[1] + magnitude(along[2]) * half[2];
    const float farthest = magnitude(wp::dot(axis, wp::sub(view.origin, pose.position))) + radius;
    const Reach reach = reach_of(kind, view, pinhole);
    return MOST_APART
        * reciprocal(upper(2.0f * radius + (1.0f - reach.part) * farthest - reach.shift, 1.0e-6f * farthest + 1.0e-12f));
}

WARPCAM_FN float ratio(float then, float now) { return now == 0.0f ? 1.0f : then * reciprocal(now); }

// How many times as large the shape was along its axes.
WARPCAM_FN wp::vec3 stretch(int kind, wp::vec3 then, wp::vec3 now, bool scaled)
{
    if (kind == PLANE || ((kind == MESH || kind == HEIGHT_FIELD) && !scaled))
        return wp::vec3(1.0f, 1.0f, 1.0f);
    const float x = ratio(then[0], now[0]);
    if (kind == SPHERE)
        return wp::vec3(x, x, x);
    const float y = ratio(then[1], now[1]);
    if (kind == CAPSULE || kind == CYLINDER || kind == CONE || kind == BARREL)
        return wp::vec3(x, x, y);
    return wp::vec3(x, y, ratio(then[2], now[2]));
}

WARPCAM_FN void put_row(Row* rows, int row, float x, float y, float z, float w)
{
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(rows + row) = make_float4(x, y, z, w);
#else
    rows[row] = { x, y, z, as_int(w) };
#endif
}

// To the same pixel, but to a depth behind the camera.
WARPCAM_FN void put_unknown(Row* motion)
{
    put_row(motion, 0, 1.0f, 0.0f, 0.0f, 0.0f);
    put_row(motion, 1, 0.0f, 1.0f, 0.0f, 0.0f);
    put_row(motion, 2, 0.0f, 0.0f, 0.0f, -1.0f);
}

// A shape's rows of ShapesPast.rows.
WARPCAM_FN Pose pose_before(const Row* before)
{
    const Row a = load(before, 0), b = load(before, 1), c = load(before, 2), d = load(before, 3);
    return { wp::vec3(a.x, a.y, a.z), wp::mat33(b.x, b.y, b.z, c.x, c.y, c.z, d.x, d.y, d.z),
             wp::vec3(as_float(a.w), as_float(b.w), as_float(c.w)), d.w };
}

WARPCAM_FN void keep_pose(Row* before, const Pose& pose)
{
    const auto& r = pose.rotation.data;
    put_row(before, 0, pose.position[0], pose.position[1], pose.position[2], pose.size[0]);
    put_row(before, 1, r[0][0], r[0][1], r[0][2], pose.size[1]);
    put_row(before, 2, r[1][0], r[1][1], r[1][2], pose.size[2]);
    put_row(before, 3, r[2][0], r[2][1], r[2][2], as_float(pose.asset));
}

// Writes the rows of Trail.motions that a shape has, and its pose now to `after`, if not null: `before` itself or another.
template <bool MOVES, class Trail, class Shapes, class Views>
WARPCAM_FN void compose_motion(const Trail& trail, const Shapes& shapes, const Views& views, int world, int shape,
                               bool pinhole, bool scaled, bool brief, const Row* before, Row* after, Row* motion)
{
    // All is loaded before the first decision: memory is waited for once.
    const Pose old = pose_before(before);
    const Pose pose { wp::index(shapes.positions, world, shape), wp::index(shapes.rotations, world, shape),
                      shared_row(shapes.sizes, world, shape), shared_row(shapes.assets, world, shape) };
    const auto now = wp::index(views, world), then = wp::index(trail.views_before, world);
    const int state = wp::index(trail.known, world), kind = wp::index(shapes.types, shape);
    if (wp::index(shapes.places, shape) < 0 && kind != SPLATS)
        return;
    const float steps = brief ? steps_of(kind, pose, now, pinhole) : 0.0f;
    if (state == NEW) {
        put_unknown(motion);
        put_row(motion, 3, 0.0f, 0.0f, 0.0f, brief ? steps : as_float(-2));
        if (after)
            keep_pose(after, pose);
        return;
    }
    const bool same = old.position == pose.position && old.rotation == pose.rotation && old.size == pose.size
        && old.asset == pose.asset;
    if (after && !(same && after == before))
        keep_pose(after, pose);
    const wp::vec3 grown = old.size == pose.size ? wp::vec3(1.0f, 1.0f, 1.0f) : stretch(kind, old.size, pose.size, scaled);
    // By how much a point of the shape, then one of the camera's frame, was elsewhere: 0 if nothing has moved.
    const wp::mat33 turn = wp::mul(wp::sub(wp::mul(old.rotation, wp::diag(grown)), pose.rotation), wp::transpose(pose.rotation));
    const wp::mat33 back = wp::transpose(then.rotation);
    const wp::vec3 away = wp::add(wp::sub(now.origin, then.origin), wp::sub(old.position, pose.position));
    const wp::vec3 shift = wp::mul(back, wp::add(away, wp::mul(turn, wp::sub(now.origin, pose.position))));
    const wp::mat33 motion_of = wp::add(wp::mul(wp::sub(back, wp::transpose(now.rotation)), now.rotation),
                                        wp::mul(wp::mul(back, turn), now.rotation));
    float moved = wp::dot(shift, shift) + wp::ddot(motion_of, motion_of);
    moved += wp::length_sq(wp::sub(now.center, then.center)) + wp::length_sq(wp::sub(now.scale, then.scale));
    // From pixels, and to pixels as they were. The camera looks along -z, and rows run down.
    wp::mat33 into(reciprocal(then.scale[0]), 0.0f, 0.0f, 0.0f, -reciprocal(then.scale[1]), 0.0f, 0.0f, 0.0f, -1.0f);
    wp::vec3 middle(then.center[0] - 0.5f, then.center[1] - 0.5f, 0.0f);
    if (pinhole) {
        into.data[0][2] = -middle[0];
        into.data[1][2] = -middle[1];
        middle = wp::vec3(0.0f, 0.0f, 0.0f);
    }
    const int corner = MOVES && kind == MESH && pose.asset >= 0 ? wp::index(trail.corner_starts, pose.asset) : -1;
    const bool known = wp::isfinite(moved) && old.asset == pose.asset;
    if (!known) {
        put_unknown(motion);
    } else if (moved != 0.0f || corner >= 0) {
        const wp::mat33 whole = wp::mul(into, wp::add(wp::diag(wp::vec3(1.0f, 1.0f, 1.0f)), motion_of));
        const wp::mat33 out = wp::mul(whole, wp::diag(wp::vec3(now.scale[0], -now.scale[1], -1.0f)));
        const wp::vec3 end = wp::add(wp::mul(into, shift), middle);
        for (int i = 0; i < 3; ++i) {
            const float x = out.data[i][0], y = out.data[i][1], z = out.data[i][2];
            const float start = x * (0.5f - now.center[0]) + y * (0.5f - now.center[1]);  // of pixel (0, 0)
            if (pinhole)
                put_row(motion, i, x, y, z + start, end[i]);
            else
                put_row(motion, i, x, y, z, end[i] + start);
        }
    }
    if (MOVES && corner >= 0) {
        wp::mat33 within = wp::mul(wp::mul(into, back), old.rotation);
        if (scaled)
            within = wp::mul(within, wp::diag(old.size));
        for (int i = 0; i < 3; ++i)
            put_row(motion, 4 + i, within.data[i][0], within.data[i][1], within.data[i][2], 0.0f);
    }
    Reach reach = reach_of(kind, then, pinhole);
    if (kind == PLANE)
        reach.shift = -1.0e30f;
    const bool rests = known && moved == 0.0f;
    if (brief) {
        const float old_steps = steps_of(kind, old, then, pinhole);
        put_row(motion, 3, reach.part * old_steps, reach.shift * old_steps, rests && corner < 0 ? -1.0f : then.near, steps);
    } else {
        put_row(motion, 3, reach.part, reach.shift, then.near, as_float(known ? 2 * corner + int(rests) : -2));
    }
}

// A shape of a world by a thread; `index` counts worlds, then shapes.
template <class Shapes, class Views, class Mask, class Trail>
WARPCAM_FN void write_motion(const Shapes& shapes, const Views& views, const Mask& mask, const Trail& trail, bool pinhole,
                             bool scaled, bool brief, bool keep, bool moves, int index)
{
    const int world = index / trail.columns, shape = index - world * trail.columns;
    if (!wp::index(mask, world))
        return;
    Row* motion = reinterpret_cast<Row*>(trail.motions.data)
        + (moves ? motion_rows<true>() : motion_rows<false>()) * size_t(unsigned(index));
    Row* before = reinterpret_cast<Row*>(trail.before.data) + 4 * size_t(unsigned(index));
    Row* after = keep ? before : nullptr;
    if (moves)
        compose_motion<true>(trail, shapes, views, world, shape, pinhole, scaled, brief, before, after, motion);
    else
        compose_motion<false>(trail, shapes, views, world, shape, pinhole, scaled, brief, before, after, motion);
}

// The same for all shapes of a world, by the threads of a block, into its shared memory; the last threads do it, since the
// first prepare shapes. KEEP: this block writes the poses.
template <int WANTED, int TYPES, int LENS, class Trail, class Shapes, class Views>
WARPCAM_FN void compose_motions(const Trail& trail, const Shapes& shapes, const Views& views, int world, bool keep, int thread,
                                Row* motions)
{
    const bool in_first = wp::index(trail.known, world) == FIRST;
    const Row* one = reinterpret_cast<const Row*>(trail.before.data) + 4 * size_t(unsigned(world * trail.columns));
    const Row* other = reinterpret_cast<const Row*>(trail.after.data) + 4 * size_t(unsigned(world * trail.columns));
    const Row* before = in_first ? one : other;
    Row* after = const_cast<Row*>(in_first ? other : one);
    for (int shape = THREADS - 1 - thread; shape < trail.columns; shape += THREADS)
        compose_motion<false>(trail, shapes, views, world, shape, LENS == PINHOLE, (TYPES >> SCALED & 1) != 0,
                              (WANTED & FLOW_BRIEF) != 0, before + 4 * shape, keep ? after + 4 * shape : nullptr,
                              motions + motion_rows<false>() * shape);
}

}  // namespace warpcam
