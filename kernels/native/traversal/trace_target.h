// Target of a block: one region of one view, and the outputs of the trace there.
#pragma once
#include "traversal/normal_cache.h"
#include "flow/optical_flow.h"
#include "flow/shape_motion.h"
#include "geometry/analytic_normal.h"
#include "output/hit_attributes.h"
#include "traversal/trace_outputs.h"
#include "output/store_vec3.h"
#include "traversal/trace_tile.h"

namespace warpcam {

// Pixel (i, j) is column i and row j of the image.
template <class Types, int LENS, int OUTPUTS, class List, int TALL_, class Target, class Shapes, class Places_>
struct TraceTarget {
    static constexpr int CAPACITY = List::SIZE;
    static constexpr int TILES_PER_WARP = TALL_;  // tiles at once

    const Target& target;
    const Shapes& shapes;
    const List& list;
    const Camera& camera;
    Region region;
    int world;
    Places_& places;
    using Facings_ = NormalCache<((OUTPUTS & NORMAL) && THREADS > 1 ? CAPACITY : 0)>;
    Facings_& facings;
    const float *columns, *rows;  // x of the region's columns, y of its rows, where they are LINED
    int part = 0, parts = 1;      // of the region, and which of them is drawn
    static constexpr bool LINED = THREADS > 1 && TILES_PER_WARP > 1 && LENS == PINHOLE;
    static constexpr int VECTOR_OUTPUTS =
        OUTPUTS & WIDTH_MULTIPLE_OF_4 ? OUTPUTS & (POINTS | NORMAL) : 0;  // stored by 16 bytes
    static constexpr bool TILES_INSIDE = (OUTPUTS & NO_PARTIAL_TILES) != 0;
    static constexpr bool WHOLE = Places_::WHOLE;  // the region is an image of known size
    static constexpr bool PROJECTS = (OUTPUTS & PROJECTED_FACES) != 0;  // see traversal/projected_faces.h
    // More than depth and shape.
    static constexpr bool STORES_MUCH =
        OUTPUTS & (DISTANCE | POINTS | BODIES | NORMAL | IDS | INSTANCES | SEMANTICS | FLOWS | TRACE_ALBEDO);
    // The motions of few shapes: one warp composes them while the others begin to draw.
    static constexpr bool APART = !(OUTPUTS & LISTED_AHEAD) && (OUTPUTS & FLOWS) && (OUTPUTS & FLOW_LISTED)
                                  && CAPACITY <= WARP_SIZE && !(Types::has(MESH));

    // True if tiles that show nothing but an infinite plane are written without a trace: see
    // traversal/infinite_plane.h.
    static constexpr bool BARE_FLOORS = THREADS > 1 && TILES_PER_WARP > 1 && LENS == PINHOLE&& Types::has(PLANE)
                                        && (OUTPUTS & NO_PARTIAL_TILES) && !((OUTPUTS & FLOWS) && names_slots(OUTPUTS));
    static constexpr bool PUTS_BARE = BARE_FLOORS && !(OUTPUTS & FLOWS);
    // Whole rows of two stacks of such tiles beside each other are written where listed shapes are few, but for these.
    static constexpr bool PUTS_ROWS = BARE_FLOORS && TILES_PER_WARP == 2 && (OUTPUTS & LISTED_AHEAD)
                                      && CAPACITY <= WARP_SIZE
                                      && !(OUTPUTS & (FACE | POINTS | NORMAL | IDS | FLOWS | TRACE_ALBEDO));
    static constexpr int TILE_COLUMNS_PER_WARP = PUTS_ROWS ? 2 : 1;  // stacks

    WARPCAM_DEVICE bool inside(int i, int j) const
    {
        return (OUTPUTS & NO_PARTIAL_TILES) || (i < target.width && j < target.height);
    }

    static constexpr bool FROM_VIEW = THREADS > 1 && (OUTPUTS & IN_VIEW);  // see traversal/shapes_in_view.h

    // The number of a pixel, of all worlds': that of the k-th tile below pixel (i, j). In images of known size these
    // are at known distances from one address.
    WARPCAM_DEVICE auto at(int i, int j, int k = 0) const
    {
        if constexpr (WHOLE)
            return size_t((unsigned(world) * region.height + j) * region.width + i)
                   + size_t(k * TILE_HEIGHT * region.width);
        else
            return (unsigned(world) * target.height + (j + k * TILE_HEIGHT)) * target.width + i;
    }

