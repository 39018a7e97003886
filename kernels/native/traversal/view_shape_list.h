// Shapes that a stage before the trace lists for each world, where they are few and a CUDA block draws a whole image.
#pragma once
#include "traversal/infinite_plane.h"
#include "traversal/normal_cache.h"
#include "flow/shape_motion.h"
#include "geometry/shape_state.h"
#include "traversal/trace_outputs.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

constexpr int LIST_BLOCK_THREADS = 160;  // threads of a block of the stage: view_shape_lists.py has the same

// Shape list of a whole view, as ShapeList, all of it by rank. HITS_NAME_SLOTS: records name their ranks in place of
// their shapes.
template <int CAPACITY, bool HITS_NAME_SLOTS> struct alignas(32) ViewShapeList {
    static constexpr int SIZE = CAPACITY;

    int count;
    int next_tile;  // 0
    PackedTileRect tiles[WARP_SIZE];
    alignas(16) InfinitePlane floor;
    alignas(16) Camera camera;
    NormalCache<HITS_NAME_SLOTS ? CAPACITY : 0> facings;  // see there
    alignas(32) ShapeRecord records[CAPACITY];

    WARPCAM_DEVICE const ShapeRecord& at_rank(int rank) const { return records[rank]; }
};

// Layout in global memory, which the stage writes and a block of the trace copies: the same up to the records, then the
// first row of all records, the second, ..., so that neighbouring threads access neighbouring words.
template <int CAPACITY, bool HITS_NAME_SLOTS> struct PackedShapeList {
    using List = ViewShapeList<CAPACITY, HITS_NAME_SLOTS>;
    static constexpr int RECORD_ROWS = sizeof(ShapeRecord) / sizeof(Float3Int);
    static constexpr int HEAD_ROWS = sizeof(List) / sizeof(Float3Int) - RECORD_ROWS * CAPACITY;
    static_assert(CAPACITY <= WARP_SIZE
                  && HEAD_ROWS
                         == (HITS_NAME_SLOTS ? (22 + CAPACITY) / 2 * 2 : 18));  // view_shape_lists.py has the same

    Float3Int* rows;

    template <class Lists> WARPCAM_DEVICE static PackedShapeList of(const Lists& lists, int world)
    {
        return { reinterpret_cast<Float3Int*>(lists.data)
                 + size_t(unsigned(world)) * (sizeof(List) / sizeof(Float3Int)) };
    }
    WARPCAM_DEVICE List& head() const { return *reinterpret_cast<List*>(rows); }
    WARPCAM_DEVICE Float3Int* records(int row) const { return rows + HEAD_ROWS + row * CAPACITY; }
    WARPCAM_DEVICE void put(int rank, const ShapeRecord& record) const
    {
        records(0)[rank] = record.axis_x;
        records(1)[rank] = record.axis_y;
        records(2)[rank] = record.axis_z;
        records(3)[rank] = record.origin;
        records(4)[rank] = record.size;
    }
    // Has a list of so many shapes on its way to shared memory; for all threads of a block. Loops that are not would
    // take more instructions than all of this.
    WARPCAM_DEVICE void fetch(List& list, int shapes, unsigned thread) const
    {
        constexpr int WARPS = THREADS / WARP_SIZE;
        static_assert(RECORD_ROWS == WARPS + 1 && HEAD_ROWS <= (WARPS - 1) * WARP_SIZE);
        const unsigned rank = thread % WARP_SIZE, row = thread / WARP_SIZE;
        if (rank < unsigned(shapes)) {
            Float3Int* const to = reinterpret_cast<Float3Int*>(list.records) + RECORD_ROWS * rank;
            copy_row(to + row, rows + (HEAD_ROWS + rank + row * CAPACITY));
            if (row == 0)
                copy_row(to + WARPS, rows + (HEAD_ROWS + rank + WARPS * CAPACITY));
        }
        if (thread - WARP_SIZE < HEAD_ROWS)
            copy_row(reinterpret_cast<Float3Int*>(&list) + (thread - WARP_SIZE), rows + (thread - WARP_SIZE));
    }
};

