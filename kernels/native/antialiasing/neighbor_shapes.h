// The shapes that are seen around some pixels of a region, on CUDA: of each one record, which a block makes once for
// all of these pixels.
#pragma once
#include "antialiasing/samples.h"
#include "traversal/trace_tile.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int NEAR_SHAPES = 64, NEAR_WORDS = NEAR_SHAPES / WARP_SIZE;
constexpr int NEAR_KEYS = 256;  // of a table by id; as many as all threads can put in before they see that it is full
static_assert(NEAR_SHAPES + THREADS <= NEAR_KEYS, "a table with room for what all threads put in");
constexpr int NO_KEY = -1;

// Set of records, a bit each.
using NearBits = unsigned[NEAR_WORDS];

struct NearShapes {
    ShapeRecord records[NEAR_SHAPES];  // nearest first where there are meshes; see sample_record()
    int keys[NEAR_KEYS];  // ids, a table
    int ids[NEAR_SHAPES];  // in the order in which they came
    float nearest[NEAR_SHAPES];  // likewise
    unsigned char places[NEAR_KEYS];  // among the records, NEAR_SHAPES for none
    NearBits meshes, fields;
    int count;  // more than NEAR_SHAPES: they are too many

    WARPCAM_DEVICE static unsigned slot_of(int id) { return unsigned(id) % NEAR_KEYS; }

    // All threads of the block; then a barrier.
    WARPCAM_DEVICE void clear()
    {
        for (int k = threadIdx.x; k < NEAR_KEYS; k += THREADS)
            keys[k] = NO_KEY;
        if (threadIdx.x < NEAR_WORDS)
            meshes[threadIdx.x] = fields[threadIdx.x] = 0;
        if (threadIdx.x == 0)
            count = 0;
    }

    WARPCAM_DEVICE void add(int id)
    {
        unsigned slot = slot_of(id);
        for (int key; (key = *static_cast<volatile int*>(keys + slot)) != id;) {
            if (*static_cast<volatile int*>(&count) > NEAR_SHAPES)
                return;
            if (key == NO_KEY)
                key = atomicCAS(keys + slot, NO_KEY, id);
            if (key == NO_KEY) {
                const int number = atomicAdd(&count, 1);
                if (number < NEAR_SHAPES)
                    ids[number] = id;
                return;
            }
            if (key != id)
                slot = (slot + 1) % NEAR_KEYS;
        }
    }

    // Index of a shape that was added.
    WARPCAM_DEVICE unsigned find(int id) const
    {
        unsigned slot = slot_of(id);
        while (keys[slot] != id)
            slot = (slot + 1) % NEAR_KEYS;
        return slot;
    }

    WARPCAM_DEVICE int place(int id) const { return places[find(id)]; }
    WARPCAM_DEVICE int place_of_byte(int id) const { return places[id]; }  // of one below NEAR_KEYS, if all are

    // Makes the records of all that were added; with barriers.
    template <class Types, int LENS, class Shapes, class Meshes, class HeightFields>
    WARPCAM_DEVICE void prepare_all(const Shapes& shapes, const Meshes& all_meshes, const HeightFields& all_fields,
                                    const Camera& camera, const Region& region, int world)
    {
        const int mine = threadIdx.x;
        ShapeRecord record;
        bool seen = false;
        if (mine < count) {
            seen = sample_record<Types, LENS>(shapes, all_meshes, all_fields, camera, region, world, ids[mine], record);
            nearest[mine] = !seen ? MISS : Types::has(MESH) ? as_float(record.size.w) : 0.0f;
        }
        block_sync();
        if (mine < count) {
            const float key = nearest[mine];
            const int id = ids[mine];
            int rank = 0;
            for (int k = 0; k < count; ++k)
                rank += nearest[k] < key || (nearest[k] == key && ids[k] > id);
            places[find(id)] = static_cast<unsigned char>(seen ? rank : NEAR_SHAPES);
            if (seen) {
                record.axis_y.w = rank;
                records[rank] = record;
                if (is_mesh<Types>(record))
                    atomicOr(meshes + rank / WARP_SIZE, 1u << rank % WARP_SIZE);
                if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD)
                    atomicOr(fields + rank / WARP_SIZE, 1u << rank % WARP_SIZE);
            }
        }
        block_sync();
    }
};

}  // namespace warpcam
#endif