    WARPCAM_DEVICE CameraRay<LENS> ray(int i, int j) const
    {
        if constexpr (LINED)
            return { columns[i - region.left], rows[j - region.top] };
        return view_ray<LENS>(camera, i, j);
    }

    // Starts loads by the block's last threads while its first ones list shapes.
    WARPCAM_DEVICE void begin(int thread) const
    {
        if constexpr ((OUTPUTS & FLOWS) && (OUTPUTS & FLOW_LISTED))
            compose_motions<OUTPUTS, Types, LENS>(target.history, shapes, camera, places.previous, world,
                                                  target.history.keep && region.left == 0 && region.top == 0, thread,
                                                  places.near_motions);
    }

    // For a thread for each row of the region, and part, which has fetched what was seen there if that is near: what of
    // the floor was.
    WARPCAM_DEVICE void find_floor(int row) const
    {
#if defined(__CUDA_ARCH__)
        if constexpr (Places_::LOOKS_AT_FLOORS) {
            const int shape = floor_of(shapes, target.history.columns);
            begin_floor(places, target.history, region, row, shape);
            if (OUTPUTS & FLOW_NEAR) {
                await_rows();
                find_row(places, row, shape);
            }
        }
#endif
    }

    // For a warp, which has composed the motions if a stage has not: how the floor has moved.
    WARPCAM_DEVICE void follow_floor(const Camera& seen_by) const
    {
#if defined(__CUDA_ARCH__)
        if constexpr (Places_::LOOKS_AT_FLOORS) {
            const int shape = floor_of(shapes, target.history.columns);
            if (threadIdx.x % WARP_SIZE != 0)
                return;
            if constexpr ((OUTPUTS & LISTED_AHEAD) != 0)  // those that the block copies are not there yet
                find_slopes(places, Places_::composed(target.history, world, shape), shapes, seen_by, world, shape);
            else
                find_slopes(places, places.of_shape(shape), shapes, seen_by, world, shape);
        }
#endif
    }

    // For a warp or the block, when it has met after all of this: where what is seen of the floor now was seen.
    template <int WARP_OR_ONE> WARPCAM_DEVICE void look_at_floor(int thread) const
    {
#if defined(__CUDA_ARCH__)
        if constexpr (Places_::LOOKS_AT_FLOORS) {
            find_seen_floor<WARP_OR_ONE>(places, region, target.width, target.height, thread);
            team_barrier<WARP_OR_ONE>();
        }
#endif
    }

    // Notes what pixels take of their shapes alone, once these are listed; for so many threads.
    WARPCAM_DEVICE void face(int thread, int threads) const
    {
#if defined(__CUDA_ARCH__)
        if constexpr ((OUTPUTS & NORMAL) != 0) {
            if (thread == 0)
                facings.begin();
            for (int slot = thread - 1; slot < list.count; slot += threads)
                if (slot >= 0)
                    facings.template note<Types>(slot, list.records[slot], list.ids[slot], camera);
        }
#endif
        if constexpr (Places_::WRITES_ALBEDO)
            places.face(list, thread, threads);
    }

    // Notes the endless floor: see there.
    WARPCAM_DEVICE void note(List& listed, int slot, int rank) const
    {
#if defined(__CUDA_ARCH__)
        if constexpr (BARE_FLOORS)
            listed.floor.note(listed.records[slot], listed.ids[slot], rank, camera.near, camera.far);
#endif
    }

    // Completes the loads, once the threads of the block have met.
    WARPCAM_DEVICE void ready() const
    {
        if (OUTPUTS & FLOW_NEAR)
            await_rows();
    }

    // Initial hit of a ray before a pass: the previous pass's, or none. Rays outside the image hit nothing.
    WARPCAM_DEVICE Hit start(int i, int j, bool first_pass) const
    {
        if constexpr ((OUTPUTS & FLOW_VALID) != 0)
            if (inside(i, j))
                places.expect(target.history, i, j);
        Hit hit { inside(i, j) ? camera.far : -1.0f, -1, -1 };
        if constexpr (has_table(LENS))
            if (sees_nothing(ray(i, j)))
                hit.depth = -1.0f;
        if (!first_pass && inside(i, j) && target.shape.data[at(i, j)] >= 0) {
            hit.depth = target.depth.data[at(i, j)];
            if (!(OUTPUTS & IN_VIEW))  // of shapes at one place the later is seen; those in view are in that order
                hit.depth = next_float(hit.depth);
        }
        return hit;
    }