struct alignas(16) ListedCamera {
    Camera camera;
};
// By which worlds were seen in the last frame: of a block, in the order of its worlds.
WARPCAM_DEVICE ListedCamera* cameras_then()
{
    WARPCAM_SHARED ListedCamera cameras[WARP_SIZE];
    return cameras;
}

// Has on its way what list_worlds() needs, before views are worked out: the cameras of the last frame, where flow is
// WANTED; what the shapes' threads load, of the warp that has to do with views first.
template <int CAPACITY, int WANTED, class Stage, class Lane, class Shapes>
WARPCAM_DEVICE void begin_listing(const Stage& stage, const Lane& lane, const Shapes& shapes)
{
    const auto [first_world, worlds, slot, shape, thread] = lane;
    if ((WANTED & FLOWS) && thread < worlds) {
        const auto& camera =
            PackedShapeList<CAPACITY, names_slots(WANTED)>::of(stage.lists, first_world + thread).head().camera;
        for (int row = 0; row < int(sizeof(ListedCamera) / sizeof(Float3Int)); ++row)
            copy_row(reinterpret_cast<Float3Int*>(cameras_then() + thread) + row,
                     reinterpret_cast<const Float3Int*>(&camera) + row);
    }
    if (thread < WARP_SIZE && slot < worlds) {
        asm volatile("prefetch.global.L1 [%0];" ::"l"(wp::address(shapes.positions, first_world + slot, shape)));
        asm volatile("prefetch.global.L1 [%0];" ::"l"(wp::address(shapes.rotations, first_world + slot, shape)));
    }
}

// Lists the shapes of some worlds, at most WARP_SIZE, by a block that has a thread for each of their shapes: that of
// one of these worlds, by the lane's slot. The first threads have a world's view each, too, and where flow is WANTED
// what is known of the world; `state` is 0 if it is not drawn. Where flow is, a shape's thread composes how it has
// moved.
template <class Types, int LENS, int CAPACITY, int WANTED, class View, class Stage, class Lane, class Shapes,
          class Materials, class Meshes, class HeightFields, class History>
