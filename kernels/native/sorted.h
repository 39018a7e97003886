// Shapes that a stage before the trace lists for each world, where they are few and a CUDA block draws a whole image.
#pragma once
#include "endless_floor.h"
#include "facings.h"
#include "flow_motion.h"
#include "opacity.h"
#include "outputs.h"

namespace warpcam {

// As ShapeList, all of it by rank; with the view. A block of the trace copies it as it is.
#if defined(__CUDA_ARCH__)

// SLOTS: records name their ranks in place of their shapes.
template <int CAPACITY, bool SLOTS> struct alignas(16) SortedList {
    static constexpr int ROOM = CAPACITY;

    int count;
    int next_tile;  // 0
    TileSpans tiles[LANES];
    alignas(16) EndlessFloor floor;
    alignas(16) Camera camera;
    ShapeFacings<SLOTS ? CAPACITY : 0> facings;  // see there
    alignas(16) Record records[CAPACITY];

    WARPCAM_FN const Record& at_rank(int rank) const { return records[rank]; }
    WARPCAM_FN static int rows_of(int shapes)
    {
        return int((sizeof(SortedList) - (CAPACITY - shapes) * sizeof(Record)) / sizeof(Row));
    }
};

// Lists the shapes of some worlds, by a block whose last warp has a lane for each of these worlds, with its view now, and
// where flow is WANTED that of the last frame and what is known of the world; `state` is 0 if it is not drawn. The other
// warps have a thread a shape, and compose how it has moved. `opens`: what is known has yet to be turned over.
template <int TYPES, int LENS, int CAPACITY, int WANTED, class View, class Shapes, class Materials, class Meshes,
          class HeightFields, class Trail, class Lists, class Faults>
WARPCAM_FN void list_worlds(const View& then, const View& now, int state, const Shapes& shapes, const Materials& materials,
                            const Meshes& meshes, const HeightFields& fields, const Trail& trail, const Lists& lists,
                            const Faults& faults, int columns, int width, int height, bool opens, bool brief,
                            int first_world, int worlds, int thread)
{
    constexpr bool FLOWING = (WANTED & FLOWS) != 0, DEPTHS = (WANTED & FLOW_VALID) != 0, SLOTS = names_slots(WANTED);
    using List = SortedList<CAPACITY, SLOTS>;
    static_assert(CAPACITY <= LANES && !(TYPES >> MESH & 1) && !(TYPES >> HEIGHT_FIELD & 1));
    WARPCAM_SHARED Camera cameras[FLOWING ? 2 : 1][LANES];
    WARPCAM_SHARED int states[LANES], keys[THREADS];
    static_assert(sizeof(List) == (17 + 5 * CAPACITY + (SLOTS ? 4 + CAPACITY : 0)) * sizeof(Row));  // listing.py has the same
    constexpr int NONE = 0x7fffffff, BAD = -1;  // of what is not seen, and what makes a world one that cannot be trusted
    auto* const all = reinterpret_cast<List*>(lists.data);
    const int lane = thread - THREADS, slot = thread / columns, shape = thread - slot * columns, world = first_world + slot;
    const bool mine = thread < THREADS && slot < worlds;
    if (lane >= 0 && lane < worlds) {
        cameras[0][lane] = load_camera(now);
        if (FLOWING)
            cameras[1][lane] = load_camera(then);
        states[lane] = state;
        all[first_world + lane].camera = cameras[0][lane];
    }
    const size_t index = size_t(unsigned(world * columns + shape));
    ShapePose pose, old;
    Row *before = nullptr, *after = nullptr;
    int kind = 0;
    bool drawn = false, listed = false;
    if (mine) {
        if (FLOWING) {
            const int known = wp::index(trail.known, world);
            const bool in_first = opens ? known != 0 && known != FIRST : known == FIRST;
            before = reinterpret_cast<Row*>(in_first ? trail.before.data : trail.after.data) + 4 * index;
            if (trail.keep)
                after = reinterpret_cast<Row*>(in_first ? trail.after.data : trail.before.data) + 4 * index;
            old = pose_before(before);
        }
        pose = pose_now(shapes, world, shape);
        kind = wp::index(shapes.types, shape);
        drawn = wp::index(shapes.places, shape) >= 0;
        listed = drawn && !transparent(shapes, materials, world, shape);
    }
    block_barrier();
    const bool wanted = mine && states[slot] != 0;
    const Camera& camera = cameras[0][mine ? slot : 0];
    if (FLOWING && wanted && drawn)
        compose_motion<false, DEPTHS>(trail, old, pose, kind, states[slot], camera, cameras[FLOWING ? 1 : 0][slot],
                                  LENS == PINHOLE, (TYPES >> SCALED & 1) != 0, brief, before, after,
                                  reinterpret_cast<Row*>(trail.motions.data) + motion_rows<false>() * index);
    Record record;
    TileBox tiles;
    int key = NONE;
    if (wanted && drawn && magnitude(camera.origin.x) < FAR_AWAY) {
        const Shape made { kind, shape, pose.asset, pose.position, pose.size, pose.rotation };
        const Visible seen = prepare<TYPES, LENS>(made, camera, { 0, 0, width, height }, meshes, fields, record, tiles);
        key = seen == BROKEN ? BAD : seen == SEEN && listed ? record.size.w & 0x7fffffff : NONE;
    }
    if (thread < THREADS)
        keys[thread] = key;
    block_barrier();
    if (wanted) {
        List& list = all[world];
        int count = 0, rank = 0;
        bool broken = false;
        for (int other = 0; other < columns; ++other) {
            const int that = keys[thread - shape + other];
            count += that != NONE;
            broken = broken || that == BAD;
            rank += that < key || (that == key && other > shape);
        }
        if (broken)
            count = 0;
        if (key != NONE && !broken) {
            if constexpr (SLOTS) {
                record.axis_y.w = rank;
                list.facings.template note<TYPES>(rank, record, shape, camera);
            }
            list.records[rank] = record;
            list.tiles[rank] = { TileSpans::of(tiles) };
            if (rank == 0) {
                list.floor.begin();
                list.floor.note(record, shape, rank, camera.near, camera.far);
            }
        }
        for (int none = count + shape; none < LANES; none += columns)
            list.tiles[none] = { TileSpans::NONE };
        if (shape == 0) {
            list.count = count;
            list.next_tile = 0;
            if constexpr (SLOTS)
                list.facings.begin();
            if (count == 0)
                list.floor.begin();
            if (broken)
                faults.data[world] = 1;
        }
    }
}

#endif

}  // namespace warpcam
