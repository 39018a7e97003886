// One point of each voxel: the first. A block works on a world, with a hash table in global memory.
//
// An entry of the table is the first candidate of its voxel. Collisions go to the next entries, and an entry stays with
// the voxel that has claimed it: whichever candidate was there first, each voxel ends with one entry and the same owner.
#pragma once
#include "sensors/pack_points.h"

namespace warpcam {

constexpr int FREE_ENTRY = -1;

struct Voxel {
    int x, y, z;
};

WARPCAM_DEVICE bool is_same(Voxel a, Voxel b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// The quotient is that of IEEE 754 everywhere. Beyond 2^30 voxels from the origin there is one more on either side.
WARPCAM_DEVICE int voxel_coordinate(float value, float size)
{
    constexpr float LIMIT = 1073741824.0f;
#if defined(__CUDA_ARCH__)
    const float quotient = __fdiv_rn(value, size);
#else
    const float quotient = value / size;
#endif
    return int(max(-LIMIT, min(LIMIT, round_down(quotient))));
}

// Multipliers of Teschner et al., "Optimized Spatial Hashing for Collision Detection of Deformable Objects", 2003, and
// the last step of MurmurHash3 (Appleby), which makes all bits count in the lowest.
WARPCAM_DEVICE unsigned hash_of(Voxel voxel)
{
    unsigned hash = unsigned(voxel.x) * 73856093u ^ unsigned(voxel.y) * 19349663u ^ unsigned(voxel.z) * 83492791u;
    hash = (hash ^ hash >> 16) * 0x85ebca6bu;
    hash = (hash ^ hash >> 13) * 0xc2b2ae35u;
    return hash ^ hash >> 16;
}

// The entry as it was; a free one becomes the candidate's.
WARPCAM_DEVICE int claim_entry(int* entry, int candidate)
{
#if defined(__CUDA_ARCH__)
    const int owner = *const_cast<volatile int*>(entry);
    return owner == FREE_ENTRY ? atomicCAS(entry, FREE_ENTRY, candidate) : owner;
#else
    const int owner = *entry;
    if (owner == FREE_ENTRY)
        *entry = candidate;
    return owner;
#endif
}

WARPCAM_DEVICE void lower_entry(int* entry, int candidate)
{
#if defined(__CUDA_ARCH__)
    atomicMin(entry, candidate);
#else
    *entry = min(*entry, candidate);
#endif
}

// Keeps the first candidate of each voxel of an edge of `size` [m], in place.
template <class Candidates, class Table>
WARPCAM_DEVICE void thin_to_voxels(const Candidates& candidates, float size, const Table& table, int index)
{
    const auto [world, thread] = block_place(index);
    if (!candidates.mask.data[world])
        return;
    const int capacity = candidates.pixels.shape[1], count = candidates.counts.data[world];
    int* entries = table.data + size_t(world) * table.shape[1];
    int* found = candidates.work.data + size_t(world) * capacity;
    float* x = candidates.points.data + size_t(world) * 3 * capacity;
    int* pixels = candidates.pixels.data + size_t(world) * capacity;
    const auto voxel_at = [&](int i) {
        return Voxel { voxel_coordinate(x[i], size), voxel_coordinate(x[capacity + i], size),
                       voxel_coordinate(x[2 * capacity + i], size) };
    };
    int num_entries = THREADS;  // a power of two, at least twice as many as candidates
    while (num_entries < 2 * count)
        num_entries *= 2;
    num_entries = min(num_entries, int(table.shape[1]));
    for (int i = thread; i < num_entries; i += THREADS)
        entries[i] = FREE_ENTRY;
    block_sync();
    for (int i = thread; i < count; i += THREADS) {
        const Voxel voxel = voxel_at(i);
        for (unsigned at = hash_of(voxel);; ++at) {
            const int place = int(at & unsigned(num_entries - 1)), owner = claim_entry(entries + place, i);
            if (owner == FREE_ENTRY || is_same(voxel_at(owner), voxel)) {
                if (owner > i)
                    lower_entry(entries + place, i);
                found[i] = place;
                break;
            }
        }
    }
    block_sync();
    int kept = 0;
    BlockRanks ranks;
    for (int base = 0; base < count; base += THREADS) {
        const int i = base + thread;
        const bool keeps = i < count && *const_cast<volatile int*>(entries + found[i]) == i;
        Vec3 point {};
        int pixel = 0;
        if (keeps) {
            point = { x[i], x[capacity + i], x[2 * capacity + i] };
            pixel = pixels[i];
        }
        int total;
        // All threads have loaded theirs when any of them stores, and places are never beyond what was loaded.
        const int place = kept + ranks.rank(keeps, total);
        if (keeps) {
            x[place] = point.x;
            x[capacity + place] = point.y;
            x[2 * capacity + place] = point.z;
            pixels[place] = pixel;
        }
        kept += total;
    }
    block_sync();  // all have read the count
    if (thread == 0)
        candidates.counts.data[world] = kept;
}

}  // namespace warpcam