    // Writes a pixel of the image, that of the k-th tile below (i, j): WHAT of it.
    template <int WHAT> WARPCAM_DEVICE void put(int i, int j, const Hit& hit, int k = 0) const
    {
        put_named<WHAT>(i, j, hit, shape_of(hit), k);
    }

    // Writes the outputs of a hit on a shape whose id is known.
    template <int WHAT> WARPCAM_DEVICE void put_named(int i, int j, const Hit& hit, int shape, int k) const
    {
        const auto pixel = at(i, j, k);
        const CameraRay<LENS> seen = ray(i, j + k * TILE_HEIGHT);
        if (WHAT & DEPTH)
            target.depth.data[pixel] = depth_of(hit);
        if (WHAT & SHAPE)
            target.shape.data[pixel] = shape;
        if (WHAT & FACE)
            target.face.data[pixel] = hit.face;
        if (WHAT & DISTANCE)
            target.distance.data[pixel] = has_table(LENS) && hit.shape < 0 ? camera.miss : distance_of(hit, seen);
        if (WHAT & BODIES)
            target.bodies.data[pixel] = body_of<(OUTPUTS & BY_WORLD) != 0>(shapes, world, shape);
        if (WHAT & IDS)
            target.ids.data[pixel] = id_of(shapes, world, shape);
        if constexpr ((WHAT & INSTANCES) != 0)
            target.labels.instances.data[pixel] = label_of(target.labels.instance_of, world, shape, -1);
        if constexpr ((WHAT & SEMANTICS) != 0)
            target.labels.semantics.data[pixel] = label_of(target.labels.semantic_of, world, shape, 0);
        if (WHAT & POINTS)
            put_three(target.points.data, pixel, point_of(hit, camera, seen));
        if constexpr ((WHAT & NORMAL) != 0)
            put_three(target.normals.data, pixel, normal_of(hit, seen));
        if constexpr ((WHAT & FLOWS) != 0)
            put_flow<Types, LENS, WHAT>(target.history, places, shapes, camera, seen, { hit.depth, shape, hit.face },
                                        world, i, j, k * TILE_HEIGHT, pixel);
    }

    // Writes what a pass has found.
    WARPCAM_DEVICE void write_hit(int i, int j, const Hit& hit, bool first_pass, int k = 0) const
    {
        if (inside(i, j + k * TILE_HEIGHT) && (first_pass || hit.shape >= 0))
#if defined(__CUDA_ARCH__)
            put<OUTPUTS>(i, j, hit, k);
#else
            put_written<OUTPUTS>(target, [&](auto images) { put<decltype(images)::SET>(i, j, hit, k); });
#endif
    }

    WARPCAM_DEVICE float depth_of(const Hit& hit) const
    {
        return hit.shape < 0 ? (has_table(LENS) ? infinity() : camera.miss) : hit.depth;
    }

    WARPCAM_DEVICE int shape_of(const Hit& hit) const
    {
        if constexpr (!names_slots(OUTPUTS))
            return hit.shape;
        else if constexpr (Places_::WRITES_ALBEDO)
            return places.slots[hit.shape + 1].id;
        else
#if defined(__CUDA_ARCH__)
            return facings.rows[hit.shape + 1].w;
#else
            return hit.shape >= 0 ? list.ids[hit.shape] : -1;
#endif
    }

