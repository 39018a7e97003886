// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// A block finds the edges of one region and lists their pixels. A warp then takes 32 of them: what their samples may hit
// are the shapes that are seen in the pixels around, which are few, so that a list of shapes is made for each 32 pixels
// and nothing else is traced. Samples on a side where there is no edge are not traced either. A sample has the colour of
// the nearest pixel that shows the same surface: nothing is lit anew, whatever made the image.
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

// What the samples of a warp's pixels are traced against, and what they hit. A sample: 32 * its number + its pixel.
// SLOW: there are meshes or height fields.
template <bool SLOW> struct Batch {
    Record records[LANES];  // nearest first where there are meshes
    float depth[SAMPLES * LANES];
    int shape[SAMPLES * LANES];  // in the end: the pixel of the image that shows it
    int face[SLOW ? SAMPLES * LANES : 1];
    unsigned char traced[SAMPLES * LANES];  // the samples that are
    Band meshes[SLOW ? LANES : 1], fields[SLOW ? LANES : 1];  // of each pixel
};

// Shapes of a batch, as bits by their places among its records.
struct Near {
    unsigned own;     // those around the lane's pixel
    unsigned meshes;  // those that are meshes
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

// Makes the records of the warp's shapes, a lane each, -1 for none. `own` are bits by lane.
template <int TYPES, int LENS, bool SLOW, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN Near list_near(Batch<SLOW>& batch, const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                          const Camera& camera, const Region& region, int world, int id, unsigned own)
{
    const int lane = threadIdx.x % LANES;
    Record record;
    const bool seen = id >= 0
        && sample_record<TYPES, LENS>(shapes, meshes, fields, camera, region, world, id, record);
    const unsigned listed = __ballot_sync(ALL, seen);
    int rank = lane;
    if (TYPES >> MESH & 1) {  // the lanes have the ids in descending order
        const float key = seen ? as_float(record.size.w) : 0.0f;
        rank = 0;
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left);
            const float other = __shfl_sync(ALL, key, from);
            rank += other < key || (other == key && from < lane);
        }
    }
    if (seen)
        batch.records[rank] = record;
    Near near { own & listed, 0 };
    if (TYPES >> MESH & 1) {
        near = { 0, bits_of_all(seen && is_mesh<TYPES>(record) ? 1u << rank : 0) };
        for (unsigned left = listed; left; left &= left - 1) {
            const int from = lowest_bit(left);
            near.own |= (own >> from & 1) << __shfl_sync(ALL, rank, from);
        }
    }
    __syncwarp();
    return near;
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
    constexpr int WARPS = THREADS / LANES;
    WARPCAM_SHARED unsigned short listed[WIDTH * HEIGHT];
    WARPCAM_SHARED int count, next;
    WARPCAM_SHARED Batch<SLOW> batches[WARPS];
    WARPCAM_SHARED PairedMeshRays<1> waiting[HAS_MESH ? WARPS : 1];
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    if (threadIdx.x == 0)
        count = next = 0;
    block_barrier();

    const auto sided = [&](int shape) { return has_sides<TYPES>(shapes, shape); };
    const int across = region.width / TILE_WIDTH, tiles = across * (region.height / TILE_HEIGHT);
    for (int tile = warp; tile < tiles; tile += WARPS) {
        const int i = region.left + tile % across * TILE_WIDTH + lane % TILE_WIDTH;
        const int j = region.top + tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
        const bool inside = i < target.width && j < target.height;
        const unsigned samples = inside ? seen.template edge<IMAGES>(i, j, sided) : 0;
        if (inside)
            target.edges.data[seen.at(i, j)] = samples != 0;
        const unsigned found = __ballot_sync(ALL, samples != 0);
        if (found) {
            const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&count, __popc(found)) : 0, 0);
            if (samples)
                listed[begin + __popc(found & ((1u << lane) - 1))]
                    = static_cast<unsigned short>(place_of(region, i, j) << SAMPLES | samples);
        }
    }
    block_barrier();

    Batch<SLOW>& batch = batches[warp];
    const float near = camera.near;
    const int turns = (count + THREADS - 1) / THREADS;  // of each warp, which get equal shares of the pixels
    const int share = turns ? (count + WARPS * turns - 1) / (WARPS * turns) : 0;
    while (true) {
        const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&next, share) : 0, 0);
        if (begin >= count)
            return;
        const int pixels = lower_int(count - begin, share);
        const unsigned word = listed[begin + lower_int(lane, pixels - 1)], place = word >> SAMPLES;
        const unsigned samples = lane < pixels ? word & EVERY_SAMPLE : 0;
        const int i = region.left + int(place % 64), j = region.top + int(place / 64);
        int traced = 0, total = 0;  // before this lane's, and all
        for (int sample = 0; sample < SAMPLES; ++sample) {
            const unsigned lanes = __ballot_sync(ALL, samples >> sample & 1);
            traced += __popc(lanes & ((1u << lane) - 1));
            total += __popc(lanes);
        }
        for (int sample = 0; sample < SAMPLES; ++sample) {
            const bool needed = samples >> sample & 1;
            batch.depth[sample * LANES + lane] = camera.far;
            batch.shape[sample * LANES + lane] = needed ? -1 : int(seen.at(i, j));
            if (needed)
                batch.traced[traced++] = static_cast<unsigned char>(sample * LANES + lane);
        }
        __syncwarp();
        int around[9];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            around[k] = lane < pixels ? seen.shape(seen.around(i, j, k)) : -1;
        const auto next_id = [&] {
            int id = around[0];
#pragma unroll
            for (int k = 1; k < 9; ++k)
                id = around[k] > id ? around[k] : id;
            return greatest(id);
        };
        int id = next_id();
        while (id >= 0) {  // 32 shapes at a time
            int mine = -1, shapes_near = 0;
            unsigned own = 0;
            Band on_meshes = NOWHERE, on_fields = NOWHERE;
            for (; id >= 0 && shapes_near < LANES; ++shapes_near, id = next_id()) {
                const int type = SLOW ? wp::index(shapes.types, id) : 0;
                bool seen_here = false;
#pragma unroll
                for (int k = 0; k < 9; ++k) {
                    const bool same = around[k] == id;
                    seen_here |= same;
                    around[k] = same ? -1 : around[k];
                    if (HAS_MESH && same && type == MESH)
                        on_meshes.include(seen.depth(seen.around(i, j, k)));
                    if (HAS_FIELD && same && type == HEIGHT_FIELD)
                        on_fields.include(seen.depth(seen.around(i, j, k)));
                }
                own |= unsigned(seen_here) << shapes_near;
                mine = lane == shapes_near ? id : mine;
            }
            if (HAS_MESH)
                batch.meshes[lane] = on_meshes.widened<LENS>(pixel_width<LENS>(camera));
            if (HAS_FIELD)
                batch.fields[lane] = on_fields.widened<LENS>(pixel_width<LENS>(camera));
            const Near shapes_around
                = list_near<TYPES, LENS>(batch, shapes, meshes, fields, camera, region, world, mine, own);
            const auto ray_of = [&](int sample) {
                const int pixel = sample % LANES, at = listed[begin + lower_int(pixel, pixels - 1)] >> SAMPLES;
                const ViewRay<LENS> ray
                    = sample_ray<LENS>(camera, region.left + at % 64, region.top + at / 64, sample / LANES);
                return ClippedRay<LENS> { ray, HAS_MESH ? upper(near, batch.meshes[pixel].first) : near };
            };
            int first = 0;
            const auto next_rays = [&](int& found) {
                if (first >= total)
                    return false;
                const bool active = first + lane < total;
                const int sample = batch.traced[active ? first + lane : first], pixel = sample % LANES;
                first += LANES;
                const unsigned own_of_pixel = __shfl_sync(ALL, shapes_around.own, pixel);
                const unsigned around_it = active ? own_of_pixel : 0, together = bits_of_all(around_it);
                const auto ray = ray_of(sample);
                Hit hit { batch.depth[sample], batch.shape[sample], -1 };
                trace_own<TYPES, LENS>(batch.records, together & ~shapes_around.meshes, around_it, ray, near, fields,
                                       batch.fields[SLOW ? pixel : 0], hit);
                if (active) {
                    batch.depth[sample] = hit.depth;
                    batch.shape[sample] = hit.shape;
                }
                if (HAS_MESH) {
                    const float until = lower(hit.depth, batch.meshes[pixel].last);
                    unsigned met = 0;
                    for (unsigned left = together & shapes_around.meshes; left; left &= left - 1) {
                        const int rank = lowest_bit(left);
                        const Record& record = batch.records[rank];
                        if ((around_it >> rank & 1) && as_float(record.size.w) < until
                            && meets_mesh(meshes, record, ray.local(record), ray.near, until))
                            met |= 1u << rank;
                    }
                    PairedMeshRays<1>& rays = waiting[HAS_MESH ? warp : 0];
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
                    batch.face[sample] = hit.face;
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
            const int sample = batch.traced[k], at = listed[begin + sample % LANES] >> SAMPLES;
            batch.shape[sample] = int(shown_sample<TYPES, IMAGES>(
                seen, shapes, meshes, fields, camera, region, world, region.left + at % 64, region.top + at / 64,
                sample / LANES, batch.depth[sample], batch.shape[sample], HAS_MESH ? batch.face[SLOW ? sample : 0] : -1));
        }
        __syncwarp();
        if (lane < pixels) {
            unsigned shown[SAMPLES];
            for (int sample = 0; sample < SAMPLES; ++sample)
                shown[sample] = unsigned(batch.shape[sample * LANES + lane]);
            put_means<IMAGES>(target, seen.at(i, j), shown);
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
