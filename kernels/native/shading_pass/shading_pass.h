// From the visibility buffer to images: a block draws one region of one view.
#pragma once
#include "shading_pass/plane_strips.h"
#include "shading_pass/shade_pixel.h"
#if !defined(__CUDA_ARCH__)
#include "shading_pass/shading_pass_simd.h"
#endif

namespace warpcam {

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
// MAX_TRANSPARENT: how many shapes may be transparent.
template <class Types, int LENS, int CAPACITY, int WIDTH, int HEIGHT, int IMAGES, int FLAGS, int MAX_TRANSPARENT = 0,
          class Scene_, class Lights>
WARPCAM_DEVICE void resolve(const Scene_& scene, const Lights& lights, int index)
{
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    using Appearances = ShapeAppearance<Types, Wants>;
    using TransparentList =
        optional_t<MAX_TRANSPARENT != 0, TransparentShapes<MAX_TRANSPARENT != 0 ? MAX_TRANSPARENT : 1>>;
    constexpr int SHARED_BYTES = 44032 - (MAX_TRANSPARENT != 0 ? int(sizeof(TransparentList)) : 0);
    constexpr int CACHED =
        CAPACITY * int(sizeof(Appearances)) <= SHARED_BYTES && (Wants::SURFACE || Wants::COLORED) ? CAPACITY : 0;
    constexpr bool SHADOWS = FLAGS & HAS_SHADOWS;
    // Corners keep radiance, not display colours. Otherwise, where there is both, pixels are lit for themselves.
    constexpr bool RADIANT = IMAGES == HDR && (FLAGS & PLANE_STRIPS);
#if defined(__CUDA_ARCH__)
    constexpr bool CORNERED_LENS = LENS == PINHOLE, GENERAL = (FLAGS & GENERAL_PLANES) != 0;
#else
    constexpr bool CORNERED_LENS = LENS != RAY_TABLE_WITH_ORIGINS, GENERAL = true;
#endif
#if defined(__CUDA_ARCH__)
    constexpr int GRID_BYTES = (SHARED_BYTES < VERTEX_GRID_BYTES ? SHARED_BYTES : VERTEX_GRID_BYTES)
                               - CACHED * int(sizeof(Appearances)) - 1024;
#else
    // For few shapes there is room whatever else is kept, so that images do not depend on what a kernel is compiled
    // for.
    constexpr int GRID_BYTES =
        CAPACITY > 0 && CAPACITY <= 64 ? VERTEX_GRID_BYTES : SHARED_BYTES - CACHED * int(sizeof(Appearances)) - 1024;
#endif
    constexpr int CORNERS = Wants::GOURAUD && Types::has(PLANE) && CORNERED_LENS && (!(IMAGES & HDR) || RADIANT)
                                ? corner_room(WIDTH * HEIGHT, GRID_BYTES)
                                : 0;
    // Caches some appearances if not all fit.
    constexpr bool SOME = CACHED == 0 && (CAPACITY > 0 || CORNERS > 0) && (Wants::SURFACE || Wants::COLORED);
    constexpr int PLACES = CAPACITY > 0 ? CAPACITY : 1,
                  APPEARANCE_BYTES = sizeof(ShapeAppearance<Types, Untextured<Wants>>);
    constexpr int LEFT = (SHARED_BYTES - 2048 - CORNERS * int(sizeof(float)) - 2 * PLACES) / APPEARANCE_BYTES;
    constexpr int SEEN = CAPACITY > 0 && LEFT > 1 ? (LEFT < CAPACITY ? LEFT : CAPACITY) : 1;
    using Held = conditional_t<SOME, SeenLooks<Types, Wants, PLACES, SEEN>, Appearances>;
    constexpr int HELD = SOME ? -1 : CACHED;
    WARPCAM_SHARED Held looks[CACHED > 0 ? CACHED : 1];
    using Lit_ = conditional_t<(CORNERS > 0), LitCorners<CORNERS, SHADOWS, GENERAL>, LightList>;
#if defined(__CUDA_ARCH__)
    constexpr int NEEDED = PLANE_STRIPS | STORE_QUADS, BARRED = MIRROR_VIEW | HAS_MIRROR | HAS_HAZE;
    constexpr bool BARE_STRIPS = IMAGES == ALBEDO && Wants::TEXTURED && Types::has(PLANE) && LENS == PINHOLE;
    constexpr bool IN_STRIPS = in_quads(IMAGES) && (FLAGS & (NEEDED | BARRED)) == NEEDED && CACHED > 0
                               && (BARE_STRIPS || lit_by_corners<Lit_>(SHADOWS)) && Strips<WIDTH, HEIGHT>::FIT;
    constexpr int OWN_FACTS = IN_STRIPS ? FLAGS & ~STORE_QUADS : FLAGS & ~PLANE_STRIPS;
    constexpr bool ROOMY = CORNERS * sizeof(float) >= WIDTH * HEIGHT * sizeof(short);
    constexpr bool COVERED = IN_STRIPS && MAX_TRANSPARENT != 0;
    WARPCAM_SHARED optional_t<IN_STRIPS, StripPlan> plan;
    WARPCAM_SHARED conditional_t<COVERED, CoveredTiles<WIDTH, HEIGHT>, NoCoveredTiles> covered;
    WARPCAM_SHARED unsigned short pixels_left[IN_STRIPS && !ROOMY ? WIDTH * HEIGHT : 1];
#else
    constexpr bool IN_STRIPS = false;
#endif
    constexpr bool ON_FLOOR = CORNERS > 0 || IN_STRIPS, MIPS = Wants::TEXTURED && IN_STRIPS && (FLAGS & HAS_MIPS);
    using List = conditional_t<(IN_STRIPS && CORNERS == 0), BareFloor, Lit_>;
    WARPCAM_SHARED conditional_t<(FLAGS & PHYSICAL) != 0, AreaLights, List> list;
    WARPCAM_SHARED Camera shared_camera;
    WARPCAM_SHARED TransparentList transparent_shapes;
    const auto& frame = scene.frame;
    const int thread = index % THREADS;
    int world;
    const Region region = region_of<WIDTH, HEIGHT, Types::has(MIDDLE_FIRST)>(frame, index / THREADS, world);
    if (!wp::index(frame.mask, world))
        return;
    const int left = region.left, top = region.top;
    const unsigned first = unsigned(world) * frame.width * frame.height;
    const Camera camera = load_camera(wp::index(frame.views, world));
    if (thread == 0)
        shared_camera = camera;
    if (Wants::LIT && thread >= THREADS - WARP_OR_ONE)
        gather_lights<SHADOWS || (FLAGS & SOFT_SHADOWS)>(lights, camera, world, headlight_of<FLAGS>(world),
                                                         thread - (THREADS - WARP_OR_ONE), list);
    if constexpr ((FLAGS & MIRROR_VIEW) != 0) {
        const auto mirror = wp::index(frame.mirrors, world);
        if (mirror.shape < 0)
            return;
        if (thread == THREADS - WARP_OR_ONE && headlight_shines(lights))
            list.lights[0].place = make_float3_int(as_vec3(mirror.headlight), 0);
    }
    if constexpr (MAX_TRANSPARENT != 0) {
        Region seen = region;
        Vec3 eye = camera.origin;
        int mirror = -1;
        if constexpr ((FLAGS & MIRROR_VIEW) != 0) {  // its columns run the other way
            const auto at = wp::index(frame.mirrors, world);
            seen.left = frame.width - region.left - region.width;
            eye = as_vec3(at.eye);
            mirror = at.shape;
        }
        gather_transparent<Types, LENS, (FLAGS & PHYSICAL) == 0>(transparent_shapes, scene, camera, seen, eye, mirror,
                                                                 world, thread);
    }
#if defined(__CUDA_ARCH__)
    if constexpr (COVERED)
        covered.gather(transparent_shapes, thread);
    if constexpr (CACHED > 0)
        for (int i = thread; i < scene.shapes.drawn.shape[0]; i += THREADS) {
            const int id = wp::index(scene.shapes.drawn, i);
            looks[i] = load_appearance_for<Types, Wants>(scene, camera, world, id);
        }
    if constexpr (SOME) {
        if (thread == 0 && frame.plane >= 0)
            looks->plane = load_appearance_for<Types, Wants>(scene, camera, world, frame.plane);
        if constexpr (Held::MARKED)
            gather_looks<WIDTH, HEIGHT, FLAGS, SEEN>(*looks, scene, camera, world, first, left, top, thread);
    }
    block_sync();
#else
    bool made[CACHED > 0 ? CACHED : 1] = {};
    if constexpr (MAX_TRANSPARENT != 0 && CACHED > 0)
        for (int slot = 0; slot < transparent_shapes.count; ++slot) {
            const int place = wp::index(scene.shapes.places, transparent_shapes.ids[slot]);
            looks[place] = load_appearance_for<Types, Wants>(scene, camera, world, transparent_shapes.ids[slot]);
            made[place] = true;
        }
    if constexpr (CORNERS > 0 && CACHED > 0)
        if (frame.plane >= 0) {
            const int place = wp::index(scene.shapes.places, frame.plane);
            looks[place] = load_appearance_for<Types, Wants>(scene, camera, world, frame.plane);
            made[place] = true;
        }
    if constexpr (SOME)
        if (frame.plane >= 0)
            looks->plane = load_appearance_for<Types, Wants>(scene, camera, world, frame.plane);
#endif
    if constexpr (ON_FLOOR) {
        int plane = frame.plane;
#if defined(__CUDA_ARCH__)
        WARPCAM_SHARED optional_t<IN_STRIPS && GENERAL, int> shown_plane;
        if constexpr (IN_STRIPS && GENERAL)
            if (frame.planes > 1) {
                if (thread < WARP_SIZE)
                    plane = most_shown_plane(scene, region, first, thread);
                if (thread == 0)
                    shown_plane = plane;
                block_sync();
                plane = shown_plane;
            }
#endif
        const Appearances& look = plane_look<CACHED>(looks, scene, plane);
        unsigned long long atlas = 0;
        if constexpr (Wants::USE_ATLAS)
            atlas = look.layout.atlas;
        else if constexpr (Wants::TEXTURED && IN_STRIPS)
            atlas = atlas_of(scene.textures, look.material.color.w);
        unsigned long long image = atlas;  // that of strips
        if constexpr (MIPS)
            if (thread == 0 && atlas)
                image = wp::index(scene.textures.mips, look.material.color.w);
        if (thread < WARP_OR_ONE) {
            if constexpr (CORNERS > 0)
                choose_corners<LENS>(list.grid, list, look, camera, region, frame, plane, atlas, FLAGS & MIRROR_VIEW,
                                     thread);
            else
                see_floor(list.grid, look, camera, plane, atlas, thread);
        }
#if defined(__CUDA_ARCH__)
        if constexpr (IN_STRIPS)
            if (thread == 0)
                plan_strips(plan, list.grid, camera, image, exposed<FLAGS>(scene, world, { 1.0f, 1.0f, 1.0f }));
#endif
        block_sync();
        if constexpr (CORNERS > 0) {
#if defined(__CUDA_ARCH__)
            light_corners<!RADIANT>(list.grid, list, look, thread);
#else
            light_all_corners(list.grid, list, look);
#endif
            block_sync();
        }
    }
    Pixel pixel;
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED float4 lanes[THREADS / WARP_SIZE][3 * WARP_SIZE / 4];
    constexpr unsigned TILES = WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT), STEP = THREADS / WARP_SIZE;
    const unsigned warp = unsigned(thread) / WARP_SIZE;
    pixel.lane = unsigned(thread) % WARP_SIZE;
    pixel.row_of_lanes = reinterpret_cast<float*>(lanes[warp]);
    if constexpr (IN_STRIPS) {
        // Reuses the memory of the vertices, which are no longer needed, if it has room.
        unsigned short* rest = pixels_left;
        if constexpr (ROOMY)
            rest = reinterpret_cast<unsigned short*>(list.grid.values);
        draw_by_strips<Wants::TEXTURED, MIPS, (FLAGS & WHOLE_REGIONS) != 0, IMAGES, WIDTH, HEIGHT>(
            plan, rest, list.grid, covered, frame, scene.images, region, first, warp, pixel, [&](const Pixel& one) {
                resolve_pixel<Types, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene, shared_camera,
                                                                    transparent_shapes, region, world, one,
                                                                    find<Types, IMAGES, FLAGS>(frame, one));
            });
        return;
    }
    seek_tile<WIDTH, FLAGS>(pixel, frame, first, left, top, warp);
    PixelHit next = find<Types, IMAGES, FLAGS>(frame, pixel);