    WARPCAM_DEVICE Vec3 normal_of(const Hit& hit, const CameraRay<LENS>& seen) const
    {
#if defined(__CUDA_ARCH__)
        using Bending = SceneTypes<Types::GEOMETRY & ~(1 << PLANE), Types::FEATURES>;
        const Float3Int row = facings.rows[hit.shape + 1];
        if (row.x != NORMAL_VARIES)
            return as_vec3(row);
#else
        using Bending = Types;
        if (hit.shape < 0)
            return { 0.0f, 0.0f, 0.0f };
#endif
        return transform(camera.rotation, normalized(gradient<Bending>(list.records[hit.shape], seen, hit.depth)));
    }

#if defined(__CUDA_ARCH__)
    // Writes all tiles of a warp that begin with pixel (i, j), if they show only floor that was seen; else false.
    WARPCAM_DEVICE bool write_seen_plane(int i, int j, const Hit (&hit)[TILES_PER_WARP], int lane) const
    {
        if constexpr (Places_::LOOKS_AT_FLOORS) {
            const FlowFloor& floor = places.floor;
            const auto& history = target.history;
            const unsigned here = FlowFloor::part_of(i, j);
            const int seen = *const_cast<const volatile int*>(floor.seen + here), shape = seen & FlowFloor::NONE;
            if (!__all_sync(FULL_WARP, hit[0].shape == shape && hit[1].shape == shape)) {
                if (!__all_sync(FULL_WARP, hit[0].shape == floor.shape && hit[1].shape == floor.shape) && lane == 0)
                    floor.region_parts[here] = 0;
                return false;
            }
            // The words of a part lie together, two a lane; of whether pixels were seen eight lanes have a row each.
            if (!WHOLE) {
                const unsigned word = FlowFloor::word(shape) * 0x00010001u;
                keep_word(reinterpret_cast<unsigned*>(places.kept + (Places_::place_of(history, i, j) - lane)), lane,
                          word);
            }
            constexpr unsigned ONES = 0x01010101u;
            if (!(seen & FlowFloor::OUTSIDE) && lane < FlowFloor::PART) {
                unsigned char* row = history.flow_valid.data + at(i, j) + lane * (Places_::width(history) - 1);
                *reinterpret_cast<uint2*>(row) = make_uint2(ONES, ONES);
            }
            constexpr bool TOGETHER = (OUTPUTS & FLOW) && (OUTPUTS & LISTED_AHEAD);  // else more is spilled
            if constexpr (TOGETHER)
                put_flow_of<LENS>(history, places, shape, hit, i, j, TILE_HEIGHT, [&](int k) { return at(i, j, k); });
            for (int k = 0; k < TILES_PER_WARP; ++k) {
                put<OUTPUTS & ~(TOGETHER ? FLOWS : FLOW_VALID)>(i, j, { hit[k].depth, shape, hit[k].face }, k);
                if (seen & FlowFloor::OUTSIDE) {
                    const float column = float(i), row = float(j + k * TILE_HEIGHT);
                    const auto rows = places.of_shape(shape);
                    const float depth = project_previous<LENS>(rows.at(2), column, row, hit[k].depth),
                                rate = rcp(depth);
                    const Beside across(project_previous<LENS>(rows.at(0), column, row, hit[k].depth), rate);
                    const Beside along(project_previous<LENS>(rows.at(1), column, row, hit[k].depth), rate);
                    const bool inside = across.inside(Places_::width(history)) & along.inside(Places_::height(history));
                    history.flow_valid.data[at(i, j, k)] =
                        static_cast<unsigned char>(settled((depth >= rows.at(3).z) & inside));
                }
            }
            return true;
        }
        return false;
    }

    // Writes the pixels of a warp's tiles, each lane's, the first of them at (i, j); `row_of_lanes` is room for
    // 3 * WARP_SIZE numbers of each tile where there are VECTOR_OUTPUTS.
    template <class Ray_> WARPCAM_DEVICE void put_tiles(int i, int j, const Ray_ (&rays)[TILES_PER_WARP],
                                                        const Hit (&hits)[TILES_PER_WARP], bool first_pass,
                                                        float* row_of_lanes) const
    {
        bool whole = false;
        if constexpr (VECTOR_OUTPUTS != 0)
            if (first_pass) {
                whole = true;
                put_whole(i, j, rays, hits, row_of_lanes);
            }
        if constexpr (Places_::WRITES_ALBEDO) {  // there is one pass, and all tiles lie in the image
            const auto slots = places.slots_of(hits);
            if (!whole)
                for (int k = 0; k < TILES_PER_WARP; ++k)
                    put_named<OUTPUTS>(i, j, hits[k], slots.at[k].id, k);
            places.write_albedo(*this, i, j, rays, hits, slots);
        } else if (!whole) {
            for (int k = 0; k < TILES_PER_WARP; ++k)
                write_hit(i, j, hits[k], first_pass, k);
        }
    }

    template <class Ray_> WARPCAM_DEVICE void put_whole(int i, int j, const Ray_ (&rays)[TILES_PER_WARP],
                                                        const Hit (&hits)[TILES_PER_WARP], float* row_of_lanes) const
    {
        Vec3 values[TILES_PER_WARP];
        if constexpr ((VECTOR_OUTPUTS & NORMAL) != 0)
            for (int k = 0; k < TILES_PER_WARP; ++k)
                values[k] = normal_of(hits[k], rays[k]);
        for (int k = 0; k < TILES_PER_WARP; ++k)
            if (inside(i, j + k * TILE_HEIGHT))
                put<OUTPUTS & ~VECTOR_OUTPUTS>(i, j, hits[k], k);
        if constexpr ((VECTOR_OUTPUTS & NORMAL) != 0)
            store_vectors(*this, target.normals.data, i, j, values, row_of_lanes);
        if constexpr ((VECTOR_OUTPUTS & POINTS) != 0) {
            find_points<true>(camera, rays, hits, values);
            store_vectors(*this, target.points.data, i, j, values, row_of_lanes);
        }
    }

