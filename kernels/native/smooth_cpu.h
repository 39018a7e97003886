// Smooth edges on a CPU: a few pixels' samples together.
#pragma once
#include "samples.h"
#include "tiles.h"

#if !defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int BATCH = LANES / SAMPLES;  // pixels

// From where on the rays see one shape: nowhere if it is not around their pixel.
struct OwnNear {
    float own[LANES];

    float at(int lane) const { return own[lane]; }
};

// A shape that is seen around some pixels of a batch.
struct NearShape {
    Record record;
    int id;
    bool around[BATCH];
};

// A pixel with an edge.
struct Edge {
    int i, j;
    unsigned samples;  // to trace, and PLAIN
};

// Smooths a few pixels.
template <int TYPES, int LENS, int IMAGES, class Shapes, class Meshes, class HeightFields, class Centres>
inline void smooth_pixels(const Edge* listed, int pixels, const Shapes& shapes, const Meshes& meshes,
                          const HeightFields& fields, const Camera& camera, const Seen<LENS, Centres>& seen,
                          const Region& region, int world)
{
    NearShape near[9 * BATCH];
    const NearShape* order[9 * BATCH];
    int found = 0, count = 0;
    Band on_meshes[BATCH], on_fields[BATCH];
    int ground[BATCH];  // ids of what lies behind all else, or -1
    for (int pixel = 0; pixel < pixels; ++pixel) {
        on_meshes[pixel] = on_fields[pixel] = NOWHERE;
        Band others = NOWHERE;
        bool sky = false, several = false;
        ground[pixel] = -1;
        for (int k = 0; k < 9; ++k) {
            const unsigned beside = seen.around(listed[pixel].i, listed[pixel].j, k);
            const int id = seen.shape(beside);
            int slot = 0;
            while (slot < found && near[slot].id != id)
                ++slot;
            sky |= id < 0;
            if (id < 0)
                continue;
            if (slot == found) {
                near[found++].id = id;
                for (int other = 0; other < BATCH; ++other)
                    near[slot].around[other] = false;
            }
            near[slot].around[pixel] = true;
            const int type = wp::index(shapes.types, id);
            if (type == HEIGHT_FIELD) {
                several |= ground[pixel] >= 0 && ground[pixel] != id;
                ground[pixel] = id;
            }
            if (type == MESH)
                on_meshes[pixel].include(seen.depth(beside));
            (type == HEIGHT_FIELD ? on_fields[pixel] : others).include(seen.depth(beside));
        }
        if (several || !is_behind<LENS>(on_fields[pixel], others, sky, pixel_width<LENS>(camera)))
            ground[pixel] = -1;
        on_meshes[pixel] = on_meshes[pixel].template widened<LENS>(pixel_width<LENS>(camera));
        on_fields[pixel] = on_fields[pixel].template widened<LENS>(pixel_width<LENS>(camera));
    }
    for (int slot = 0; slot < found; ++slot) {
        NearShape& one = near[slot];
        if (!sample_record<TYPES, LENS>(shapes, meshes, fields, camera, region, world, one.id, one.record))
            continue;
        one.record.axis_y.w = slot;
        int rank = count++;  // as in NearShapes::prepare_all()
        const float key = TYPES >> MESH & 1 ? as_float(one.record.size.w) : 0.0f;
        for (; rank > 0; --rank) {
            const float other = TYPES >> MESH & 1 ? as_float(order[rank - 1]->record.size.w) : 0.0f;
            if (other < key || (other == key && order[rank - 1]->id > one.id))
                break;
            order[rank] = order[rank - 1];
        }
        order[rank] = &one;
    }
    Rays rays;
    for (int lane = 0; lane < LANES; ++lane) {
        const Edge at = listed[lower_int(lane / SAMPLES, pixels - 1)];
        const ViewRay<LENS> ray = sample_ray<LENS>(camera, at.i, at.j, lane % SAMPLES);
        rays.x[lane] = ray.x;
        rays.y[lane] = ray.y;
        rays.depth[lane] = lane / SAMPLES < pixels ? camera.far : -1.0f;
        rays.shape[lane] = rays.face[lane] = -1;
    }
    const auto trace_type = [&](int type) {  // 0: those that are neither
        const bool slow = type == MESH || type == HEIGHT_FIELD;
        const Band* bands = type == MESH ? on_meshes : on_fields;
        const Rays before = rays;
        for (int lane = 0; slow && lane < LANES; ++lane)
            rays.depth[lane] = lower(rays.depth[lane], bands[lower_int(lane / SAMPLES, pixels - 1)].last);
        for (int rank = 0; rank < count; ++rank) {
            const NearShape& one = *order[rank];
            const int its = one.record.axis_x.w;
            if ((its == MESH || its == HEIGHT_FIELD ? its : 0) != type)
                continue;
            OwnNear from;
            for (int lane = 0; lane < LANES; ++lane) {
                const int pixel = lower_int(lane / SAMPLES, pixels - 1);
                const bool traced = one.around[pixel] && listed[pixel].samples >> lane % SAMPLES & 1
                    && !(its == HEIGHT_FIELD && ground[pixel] >= 0);
                from.own[lane] = !traced ? FAR_AWAY : slow ? upper(camera.near, bands[pixel].first) : camera.near;
            }
            if (type == MESH)
                trace_mesh<TYPES, LENS, true>(meshes, one.record, from, rays);
            else
                trace_record<TYPES, LENS>(one.record, from, fields, rays);
        }
        for (int lane = 0; slow && lane < LANES; ++lane)
            if (rays.shape[lane] == before.shape[lane])
                rays.depth[lane] = before.depth[lane];
    };
    trace_type(0);
    if (TYPES >> HEIGHT_FIELD & 1)
        trace_type(HEIGHT_FIELD);
    if (TYPES >> MESH & 1)
        trace_type(MESH);
    for (int pixel = 0; pixel < pixels; ++pixel) {
        const Edge at = listed[pixel];
        unsigned by[SAMPLES];
        for (int sample = 0; sample < SAMPLES; ++sample) {
            const int lane = pixel * SAMPLES + sample;
            const int shown = !(at.samples >> sample & 1) ? ITSELF
                : rays.shape[lane] < 0                    ? seen.nearest(at.i, at.j, sample, ground[pixel])
                                       : shown_sample<TYPES, IMAGES>(seen, meshes, camera, at.i, at.j, sample,
                                                                     rays.depth[lane], rays.face[lane],
                                                                     near[rays.shape[lane]].record, at.samples);
            by[sample] = seen.around(at.i, at.j, shown);
        }
        put_means<IMAGES>(seen.centres, seen.centres.of_images(at.i, at.j), by);
    }
}

template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool IN_PLACE, class Shapes, class Meshes,
          class HeightFields, class Target>
inline void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Target& target,
                          const Camera& camera, const Region& region, int world)
{
    const ImageCentres<Target> centres { target, unsigned(world) * target.height * target.width };
    const Seen<LENS, ImageCentres<Target>> seen { centres, pixel_width<LENS>(camera), camera.scale_y };
    Edge listed[BATCH];
    int count = 0;
    const int right = lower_int(region.left + region.width, target.width);
    const int bottom = lower_int(region.top + region.height, target.height);
    const auto smooth = [&] {
        if (count)
            smooth_pixels<TYPES, LENS, IMAGES>(listed, count, shapes, meshes, fields, camera, seen, region, world);
        count = 0;
    };
    const auto sided = [&](int shape) { return has_sides<TYPES>(shapes, shape); };
    for (int j = region.top; j < bottom; ++j)
        for (int i = region.left; i < right; ++i) {
            const unsigned samples = seen.template edge<IMAGES>(i, j, sided);
            if (samples)
                listed[count++] = { i, j, samples };
            if (count == BATCH)
                smooth();
        }
    smooth();
}

}  // namespace warpcam
#endif
