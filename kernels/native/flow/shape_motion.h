// Motion of a shape in a camera's image since its world's previous frame.
#pragma once
#include "flow/visibility_history.h"

namespace warpcam {

// Depth tolerances of visibility in the previous frame: a surface farther than what was seen around it, by more than
// this part of its depth and so many pixel widths, was hidden. On a concave surface neighbouring pixels may be nearer
// than what lies between them.
constexpr float FARTHER = 0.004f, CONVEX = 0.25f, HOLLOW = 1.0f;

// So many of the 256 steps in which depths are counted may what is compared be apart, of which eight bits are kept.
constexpr float MOST_APART = 120.0f;

WARPCAM_DEVICE bool same_vec(Vec3 a, Vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

struct DepthTolerance {
    float part, shift;  // of a depth, and what is added to it [m]: nothing nearer may have been seen at a point's place
};

WARPCAM_DEVICE DepthTolerance reach_of(int kind, const Camera& camera, bool pinhole)
{
    const bool hollow = kind == MESH || kind == HEIGHT_FIELD || kind == SPLATS;
    const float pixel = max(camera.scale_x, camera.scale_y);
    const float wide = kind == PLANE ? 0.0f : (hollow ? HOLLOW : CONVEX) * pixel;  // a plane hides nothing of itself
    if (pinhole)
        return { rcp(1.0f + FARTHER + wide), 0.0f };
    return { 1.0f / (1.0f + FARTHER), -wide };
}

// Pose of a shape, and its mesh.
struct ShapePose {
    Vec3 position;
    Mat3 rotation;
    Vec3 size;
    int asset;
};

// Steps a metre in which the depths of a convex shape are counted.
WARPCAM_DEVICE float steps_of(int kind, const ShapePose& pose, const Camera& camera, bool pinhole)
{
    if (kind == PLANE)
        return 0.0f;
    Vec3 half = pose.size;
    visit_shape<ANALYTIC_TYPES>(kind, [&](auto shape) { half = shape.half_extents(pose.size); });
    const Vec3 axis { camera.rotation.at[0][2], camera.rotation.at[1][2], camera.rotation.at[2][2] };
    const Vec3 along = transform_transposed(pose.rotation, axis);
    const float radius = abs(along.x) * half.x + abs(along.y) * half.y + abs(along.z) * half.z;
    const float farthest = abs(dot(axis, camera.origin - pose.position)) + radius;
    const DepthTolerance reach = reach_of(kind, camera, pinhole);
    return MOST_APART
           * rcp(max(2.0f * radius + (1.0f - reach.part) * farthest - reach.shift, 1.0e-6f * farthest + 1.0e-12f));
}

WARPCAM_DEVICE float ratio(float previous, float now) { return now == 0.0f ? 1.0f : previous * rcp(now); }

// Ratio of the shape's previous to its present size along its axes.
WARPCAM_DEVICE Vec3 stretch(int kind, Vec3 previous, Vec3 now, bool scaled)
{
    if (same_vec(previous, now) || kind == PLANE || ((kind == MESH || kind == HEIGHT_FIELD) && !scaled))
        return { 1.0f, 1.0f, 1.0f };
    Vec3 along { ratio(previous.x, now.x), ratio(previous.y, now.y), ratio(previous.z, now.z) };
    visit_shape<ANALYTIC_TYPES>(kind, [&](auto shape) { along = shape.axes(along); });
    return along;
}

WARPCAM_DEVICE void put_row(Float3Int* rows, int row, Vec3 v, float w)
{
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(rows + row) = make_float4(v.x, v.y, v.z, w);
#else
    rows[row] = { v.x, v.y, v.z, as_int(w) };
#endif
}

// To the same pixel, but to a depth behind the camera.
WARPCAM_DEVICE void put_unknown(Float3Int* motion, int step)
{
    put_row(motion, 0, { 1.0f, 0.0f, 0.0f }, 0.0f);
    put_row(motion, step, { 0.0f, 1.0f, 0.0f }, 0.0f);
    put_row(motion, 2 * step, { 0.0f, 0.0f, 0.0f }, -1.0f);
}

// A shape's rows of Trail.before, of so many shapes.
WARPCAM_DEVICE ShapePose pose_before(const Float3Int* before, int columns)
{
    const Float3Int a = load(before, 0), b = load(before, columns), c = load(before, 2 * columns),
                    d = load(before, 3 * columns);
    return { as_vec3(a),
             { { { b.x, b.y, b.z }, { c.x, c.y, c.z }, { d.x, d.y, d.z } } },
             { as_float(a.w), as_float(b.w), as_float(c.w) },
             d.w };
}

template <class Shapes> WARPCAM_DEVICE ShapePose pose_now(const Shapes& shapes, int world, int shape)
{
    ShapePose pose;
    pose.position = as_vec3(wp::index(shapes.positions, world, shape));
    pose.rotation = as_mat3(wp::index(shapes.rotations, world, shape));
    pose.size = as_vec3(per_world(shapes.sizes, world, shape));
    pose.asset = per_world(shapes.assets, world, shape);
    return pose;
}

WARPCAM_DEVICE void keep_pose(Float3Int* before, int columns, const ShapePose& pose)
{
    const auto& r = pose.rotation.at;
    put_row(before, 0, pose.position, pose.size.x);
    put_row(before, columns, { r[0][0], r[0][1], r[0][2] }, pose.size.y);
    put_row(before, 2 * columns, { r[1][0], r[1][1], r[1][2] }, pose.size.z);
    put_row(before, 3 * columns, { r[2][0], r[2][1], r[2][2] }, as_float(pose.asset));
}

WARPCAM_DEVICE bool same_pose(const ShapePose& a, const ShapePose& b)
{
    bool same = same_vec(a.position, b.position) && same_vec(a.size, b.size) && a.asset == b.asset;
    for (int i = 0; i < 9; ++i)
        same = same && a.rotation.at[i / 3][i % 3] == b.rotation.at[i / 3][i % 3];
    return same;
}

// From a camera's frame to pixels, all times the planar depth. It looks along -z, and rows run down.
struct Projection {
    float right, down, column, row;

    WARPCAM_DEVICE Projection(const Camera& camera, bool pinhole)
        : right(rcp(camera.scale_x)), down(-rcp(camera.scale_y)), column(pinhole ? camera.center_x - 0.5f : 0.0f),
          row(pinhole ? camera.center_y - 0.5f : 0.0f)
    {
    }
    // Row i of what that makes of a vector's or three vectors' rows.
    WARPCAM_DEVICE float of(int i, float x, float y, float z) const
    {
        return i == 0 ? right * x - column * z : i == 1 ? down * y - row * z : -z;
    }
};

// Writes the rows of Trail.motions that a shape has, each so many after the last. DEPTHS: the fourth tells depths, too,
// not only what rests.
template <bool MOVES, bool DEPTHS, class History>
WARPCAM_DEVICE void compose_motion(const History& history, const ShapePose& old, const ShapePose& pose, int kind,
                                   int state, const Camera& now, const Camera& previous, bool pinhole, bool scaled,
                                   bool compact, Float3Int* motion, int step)
{
    const float steps = DEPTHS && compact ? steps_of(kind, pose, now, pinhole) : 0.0f;
    if (state == NEW) {
        put_unknown(motion, step);
        put_row(motion, 3 * step, { 0.0f, 0.0f, 0.0f }, compact ? steps : as_float(-2));
        return;
    }
    // By how much a point of the shape, then one of the camera's frame, was elsewhere: 0 if nothing has moved.
    const Vec3 grown = stretch(kind, old.size, pose.size, scaled);
    Mat3 turn, change;
    for (int i = 0; i < 3; ++i) {
        const auto& o = old.rotation.at[i];
        const auto& r = pose.rotation.at[i];
        const Vec3 row { o[0] * grown.x - r[0], o[1] * grown.y - r[1], o[2] * grown.z - r[2] };
        for (int j = 0; j < 3; ++j)
            turn.at[i][j] = dot(row, { pose.rotation.at[j][0], pose.rotation.at[j][1], pose.rotation.at[j][2] });
    }
    const Vec3 away =
        (now.origin - previous.origin) + (old.position - pose.position) + transform(turn, now.origin - pose.position);
    const Vec3 shift = transform_transposed(previous.rotation, away);
    float moved = dot(shift, shift);
    for (int i = 0; i < 3; ++i) {
        const Vec3 axis { previous.rotation.at[0][i], previous.rotation.at[1][i], previous.rotation.at[2][i] };
        const Vec3 sooner { now.rotation.at[0][i], now.rotation.at[1][i], now.rotation.at[2][i] };
        const Vec3 row = transform_transposed(now.rotation, (axis - sooner) + transform_transposed(turn, axis));
        change.at[i][0] = row.x;
        change.at[i][1] = row.y;
        change.at[i][2] = row.z;
        moved += dot(row, row);
    }
    const float center_x = now.center_x - previous.center_x, center_y = now.center_y - previous.center_y;
    const float scale_x = now.scale_x - previous.scale_x, scale_y = now.scale_y - previous.scale_y;
    moved += center_x * center_x + center_y * center_y + scale_x * scale_x + scale_y * scale_y;
    const int corner = MOVES && kind == MESH && pose.asset >= 0 ? wp::index(history.corner_starts, pose.asset) : -1;
    const bool known = abs(moved) < infinity() && old.asset == pose.asset, rests = known && moved == 0.0f;
    const Projection pixels(previous, pinhole);
    if (!known) {
        put_unknown(motion, step);
    } else if (!rests || corner >= 0) {
        for (int i = 0; i < 3; ++i)
            change.at[i][i] += 1.0f;
        const auto& c = change.at;
        for (int i = 0; i < 3; ++i) {
            const float x = pixels.of(i, c[0][0], c[1][0], c[2][0]) * now.scale_x;
            const float y = pixels.of(i, c[0][1], c[1][1], c[2][1]) * -now.scale_y;
            const float z = -pixels.of(i, c[0][2], c[1][2], c[2][2]);
            const float start = x * (0.5f - now.center_x) + y * (0.5f - now.center_y);  // of pixel (0, 0)
            const float end = pixels.of(i, shift.x, shift.y, shift.z);
            const float middle = i == 0 ? previous.center_x - 0.5f : i == 1 ? previous.center_y - 0.5f : 0.0f;
            put_row(motion, i * step, { x, y, pinhole ? z + start : z }, pinhole ? end : end + middle + start);
        }
    }
    if (MOVES && corner >= 0) {
        Vec3 columns[3];  // of the mesh's frame, in the camera's
        for (int j = 0; j < 3; ++j) {
            columns[j] = transform_transposed(previous.rotation,
                                              { old.rotation.at[0][j], old.rotation.at[1][j], old.rotation.at[2][j] });
            if (scaled)
                columns[j] = (j == 0 ? old.size.x : j == 1 ? old.size.y : old.size.z) * columns[j];
        }
        for (int i = 0; i < 3; ++i)
            put_row(motion, (4 + i) * step,
                    { pixels.of(i, columns[0].x, columns[0].y, columns[0].z),
                      pixels.of(i, columns[1].x, columns[1].y, columns[1].z),
                      pixels.of(i, columns[2].x, columns[2].y, columns[2].z) },
                    0.0f);
    }
    DepthTolerance reach = reach_of(kind, previous, pinhole);
    if (kind == PLANE)
        reach.shift = -1.0e30f;
    if (!DEPTHS) {
        put_row(motion, 3 * step, { 0.0f, 0.0f, compact && rests ? -1.0f : 0.0f },
                as_float(!compact && rests ? STILL : STILL - 1));
    } else if (compact) {
        const float old_steps = steps_of(kind, old, previous, pinhole);
        const float nearest = mul_rn(reach.shift, old_steps) + TO_WHOLE;
        put_row(motion, 3 * step, { reach.part * old_steps, nearest, rests && corner < 0 ? -1.0f : previous.near },
                steps);
    } else {
        put_row(motion, 3 * step, { reach.part, reach.shift, previous.near },
                as_float(known ? 2 * corner + int(rests) : -2));
    }
}

// Composes the motion of a shape whose previous pose is `before`, of so many shapes; stores its present pose in
// `after`, unless null: `before` itself or another array.
template <bool MOVES, bool DEPTHS, class History, class Shapes>
WARPCAM_DEVICE void compose_motion_of(const History& history, const Shapes& shapes, const Camera& now,
                                      const Camera& previous, int world, int shape, bool pinhole, bool scaled,
                                      bool compact, const Float3Int* before, Float3Int* after, Float3Int* motion)
{
    // All is loaded before the first decision: memory is waited for once.
    const ShapePose old = pose_before(before, history.columns), pose = pose_now(shapes, world, shape);
    const int state = wp::index(history.frame_state, world), kind = wp::index(shapes.types, shape);
    if (wp::index(shapes.places, shape) < 0 && kind != SPLATS)
        return;
    if (after && (state == NEW || !(after == before && same_pose(old, pose))))
        keep_pose(after, history.columns, pose);
    compose_motion<MOVES, DEPTHS>(history, old, pose, kind, state, now, previous, pinhole, scaled, compact, motion, 1);
}

// A shape of a world by a thread; `index` counts worlds, then shapes.
template <class Shapes, class Views, class Mask, class History>
WARPCAM_DEVICE void write_motion(const Shapes& shapes, const Views& views, const Mask& mask, const History& history,
                                 bool pinhole, bool scaled, bool compact, bool keep, bool moves, int index)
{
    const int world = index / history.columns, shape = index - world * history.columns;
    if (!wp::index(mask, world))
        return;
    const Camera now = load_camera(wp::index(views, world)),
                 previous = load_camera(wp::index(history.views_before, world));
    Float3Int* motion = reinterpret_cast<Float3Int*>(history.motions.data)
                        + (moves ? motion_rows<true>() : motion_rows<false>()) * size_t(unsigned(index));
    Float3Int* before =
        reinterpret_cast<Float3Int*>(history.before.data) + (4 * size_t(unsigned(index - shape)) + shape);
    Float3Int* after = keep ? before : nullptr;
    if (moves)
        compose_motion_of<true, true>(history, shapes, now, previous, world, shape, pinhole, scaled, compact, before,
                                      after, motion);
    else
        compose_motion_of<false, true>(history, shapes, now, previous, world, shape, pinhole, scaled, compact, before,
                                       after, motion);
}

// Composes the motions of all shapes of a world, by the threads of a block, into its shared memory; the last threads
// compose, since the first set shapes up. KEEP: this block writes the poses.
template <int WANTED, class Types, int LENS, class History, class Shapes>
WARPCAM_DEVICE void compose_motions(const History& history, const Shapes& shapes, const Camera& now,
                                    const Camera& previous, int world, bool keep, int thread, Float3Int* motions)
{
    constexpr bool DEPTHS = (WANTED & FLOW_VALID) != 0;
    const bool in_first = wp::index(history.frame_state, world) == FIRST;
    const Float3Int* one =
        reinterpret_cast<const Float3Int*>(history.before.data) + 4 * size_t(unsigned(world * history.columns));
    const Float3Int* other =
        reinterpret_cast<const Float3Int*>(history.after.data) + 4 * size_t(unsigned(world * history.columns));
    const Float3Int* before = in_first ? one : other;
    Float3Int* after = const_cast<Float3Int*>(in_first ? other : one);
    for (int shape = THREADS - 1 - thread; shape < history.columns; shape += THREADS)
        compose_motion_of<false, DEPTHS>(history, shapes, now, previous, world, shape, LENS == PINHOLE,
                                         Types::has(PER_SHAPE_SCALE), (WANTED & FLOW_COMPACT) != 0, before + shape,
                                         keep ? after + shape : nullptr, motions + motion_rows<false>() * (shape + 1));
    if (thread == THREADS - 1)  // of nothing, which rests
        put_row(motions, 3, { 0.0f, 0.0f, -1.0f }, (WANTED & FLOW_COMPACT) ? 0.0f : as_float(STILL));
}

}  // namespace warpcam