#pragma unroll 1
    for (unsigned tile = warp; tile < TILES; tile += STEP) {
        const PixelHit found = next;
        if (tile + STEP < TILES) {  // ask for the next tile's pixels before this one's are drawn
            seek_tile<WIDTH, FLAGS>(pixel, frame, first, left, top, tile + STEP);
            next = find<Types, IMAGES, FLAGS>(frame, pixel);
        }
        seek_tile<WIDTH, FLAGS>(pixel, frame, first, left, top, tile);
        if ((FLAGS & WHOLE_REGIONS) || (pixel.width > 0 && pixel.height > 0)) {
            if constexpr (has_table(LENS))
                resolve_pixel<Types, LENS, HELD, IMAGES, OWN_FACTS>(
                    looks, list, scene, camera_at<LENS>(shared_camera, pixel.column, pixel.row), transparent_shapes,
                    region, world, pixel, found);
            else
                resolve_pixel<Types, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene, shared_camera,
                                                                    transparent_shapes, region, world, pixel, found);
        }
    }
#else
    pixel.inside = true;
    const auto own_camera = [&](const Pixel& one) -> decltype(auto) {
        if constexpr (has_table(LENS))
            return camera_at<LENS>(camera, one.column, one.row);
        else
            return (camera);
    };
    const auto make_look = [&](int id) {
        if constexpr (CACHED > 0)
            if (const int place = wp::index(scene.shapes.places, id); !made[place]) {
                looks[place] = load_appearance_for<Types, Wants>(scene, camera, world, id);
                made[place] = true;
            }
    };
    if constexpr (Wants::SURFACE) {
        constexpr bool APART = (FLAGS & (MIRROR_VIEW | HAS_MIRROR | HAS_TRANSPARENT | HAS_HAZE | HAS_REFLECTIONS)) != 0;
        constexpr int ROWS = min(HEIGHT, 4096 / WIDTH);
        Sorted<ROWS * WIDTH> sorted;
        ShadedRows<ROWS * WIDTH, IMAGES, APART> shaded;
        const int width = min(WIDTH, frame.width - left), bottom = min(top + HEIGHT, frame.height);
        RayRows<LENS, WIDTH, ROWS> ray_rows(camera, left, width, FLAGS & MIRROR_VIEW, frame.width);
        const auto look_at = [&](int id) -> decltype(auto) {
            make_look(id);
            if constexpr (CACHED > 0)
                return (looks[wp::index(scene.shapes.places, id)]);
            else
                return cached_appearance<Types, HELD, Wants>(looks, list, scene, camera, world, id);
        };
        for (int start = top; start < bottom; start += ROWS) {
            const int rows = min(ROWS, bottom - start);
            const size_t corner = first + size_t(start) * frame.width + left;
            ray_rows.seek_tile(start, rows);
            sorted.template sort<WIDTH>(frame.shape, corner, frame.width, width, rows);
            shade_sorted<Types, LENS, IMAGES, FLAGS, WIDTH, ROWS * WIDTH, !APART>(sorted, list, scene, ray_rows, world,
                                                                                  corner, look_at, shaded);
            for (int row = 0; row < rows; ++row) {
                const size_t at = corner + size_t(row) * frame.width;
                if constexpr (!APART)
                    shaded.write(scene.images, frame.shape, at, row * WIDTH, width);
                else
                    for (int column = 0; column < width; ++column) {
                        pixel = { left + column, start + row, unsigned(at) + column, true };
                        resolve_pixel<Types, LENS, HELD, IMAGES, FLAGS>(
                            looks, list, scene, own_camera(pixel), transparent_shapes, region, world, pixel,
                            find<Types, IMAGES, FLAGS>(frame, pixel), shaded.shown(row * WIDTH + column));
                    }
            }
        }
    } else {
        for (pixel.row = top; pixel.row < min(top + HEIGHT, frame.height); ++pixel.row)
            for (pixel.column = left; pixel.column < min(left + WIDTH, frame.width); ++pixel.column) {
                pixel.at = first + pixel.row * frame.width + pixel.column;
                const PixelHit found = find<Types, IMAGES, FLAGS>(frame, pixel);
                if (found.shape >= 0)
                    make_look(found.shape);
                resolve_pixel<Types, LENS, HELD, IMAGES, FLAGS>(looks, list, scene, own_camera(pixel),
                                                                transparent_shapes, region, world, pixel, found);
            }
    }
#endif
}

}  // namespace warpcam