WARPCAM_DEVICE void list_worlds(const View& now, int state, const Stage& stage, const Lane& lane, const Shapes& shapes,
                                const Materials& materials, const Meshes& meshes, const HeightFields& fields,
                                const History& history)
{
    const auto [first_world, worlds, slot, shape, thread] = lane;
    const int columns = stage.columns;
    constexpr bool FLOWING = (WANTED & FLOWS) != 0, DEPTHS = (WANTED & FLOW_VALID) != 0,
                   HITS_NAME_SLOTS = names_slots(WANTED);
    using Far = PackedShapeList<CAPACITY, HITS_NAME_SLOTS>;
    static_assert(!Types::has(MESH) && !Types::has(HEIGHT_FIELD));
    WARPCAM_SHARED Camera cameras[WARP_SIZE];
    WARPCAM_SHARED int states[WARP_SIZE], counts[WARP_SIZE], broken[WARP_SIZE], keys[LIST_BLOCK_THREADS];
    constexpr int NONE = 0x7ffffffe;  // of what is not seen
    const bool mine = slot < worlds;
    const int world = first_world + slot;
    if (thread < worlds) {
        const Camera camera = load_camera(now);
        cameras[thread] = camera;
        states[thread] = state;
        counts[thread] = broken[thread] = 0;
        if (FLOWING)
            await_rows();
        if (state != 0)
            Far::of(stage.lists, first_world + thread).head().camera = camera;
    }
    ShapePose pose;
    int kind = 0;
    bool drawn = false, listed = false;
    if (mine) {
        __builtin_assume(world >= 0);
        __builtin_assume(shape >= 0);
        pose = pose_now(shapes, world, shape);
        kind = wp::index(shapes.types, shape);
        drawn = wp::index(shapes.places, shape) >= 0;
        listed = drawn & !transparent(shapes, materials, world, shape);
    }
    const Shape made { kind, shape, pose.asset, pose.position, pose.size, pose.rotation };
    BoundsAndScale form;
    ShapeRecord record;
    Visible found = HIDDEN;
    if (!FLOWING && drawn)
        found = find_form<Types>(made, meshes, fields, form, record);
    block_sync();
    const int at = mine ? slot : 0;
    state = mine ? states[at] : 0;
    const Camera& camera = cameras[at];
    const size_t first_row = 4 * size_t(unsigned(world * columns)) + shape;
    const Float3Int* before = nullptr;
    if (FLOWING && drawn && state != 0) {
        Float3Int* const one = reinterpret_cast<Float3Int*>(history.before.data) + first_row;
        Float3Int* const other = reinterpret_cast<Float3Int*>(history.after.data) + first_row;
        before = state == FIRST ? one : other;
        for (int row = 0; row < 4; ++row)
            asm volatile("prefetch.global.L1 [%0];" ::"l"(before + row * columns));
        if (history.keep)
            keep_pose(state == FIRST ? other : one, columns, pose);
    }
    TileRect tiles;
    int key = NONE;
    if (drawn && state != 0 && abs(camera.origin.x) < MISS) {
        if (FLOWING)
            found = find_form<Types>(made, meshes, fields, form, record);
        if (found == BROKEN)
            broken[at] = 1;
        if (found == FORMLESS && listed)
            stage.faults.data[world] = 1;
        if (found == SEEN && listed
            && place<Types, LENS, true, 4>(made, form, camera, { 0, 0, stage.width, stage.height }, record, tiles)
                   == SEEN) {
            key = record.size.w & 0x7fffffff;
            atomicAdd(&counts[at], 1);
        }
    }
    if (mine)
        keys[thread] = key;
    block_sync();
    if (state == 0)
        return;
    const Far far = Far::of(stage.lists, world);
    auto& list = far.head();
    const bool wrong = broken[at] != 0, seen = key != NONE && !wrong;
    int rank = 0;  // of what is not seen, too: behind all else
    const int* of_world = keys + (thread - shape);
#pragma unroll 4
    for (int other = 0; other < columns; ++other)  // those that are nearer, and of those at one place the later ones
        rank += unsigned(of_world[other] - key + ((shape - other) >> 31)) >> 31;
    list.tiles[rank] = { seen ? PackedTileRect::of(tiles) : PackedTileRect::NONE };
#pragma unroll 1
    for (int none = columns + shape; none < WARP_SIZE; none += columns)
        list.tiles[none] = { PackedTileRect::NONE };
    if (seen) {
        if constexpr (HITS_NAME_SLOTS) {
            record.axis_y.w = rank;
            list.facings.template note<Types>(rank, record, shape, camera);
        }
        far.put(rank, record);
        if (rank == 0) {
            InfinitePlane floor {};
            floor.note(record, shape, rank, camera.near, camera.far);
            list.floor = floor;
        }
    }
    if (shape == 0) {
        list.count = wrong ? 0 : counts[at];
        list.next_tile = 0;
        if constexpr (HITS_NAME_SLOTS)
            list.facings.begin();
        if (wrong || counts[at] == 0)
            list.floor.begin();
        if (wrong)
            stage.faults.data[world] = 1;
    }
    // Composes no motion for shapes that are not visible, except for the plane, which is tested as a whole.
    if (FLOWING && drawn && (seen || kind == PLANE))
        compose_motion<false, DEPTHS>(history, pose_before(before, columns), pose, kind, state, camera,
                                      cameras_then()[at].camera, LENS == PINHOLE, Types::has(PER_SHAPE_SCALE),
                                      stage.compact != 0,
                                      reinterpret_cast<Float3Int*>(history.motions.data) + first_row, columns);
}

#endif

}  // namespace warpcam
