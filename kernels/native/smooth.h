// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// A block finds the edges of one region and lists their pixels. A warp then takes 32 or 64 of them: what their samples may
// hit are the shapes that are seen in the pixels around, which are few, so that a list of shapes is made for these pixels
// and nothing else is traced; nor are samples on a side where there is no edge. A sample has the colour of the nearest
// pixel that shows the same surface: nothing is lit anew, whatever made the image.
#pragma once
#include "mesh_queue.h"
#include "samples.h"
#include "smooth_cpu.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

WARPCAM_FN int greatest(int value)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_max_sync(ALL, value);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        value = max(value, __shfl_xor_sync(ALL, value, step));
    return value;
#endif
}

WARPCAM_FN unsigned bits_of_all(unsigned bits)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_or_sync(ALL, bits);
#else
    for (int step = LANES / 2; step > 0; step /= 2)
        bits |= __shfl_xor_sync(ALL, bits, step);
    return bits;
#endif
}

// What the samples of a warp's pixels are traced against, and what they hit. A sample: PIXELS * its number + its pixel.
// Rays at meshes take differently long: the more there are, the less a warp waits for its last.
template <int TYPES> struct Batch {
    static constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    static constexpr int EACH = HAS_MESH ? 2 : 1, PIXELS = EACH * LANES;  // pixels of a lane and of the batch

    Record records[LANES];  // nearest first where there are meshes
    float depth[SAMPLES * PIXELS];
    int shape[SAMPLES * PIXELS];  // in the end: the pixel of the image that shows it
    unsigned char traced[SAMPLES * PIXELS];  // the samples that are
    Band meshes[HAS_MESH ? PIXELS : 1], fields[HAS_FIELD ? PIXELS : 1];  // of each pixel
};

// The records as trace_rays() reads a list.
struct Ranked {
    struct Itself {
        WARPCAM_FN int operator[](int rank) const { return rank; }
    };
    const Record* records;
    Itself order;
    int count;
};

// Makes the records of the warp's shapes, a lane each, -1 for none; returns which of them are meshes, by place. `own`,
// those of each of the lane's pixels, are bits by lane; then by place.
template <int TYPES, int LENS, int EACH, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN unsigned list_near(Batch<TYPES>& batch, const Shapes& shapes, const Meshes& meshes,
                              const HeightFields& fields, const Camera& camera, const Region& region, int world, int id,
                              unsigned (&own)[EACH])
{
    const int lane = threadIdx.x % LANES;
    Record record;
    const bool seen = id >= 0
        && sample_record<TYPES, LENS>(shapes, meshes, fields, camera, region, world, id, record);
    const unsigned listed = __ballot_sync(ALL, seen);
    int rank = lane;
    unsigned ranked[EACH], are_meshes = 0;
    for (int each = 0; each < EACH; ++each)
        ranked[each] = own[each] & listed;
    if (TYPES >> MESH & 1) {  // the lanes have the ids in descending order
        const float key = seen ? as_float(record.size.w) : 0.0f;
        rank = 0;
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left);
            const float other = __shfl_sync(ALL, key, from);
            rank += other < key || (other == key && from < lane);
        }
        are_meshes = bits_of_all(seen && is_mesh<TYPES>(record) ? 1u << rank : 0);
        for (int each = 0; each < EACH; ++each)
            ranked[each] = 0;
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left), to = __shfl_sync(ALL, rank, from);
            for (int each = 0; each < EACH; ++each)
                ranked[each] |= (own[each] >> from & 1) << to;
        }
    }
    for (int each = 0; each < EACH; ++each)
        own[each] = ranked[each];
    if (seen)
        batch.records[rank] = record;
    __syncwarp();
    return are_meshes;
}

// The nearest hit of the lane's ray among the shapes in `own` that are in `walked`.
template <int TYPES, int LENS, class HeightFields>
WARPCAM_FN void trace_own(const Record* records, unsigned walked, unsigned own, const ViewRay<LENS>& ray, float near,
                          const HeightFields& fields, const Band& ground, Hit& hit)
{
    for (; walked; walked &= walked - 1) {
        const int rank = lowest_bit(walked);
        const Record& record = records[rank];
        const bool mine = own >> rank & 1;
        if ((TYPES >> HEIGHT_FIELD & 1) && record.axis_x.w == HEIGHT_FIELD) {
            if (mine) {
                Hit within { lower(hit.depth, ground.last), -1, -1 };
                walk_height_field(fields, record, ray, upper(near, ground.first), within);
                if (within.shape >= 0)
                    hit = within;
            }
            __syncwarp();
        } else {
            const float t = enter_any<analytic_types(TYPES)>(record, ray.local(record));
            if (mine && t < hit.depth && t > near) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
            }
        }
    }
}