    // Writes so many stacks beside each other, whose first pixel is given, if they surely show the endless floor, which
    // is all that touches them; else false. A lane has two pixels beside each other in each of two rows.
    WARPCAM_DEVICE bool write_plane_rows(int left, int top, int lane) const
    {
        constexpr int LANES_A_ROW = TILE_COLUMNS_PER_WARP * TILE_WIDTH / 2;
        static_assert(WARP_SIZE / LANES_A_ROW == TILE_HEIGHT);
        const int i = left + 2 * int(unsigned(lane) % LANES_A_ROW), j = top + int(unsigned(lane) / LANES_A_ROW);
        const float2 x = *reinterpret_cast<const float2*>(columns + i);
        CameraRay<PINHOLE> rays[2 * TILE_COLUMNS_PER_WARP];
        Hit hits[2 * TILE_COLUMNS_PER_WARP];
        for (int k = 0; k < TILE_COLUMNS_PER_WARP; ++k) {
            rays[2 * k] = { x.x, rows[j + k * TILE_HEIGHT] };
            rays[2 * k + 1] = { x.y, rays[2 * k].y };
        }
        if (!list.floor.test(rays, hits))
            return false;
        const int shape = list.floor.shape;
        __builtin_assume(shape >= 0);
        const auto put_same = [&](auto* image, int number) {
            for (int k = 0; k < TILE_COLUMNS_PER_WARP; ++k)
                put_two(image + at(i, j, k), number, number);
        };
        for (int k = 0; k < TILE_COLUMNS_PER_WARP; ++k) {
            const Hit a { hits[2 * k].depth, shape, -1 }, b { hits[2 * k + 1].depth, shape, -1 };
            if (OUTPUTS & DEPTH)
                put_two(target.depth.data + at(i, j, k), a.depth, b.depth);
            if (OUTPUTS & DISTANCE)
                put_two(target.distance.data + at(i, j, k), distance_of(a, rays[2 * k]),
                        distance_of(b, rays[2 * k + 1]));
        }
        if (OUTPUTS & SHAPE)
            put_same(target.shape.data, shape);
        if (OUTPUTS & BODIES)
            put_same(target.bodies.data, body_of<(OUTPUTS & BY_WORLD) != 0>(shapes, world, shape));
        if constexpr ((OUTPUTS & INSTANCES) != 0)
            put_same(target.labels.instances.data, label_of(target.labels.instance_of, world, shape, -1));
        if constexpr ((OUTPUTS & SEMANTICS) != 0)
            put_same(target.labels.semantics.data, label_of(target.labels.semantic_of, world, shape, 0));
        return true;
    }

    // Writes tiles, as put_tiles() does, whose hits are all on the infinite plane.
    template <class Ray_> WARPCAM_DEVICE void write_plane_tile(int i, int j, const Ray_ (&rays)[TILES_PER_WARP],
                                                               const Hit (&hits)[TILES_PER_WARP],
                                                               float* row_of_lanes) const
    {
        const int shape = list.floor.shape;
        __builtin_assume(shape >= 0);
        for (int k = 0; k < TILES_PER_WARP; ++k)
            put_named<OUTPUTS & ~VECTOR_OUTPUTS>(i, j, { hits[k].depth, shape, -1 }, shape, k);
        if constexpr ((VECTOR_OUTPUTS & NORMAL) != 0) {
            const Float3Int piece = facings.endless[threadIdx.x % TILE_WIDTH % 3];
            store_pieces(*this, target.normals.data, i, j, [&](int) { return piece; });
        }
        if constexpr ((VECTOR_OUTPUTS & POINTS) != 0) {
            Vec3 values[TILES_PER_WARP];
            find_points<false>(camera, rays, hits, values);
            store_vectors(*this, target.points.data, i, j, values, row_of_lanes);
        }
        if constexpr (Places_::WRITES_ALBEDO)
            places.write_plane_albedo(*this, i, j, rays, hits);
    }
#endif
};

}  // namespace warpcam