// Smooths the edges of a region.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Target>
WARPCAM_FN void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Target& target, const Camera& camera, const Seen<LENS, Target>& seen,
                              const Region& region, int world)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1, SLOW = HAS_MESH || HAS_FIELD;
    constexpr bool MIXED = HAS_MESH && (TYPES & ~(1 << MESH | 1 << SCALED)) != 0;
    constexpr int WARPS = THREADS / LANES;
    WARPCAM_SHARED unsigned short listed[WIDTH * HEIGHT];
    WARPCAM_SHARED int counts[2], next;  // pixels listed from the front, those at meshes, and from the back
    WARPCAM_SHARED Batch<TYPES> batches[WARPS];
    WARPCAM_SHARED MeshRays<1> waiting[HAS_MESH ? WARPS : 1];
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    if (threadIdx.x == 0)
        counts[0] = counts[1] = next = 0;
    block_barrier();

    const int across = region.width / TILE_WIDTH, tiles = across * (region.height / TILE_HEIGHT);
    for (int tile = warp; tile < tiles; tile += WARPS) {
        const int i = region.left + tile % across * TILE_WIDTH + lane % TILE_WIDTH;
        const int j = region.top + tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
        const bool inside = i < target.width && j < target.height;
        const unsigned samples = inside ? seen.edge(i, j) : 0;
        if (inside)
            target.edges.data[seen.at(i, j)] = samples != 0;
        const bool front = samples && (!MIXED || seen.beside(shapes.types, MESH, i, j));
#pragma unroll
        for (int end = 0; end < (MIXED ? 2 : 1); ++end) {
            const bool here = samples && front == (end == 0);
            const unsigned found = __ballot_sync(ALL, here);
            if (!found)
                continue;
            const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&counts[end], __popc(found)) : 0, 0);
            const int at = begin + __popc(found & ((1u << lane) - 1));
            if (here)
                listed[end == 0 ? at : WIDTH * HEIGHT - 1 - at]
                    = static_cast<unsigned short>(place_of(region, i, j) << SAMPLES | samples);
        }
    }
    block_barrier();

    constexpr int EACH = Batch<TYPES>::EACH, PIXELS = Batch<TYPES>::PIXELS;
    Batch<TYPES>& batch = batches[warp];
    const float near = camera.near;
    while (true) {
        const int number = __shfl_sync(ALL, lane == 0 ? atomicAdd(&next, 1) : 0, 0);
        const int in_front = (counts[0] + PIXELS - 1) / PIXELS, end = number < in_front ? 0 : 1;
        const int begin = (number - (end == 0 ? 0 : in_front)) * PIXELS;
        if (begin >= counts[end])
            return;
        const int pixels = lower_int(counts[end] - begin, PIXELS);
        const auto edge_of = [&](int pixel) -> Edge {
            const int at = begin + lower_int(pixel, pixels - 1);
            const unsigned word = listed[end == 0 ? at : WIDTH * HEIGHT - 1 - at], place = word >> SAMPLES;
            return { region.left + int(place % 64), region.top + int(place / 64),
                     pixel < pixels ? word & EVERY_SAMPLE : 0 };
        };
        int total = 0;
        int around[EACH][9];
#pragma unroll
        for (int each = 0; each < EACH; ++each) {
            const int pixel = each * LANES + lane;
            const Edge edge = edge_of(pixel);
            const unsigned itself = seen.at(edge.i, edge.j);
#pragma unroll
            for (int sample = 0; sample < SAMPLES; ++sample) {
                const bool traced = edge.samples >> sample & 1;
                const unsigned lanes = __ballot_sync(ALL, traced);
                const int at = sample * PIXELS + pixel;
                batch.depth[at] = camera.far;
                batch.shape[at] = traced ? -1 : int(itself);
                if (traced)
                    batch.traced[total + __popc(lanes & ((1u << lane) - 1))] = static_cast<unsigned char>(at);
                total += __popc(lanes);
            }
#pragma unroll
            for (int k = 0; k < 9; ++k)
                around[each][k] = pixel < pixels ? seen.shape(seen.around(edge.i, edge.j, k)) : -1;
        }
        __syncwarp();
        const auto next_id = [&] {
            int id = -1;
#pragma unroll
            for (int k = 0; k < 9 * EACH; ++k)
                id = around[k / 9][k % 9] > id ? around[k / 9][k % 9] : id;
            return greatest(id);
        };
        int id = next_id();
        while (id >= 0) {  // 32 shapes at a time
            int mine = -1, shapes_near = 0;
            unsigned own[EACH] = {};
            Band on_meshes[EACH], on_fields[EACH];
#pragma unroll
            for (int each = 0; each < EACH; ++each)
                on_meshes[each] = on_fields[each] = NOWHERE;
            for (; id >= 0 && shapes_near < LANES; ++shapes_near, id = next_id()) {
                const int type = SLOW ? wp::index(shapes.types, id) : 0;
                mine = lane == shapes_near ? id : mine;
#pragma unroll
                for (int each = 0; each < EACH; ++each) {
                    unsigned same = 0;
#pragma unroll
                    for (int k = 0; k < 9; ++k) {
                        same |= unsigned(around[each][k] == id) << k;
                        around[each][k] = around[each][k] == id ? -1 : around[each][k];
                    }
                    own[each] |= unsigned(same != 0) << shapes_near;
                    if (SLOW && (type == MESH || type == HEIGHT_FIELD)) {
                        const Edge edge = edge_of(each * LANES + lane);
                        Band& band = type == MESH ? on_meshes[each] : on_fields[each];
                        for (; same; same &= same - 1)
                            band.include(seen.depth(seen.around(edge.i, edge.j, lowest_bit(same))));
                    }
                }
            }
#pragma unroll
            for (int each = 0; each < EACH; ++each) {
                if (HAS_MESH)
                    batch.meshes[each * LANES + lane] = on_meshes[each].template widened<LENS>(pixel_width<LENS>(camera));
                if (HAS_FIELD)
                    batch.fields[each * LANES + lane] = on_fields[each].template widened<LENS>(pixel_width<LENS>(camera));
            }
            const unsigned are_meshes
                = list_near<TYPES, LENS>(batch, shapes, meshes, fields, camera, region, world, mine, own);
            const auto ray_of = [&](int sample) {
                const int pixel = sample % PIXELS;
                const Edge edge = edge_of(pixel);
                const ViewRay<LENS> ray = sample_ray<LENS>(camera, edge.i, edge.j, sample / PIXELS);
                return ClippedRay<LENS> { ray, HAS_MESH ? upper(near, batch.meshes[pixel].first) : near };
            };
            int first = 0;
            const auto next_rays = [&](int& found) {
                if (first >= total)
                    return false;
                const bool active = first + lane < total;
                const int sample = batch.traced[active ? first + lane : first], pixel = sample % PIXELS;
                first += LANES;
                unsigned around_it = __shfl_sync(ALL, own[0], pixel % LANES);
                if (EACH == 2) {
                    const unsigned other = __shfl_sync(ALL, own[EACH - 1], pixel % LANES);
                    around_it = pixel < LANES ? around_it : other;
                }
                around_it = active ? around_it : 0;
                const unsigned together = bits_of_all(around_it);
                const auto ray = ray_of(sample);
                Hit hit { batch.depth[sample], batch.shape[sample], -1 };
                trace_own<TYPES, LENS>(batch.records, together & ~are_meshes, around_it, ray, near, fields,
                                       batch.fields[HAS_FIELD ? pixel : 0], hit);
                if (active) {
                    batch.depth[sample] = hit.depth;
                    batch.shape[sample] = hit.shape;
                }
                if (HAS_MESH) {
                    const float until = lower(hit.depth, batch.meshes[pixel].last);
                    unsigned met = 0;
                    for (unsigned left = together & are_meshes; left; left &= left - 1) {
                        const int rank = lowest_bit(left);
                        const Record& record = batch.records[rank];
                        if ((around_it >> rank & 1) && as_float(record.size.w) < until
                            && meets_mesh(meshes, record, ray.local(record), ray.near, until))
                            met |= 1u << rank;
                    }
                    MeshRays<1>& rays = waiting[HAS_MESH ? warp : 0];
                    const unsigned meeting = __ballot_sync(ALL, met != 0);
                    const int at = rays.put(meeting, &met, 1, sample);
                    if (met)
                        rays.depth[at] = until;
                    __syncwarp();
                    found = __popc(meeting);
                }
                return true;
            };
            if (HAS_MESH) {
                const auto store = [&](int sample, const Hit& hit) {
                    batch.depth[sample] = hit.depth;
                    batch.shape[sample] = hit.shape;
                };
                trace_rays<TYPES>(waiting[HAS_MESH ? warp : 0], Ranked { batch.records, {}, LANES }, meshes, near,
                                  next_rays, ray_of, store);
            } else {
                int none;
                while (next_rays(none)) { }
            }
            __syncwarp();
        }
        for (int k = lane; k < total; k += LANES) {
            const int sample = batch.traced[k];
            const Edge edge = edge_of(sample % PIXELS);
            batch.shape[sample] = int(seen.shown(edge.i, edge.j, sample_offset(sample / PIXELS), batch.depth[sample],
                                                 batch.shape[sample]));
        }
        __syncwarp();
        for (int pixel = lane; pixel < pixels; pixel += LANES) {
            const Edge edge = edge_of(pixel);
            unsigned shown[SAMPLES];
            for (int sample = 0; sample < SAMPLES; ++sample)
                shown[sample] = unsigned(batch.shape[sample * PIXELS + pixel]);
            put_means<IMAGES>(target, seen.at(edge.i, edge.j), shown);
        }
        __syncwarp();
    }
}

#endif

// Smooths the edges of one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Shapes, class Meshes, class HeightFields,
          class Views, class Target>
WARPCAM_FN void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Views& views,
                       const Target& target, int index)
{
    alignas(16) WARPCAM_SHARED Camera camera;
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index / THREADS, world);
    if (!wp::index(target.mask, world))
        return;
    if (index % THREADS == 0)
        camera = load_camera(wp::index(views, world));
    block_barrier();
    const Seen<LENS, Target> seen { target, unsigned(world) * target.height * target.width, pixel_width<LENS>(camera),
                                    camera.scale_y };
    smooth_region<TYPES, LENS, WIDTH, HEIGHT, IMAGES>(shapes, meshes, fields, target, camera, seen, region, world);
}

}  // namespace warpcam
