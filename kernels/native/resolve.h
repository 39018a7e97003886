// From the visibility buffer to images: a block draws one region of one view.
#pragma once
#include "floor_strips.h"
#include "haze.h"
#include "kept_looks.h"
#include "peel.h"
#include "reflected.h"
#include "veils.h"
#if !defined(__CUDA_ARCH__)
#include "resolve_cpu.h"
#endif

namespace warpcam {

// What the trace and the shadow pass found at a pixel.
struct Seen : Hit {
    int shadow;  // where FACTS have SPARE; otherwise it is asked for when the pixel is drawn
};

template <int TYPES, int IMAGES, int FACTS, class Frame_> WARPCAM_FN Seen find(const Frame_& frame, const Pixel& pixel)
{
    Seen found { { 0.0f, -1, 0 }, 0 };
    if (pixel.inside) {
        found.shape = frame.shape.data[pixel.at];
        if (Wanted<IMAGES, FACTS>::SURFACE)
            found.depth = frame.depth.data[pixel.at];
        if (Wanted<IMAGES, FACTS>::SURFACE && (TYPES & (1 << MESH | 1 << HEIGHT_FIELD)))
            found.face = frame.face.data[pixel.at];
        if (Wanted<IMAGES, FACTS>::LIT && (FACTS & HAS_SHADOWS) && (FACTS & SPARE))
            found.shadow = frame.shadow.data[pixel.at];
    }
    return found;
}

// CAPACITY: the looks a block keeps, one for each shape that may be visible; 0 if they are made anew for each pixel, less
// if `looks` are SeenLooks.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_>
WARPCAM_FN void resolve_hit(const Looks* looks, const List& lights, const Scene_& scene, const Camera& camera,
                            int world, float x, float y, const Hit& found, int shadow, Shown& shown)
{
    using Wants = Wanted<IMAGES, FACTS>;
    if constexpr (CAPACITY > 0)
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(looks[scene.shapes.places.data[found.shape]], lights, scene,
                                                    camera, x, y, found, shadow, shown);
    else
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(
            kept_look<TYPES, CAPACITY, Wants>(looks, lights, scene, camera, world, found.shape), lights, scene, camera, x,
            y, found, shadow, shown);
    if constexpr (Wants::LIT)
        expose<FACTS>(scene, world, shown.linear, shown.display);
}

// Covers what is seen of a pixel with the transparent shapes before it. Returns how much is still seen of it.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_,
          class Veils_>
WARPCAM_FN float resolve_veils(const Looks* looks, const List& lights, const Scene_& scene, const Camera& camera,
                               const Veils_& veils, const Region& region, int world, const Pixel& pixel, float x,
                               float y, const Hit& solid, Shown& shown)
{
    const float limit = solid.shape >= 0 ? solid.depth : camera.far;
    const bool takes_part = pixel.inside && !((FACTS & MIRRORED) && solid.shape == -1);
    const ViewRay<LENS> ray { x, y };
    float near = camera.near;
    int column = (pixel.column - region.left) / TILE_WIDTH;
    const int row = (pixel.row - region.top) / TILE_HEIGHT;
    if constexpr ((FACTS & MIRRORED) != 0) {
        near = plane_of(wp::index(scene.frame.mirrors, world)).depth(ray);
        column = region.width / TILE_WIDTH - 1 - column;
    }
    if constexpr ((FACTS & PHYSICAL) != 0) {
        const auto paint = [&](bool met, Hit hit, Vec& light) {
            Shown sheet;
            follow(met, hit);
            resolve_hit<TYPES, LENS, CAPACITY, IMAGES & (RGB | RGBA | HDR), FACTS & ~HAS_SHADOWS>(
                looks, lights, scene, camera, world, x, y, hit, 0, sheet);
            light = sheet.linear;
            float alpha = opacity(scene.shapes, scene.materials, world, hit.shape);
            if constexpr ((TYPES >> MASKED & 1) && (FACTS & HAS_MAPS))
                alpha *= mapped_opacity<TYPES, LENS>(
                    kept_look<TYPES, CAPACITY, Wanted<IMAGES, FACTS>>(looks, lights, scene, camera, world, hit.shape), scene,
                    camera, world, x, y, hit);
            return alpha;
        };
        Peeled peeled { { 0.0f, 0.0f, 0.0f }, 1.0f };
        peel<TYPES>(veils, scene, ray, near, takes_part ? limit : -1.0f, column, row, paint, peeled);
        if (peeled.left < 1.0f) {
            shown.linear = peeled.light + peeled.left * shown.linear;
            shown.display = encoded(shown.linear);
        }
        return peeled.left;
    } else {
        Covered covered(shown.linear, clip(shown.display));
        const auto shade = [&](bool met, Hit hit, Vec& linear, Vec& display) {
            Shown sheet;
            follow(met, hit);
            resolve_hit<TYPES, LENS, CAPACITY, IMAGES & (RGB | RGBA | HDR), FACTS & ~HAS_SHADOWS>(looks, lights, scene, camera, world, x,
                                                                                 y, hit, 0, sheet);
            linear = sheet.linear;
            display = sheet.display;
        };
        Hit first { limit, -1, -1 };
        const auto note = [&](const Hit& hit, float opacity) {
            if constexpr ((FACTS & NOTED) != 0)
                if (opacity >= NOTEWORTHY && hit.depth < first.depth && wp::index(scene.shapes.types, hit.shape) != PLANE)
                    first = hit;
        };
        cover<TYPES>(veils, scene, ray, near, takes_part ? limit : -1.0f, column, row, shade, note, covered);
        if constexpr ((FACTS & NOTED) != 0)
            if (first.shape >= 0) {
                scene.frame.shape.data[pixel.at] = first.shape;
                scene.frame.depth.data[pixel.at] = first.depth;
                if constexpr ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0)
                    scene.frame.face.data[pixel.at] = first.face;
            }
        shown.linear = covered.final_linear();
        shown.display = covered.final_display();
        return covered.left * covered.left;
    }
}

// `painted`: what the pixel shows, a Shown, where that is known.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class List, class Scene_,
          class Veils_, class Camera_, class... Painted_>
WARPCAM_FN void resolve_pixel(const Looks* looks, const List& lights, const Scene_& scene, const Camera_& camera,
                              const Veils_& veils, const Region& region, int world, const Pixel& pixel, Seen found,
                              const Painted_&... painted)
{
    constexpr bool IS_PAINTED = sizeof...(Painted_) > 0;
    using Wants = Wanted<IMAGES, FACTS>;
    constexpr bool IN_QUADS = FACTS & QUADS;
    const auto& frame = scene.frame;
    const auto& images = scene.images;
    const int column = FACTS & MIRRORED ? frame.width - 1 - pixel.column : pixel.column;
    const float x = ray_x<LENS>(camera, column), y = ray_y<LENS>(camera, pixel.row);
    const bool hit = found.shape >= 0;
    const Hit solid = found;
    const auto shadow = [&] {
        if constexpr (!Wants::LIT || !(FACTS & HAS_SHADOWS))
            return 0;
        else if constexpr ((FACTS & SPARE) != 0)
            return found.shadow;
        else
            return hit ? int(frame.shadow.data[pixel.at]) : 0;
    };
    Shown shown;
    bool drawn = false;
    Vec apart;
    Vec& floor = FACTS & SPARE ? apart : shown.display;
    if constexpr (!IS_PAINTED && lit_by_corners<List>(FACTS & HAS_SHADOWS) && !(IMAGES & (NORMALS | ALBEDO)))
        drawn = draw_floor<Wants::TEXTURED, (FACTS & SPARE) != 0, (FACTS & (SPARE | STRIPS)) != 0>(lights.grid, scene.textures, found, shadow, x, y, floor);
    if constexpr (IS_PAINTED)
        shown = (painted, ...);
    else if (((FACTS & SPARE) || !drawn) && (Wants::SURFACE || Wants::COLORED) && follow(hit && !drawn, found))
        resolve_hit<TYPES, LENS, CAPACITY, IMAGES, FACTS>(looks, lights, scene, camera, world, x, y, found, shadow(), shown);
    if (drawn) {
        shown.linear = shown.display = floor;
        expose<FACTS>(scene, world, shown.linear, shown.display);
    }
    const Vec black { 0.0f, 0.0f, 0.0f };
    if (IMAGES & NORMALS)
        put_vec<IN_QUADS>(images.normals, pixel, hit ? shown.normal : black);
    if (IMAGES & ALBEDO)
        put_bytes<IN_QUADS>(images.albedo, pixel, hit ? to_bytes(shown.albedo) : 0u);
    if (Wants::LIT) {
        bool seen = hit;
        Mist mist { 0.0f, 0.0f };
        if constexpr ((FACTS & HAZY) != 0 && LENS != ORTHOGRAPHIC) {
            const Vec ray = turned(camera.rotation, ViewRay<LENS> { x, y }.direction());
            seen = hit && solid.depth < skybox_depth(ray, frame.haze.radius);
            mist = haze_of(scene, camera, world, ray);
        }
        if (!seen) {
            shown.linear = shown.display = FACTS & MIRRORED
                ? black
                : background_color<LENS, FACTS>(scene.textures, background_of<FACTS>(scene, world), camera, x, y);
            if constexpr (Wants::COATED) {
                shown.linear = decoded(shown.linear);
                if constexpr ((FACTS & HAS_SKYBOX) != 0) {
                    shown.linear = times(lights.sky.gain, shown.linear);
                    shown.display = encoded(shown.linear);
                }
            }
            expose<FACTS>(scene, world, shown.linear, shown.display);
        }
        if constexpr ((FACTS & REFLECTS) != 0)
            if (seen && solid.shape == wp::index(frame.mirrors, world).shape)
                add_mirrored<IMAGES>(images, pixel.at, shown.linear, shown.display);
        if constexpr ((FACTS & HAZY) != 0)
            if (mist.density > 0.0f && !(seen && solid.depth < mist.depth)) {
                const Vec haze = exposed<FACTS>(scene, world, mist.density * to_vec(frame.haze.color));
                shown.linear = (1.0f - mist.density) * shown.linear + haze;
                shown.display = (1.0f - mist.density) * clip(shown.display) + haze;
            }
        unsigned alpha = hit ? 0xff000000u : 0u;
        if constexpr ((FACTS & VEILED) != 0) {
            const float left = resolve_veils<TYPES, LENS, CAPACITY, IMAGES, FACTS>(looks, lights, scene, camera, veils,
                                                                                   region, world, pixel, x, y, solid,
                                                                                   shown);
            alpha = hit ? alpha : to_byte(1.0f - left) << 24;
        }
        const unsigned word = to_bytes(shown.display);
        if (IMAGES & HDR)
            put_vec<IN_QUADS>(images.hdr, pixel, shown.linear);
        if (IMAGES & RGB)
            put_bytes<IN_QUADS>(images.rgb, pixel, word);
        if (IMAGES & RGBA)
            put_word(images.rgba, pixel, word | alpha);
    }
}

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
// VEILS: how many shapes may be transparent.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, int IMAGES, int FACTS, int VEILS = 0, class Scene_,
          class Lights>
WARPCAM_FN void resolve(const Scene_& scene, const Lights& lights, int index)
{
    using Wants = Wanted<IMAGES, FACTS>;
    using Looks = Look<TYPES, Wants>;
    using Sheets = typename Kept<VEILS != 0, Veils<VEILS != 0 ? VEILS : 1>>::type;
    constexpr int ROOM = 44032 - (VEILS != 0 ? int(sizeof(Sheets)) : 0);
    constexpr int KEPT = CAPACITY * int(sizeof(Looks)) <= ROOM && (Wants::SURFACE || Wants::COLORED) ? CAPACITY : 0;
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS;
    constexpr int CORNERS = Wants::FACETED && (TYPES >> PLANE & 1) && LENS == PINHOLE && !(IMAGES & HDR)
        ? corner_room(WIDTH * HEIGHT, (ROOM < CORNERED ? ROOM : CORNERED) - KEPT * int(sizeof(Looks)) - 1024)
        : 0;
    // Where not all looks can be kept, some are.
    constexpr bool SOME = KEPT == 0 && (CAPACITY > 0 || CORNERS > 0) && (Wants::SURFACE || Wants::COLORED);
    constexpr int PLACES = CAPACITY > 0 ? CAPACITY : 1, BARE = sizeof(Look<TYPES, Bare<Wants>>);
    constexpr int LEFT = (ROOM - 2048 - CORNERS * int(sizeof(float)) - 2 * PLACES) / BARE;
    constexpr int SEEN = CAPACITY > 0 && LEFT > 1 ? (LEFT < CAPACITY ? LEFT : CAPACITY) : 1;
    using Held = typename Either<SOME, SeenLooks<TYPES, Wants, PLACES, SEEN>, Looks>::type;
    constexpr int HELD = SOME ? -1 : KEPT;
    WARPCAM_SHARED Held looks[KEPT > 0 ? KEPT : 1];
    using Lit_ = typename Either<(CORNERS > 0), LitCorners<CORNERS, SHADOWS>, LightList>::type;
    WARPCAM_SHARED typename Either<(FACTS & PHYSICAL) != 0, LampList, Lit_>::type list;
#if defined(__CUDA_ARCH__)
    constexpr int NEEDED = STRIPS | QUADS | WHOLE_REGIONS, BARRED = MIRRORED | REFLECTS | VEILED | HAZY | EXPOSED;
    constexpr bool IN_STRIPS = IMAGES == RGB && (FACTS & (NEEDED | BARRED)) == NEEDED && KEPT > 0
        && lit_by_corners<Lit_>(SHADOWS) && Strips<WIDTH, HEIGHT>::FIT;
    constexpr int OWN_FACTS = IN_STRIPS ? FACTS & ~QUADS : FACTS & ~STRIPS;
    constexpr bool ROOMY = CORNERS * sizeof(float) >= WIDTH * HEIGHT * sizeof(short);
    WARPCAM_SHARED typename Kept<IN_STRIPS, StripPlan>::type plan;
    WARPCAM_SHARED unsigned short pixels_left[IN_STRIPS && !ROOMY ? WIDTH * HEIGHT : 1];
#else
    constexpr bool IN_STRIPS = false;
    constexpr int OWN_FACTS = FACTS;
#endif
    WARPCAM_SHARED Camera kept_camera;
    WARPCAM_SHARED Sheets veils;
    const auto& frame = scene.frame;
    const int thread = index % THREADS;
    int world;
    const Region region = region_of<WIDTH, HEIGHT, (TYPES >> MIDDLE_FIRST & 1) != 0>(frame, index / THREADS, world);
    if (!wp::index(frame.mask, world))
        return;
    const int left = region.left, top = region.top;
    const unsigned first = unsigned(world) * frame.width * frame.height;
    const Camera camera = load_camera(wp::index(frame.views, world));
    if (thread == 0)
        kept_camera = camera;
    if (Wants::LIT && thread >= THREADS - TEAM)
        gather_lights<SHADOWS>(lights, camera, world, headlight_of<FACTS>(world), thread - (THREADS - TEAM), list);
    if constexpr ((FACTS & MIRRORED) != 0) {
        const auto mirror = wp::index(frame.mirrors, world);
        if (mirror.shape < 0)
            return;
        if (thread == THREADS - TEAM && headlight_shines(lights))
            list.lights[0].place = to_row(to_vec(mirror.headlight), 0);
    }
    if constexpr (VEILS != 0) {
        Region seen = region;
        Vec eye = camera.origin;
        int mirror = -1;
        if constexpr ((FACTS & MIRRORED) != 0) {  // its columns run the other way
            const auto at = wp::index(frame.mirrors, world);
            seen.left = frame.width - region.left - region.width;
            eye = to_vec(at.eye);
            mirror = at.shape;
        }
        gather_veils<TYPES, LENS, (FACTS & PHYSICAL) == 0>(veils, scene, camera, seen, eye, mirror, world, thread);
    }
#if defined(__CUDA_ARCH__)
    if constexpr (KEPT > 0)
        for (int i = thread; i < scene.shapes.drawn.shape[0]; i += THREADS) {
            const int id = wp::index(scene.shapes.drawn, i);
            looks[i] = look_of<TYPES, Wants>(scene, camera, world, id);
        }
    if constexpr (SOME) {
        if (thread == 0 && frame.plane >= 0)
            looks->plane = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
        if constexpr (Held::MARKED)
            gather_looks<WIDTH, HEIGHT, FACTS, SEEN>(*looks, scene, camera, world, first, left, top, thread);
    }
    block_barrier();
#else
    bool made[KEPT > 0 ? KEPT : 1] = {};
    if constexpr (VEILS != 0 && KEPT > 0)
        for (int slot = 0; slot < veils.count; ++slot) {
            const int place = wp::index(scene.shapes.places, veils.ids[slot]);
            looks[place] = look_of<TYPES, Wants>(scene, camera, world, veils.ids[slot]);
            made[place] = true;
        }
    if constexpr (CORNERS > 0 && KEPT > 0)
        if (frame.plane >= 0) {
            const int place = wp::index(scene.shapes.places, frame.plane);
            looks[place] = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
            made[place] = true;
        }
    if constexpr (SOME)
        if (frame.plane >= 0)
            looks->plane = look_of<TYPES, Wants>(scene, camera, world, frame.plane);
#endif
    if constexpr (CORNERS > 0) {
        const Looks& look = plane_look<KEPT>(looks, scene);
        unsigned long long sheet = 0;
        if constexpr (Wants::ON_SHEETS)
            sheet = look.layout.sheet;
        else if constexpr (Wants::TEXTURED && IN_STRIPS)
            sheet = sheet_of(scene.textures, look.finish.color.w);
        if (thread < TEAM)
            choose_corners(list.grid, list, look, camera, region, frame, sheet, FACTS & MIRRORED, thread);
#if defined(__CUDA_ARCH__)
        if constexpr (IN_STRIPS)
            if (thread == 0)
                plan_strips(plan, list.grid, camera);
#endif
        block_barrier();
#if defined(__CUDA_ARCH__)
        light_corners(list.grid, list, look, thread);
#else
        light_all_corners(list.grid, list, look);
#endif
        block_barrier();
    }
    Pixel pixel;
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED float4 lanes[THREADS / LANES][3 * LANES / 4];
    constexpr unsigned TILES = WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT), STEP = THREADS / LANES;
    const unsigned warp = unsigned(thread) / LANES;
    pixel.lane = unsigned(thread) % LANES;
    pixel.row_of_lanes = reinterpret_cast<float*>(lanes[warp]);
    if constexpr (IN_STRIPS) {
        // Where there is room they lie among the corners, which are not needed any more.
        unsigned short* rest = ROOMY ? reinterpret_cast<unsigned short*>(list.grid.values) : pixels_left;
        draw_by_strips<Wants::TEXTURED, WIDTH, HEIGHT>(
            plan, rest, list.grid, frame, scene.images.rgb, region, first, warp, pixel, [&](const Pixel& one) {
                resolve_pixel<TYPES, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene, kept_camera, veils, region, world,
                                                                             one, find<TYPES, IMAGES, FACTS>(frame, one));
            });
        return;
    }
    go_to<WIDTH, FACTS>(pixel, frame, first, left, top, warp);
    Seen next = find<TYPES, IMAGES, FACTS>(frame, pixel);
#pragma unroll 1
    for (unsigned tile = warp; tile < TILES; tile += STEP) {
        const Seen found = next;
        if (tile + STEP < TILES) {  // ask for the next tile's pixels before this one's are drawn
            go_to<WIDTH, FACTS>(pixel, frame, first, left, top, tile + STEP);
            next = find<TYPES, IMAGES, FACTS>(frame, pixel);
        }
        go_to<WIDTH, FACTS>(pixel, frame, first, left, top, tile);
        if ((FACTS & WHOLE_REGIONS) || (pixel.width > 0 && pixel.height > 0)) {
            if constexpr (LENS == RAYS)
                resolve_pixel<TYPES, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene,
                    camera_at(kept_camera, pixel.column, pixel.row), veils, region, world, pixel, found);
            else
                resolve_pixel<TYPES, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene, kept_camera, veils, region, world, pixel, found);
        }
    }
#else
    pixel.inside = true;
    const auto make_look = [&](int id) {
        if constexpr (KEPT > 0)
            if (const int place = wp::index(scene.shapes.places, id); !made[place]) {
                looks[place] = look_of<TYPES, Wants>(scene, camera, world, id);
                made[place] = true;
            }
    };
    if constexpr (LENS == PINHOLE && Wants::SURFACE && !(FACTS & PHYSICAL)) {
        constexpr bool APART = (FACTS & (MIRRORED | REFLECTS | VEILED | HAZY)) != 0;
        constexpr int ROWS = lower_int(HEIGHT, 1024 / WIDTH);
        Sorted<ROWS * WIDTH> sorted;
        Painted<ROWS * WIDTH, IMAGES, APART> painted;
        const int width = lower_int(WIDTH, frame.width - left), bottom = lower_int(top + HEIGHT, frame.height);
        float x[WIDTH], y[ROWS];
        for (int column = 0; column < width; ++column)
            x[column] = image_x(camera, float(FACTS & MIRRORED ? frame.width - 1 - left - column : left + column));
        const auto look_at = [&](int id) -> decltype(auto) {
            make_look(id);
            if constexpr (KEPT > 0)
                return (looks[wp::index(scene.shapes.places, id)]);
            else
                return kept_look<TYPES, HELD, Wants>(looks, list, scene, camera, world, id);
        };
        for (int start = top; start < bottom; start += ROWS) {
            const int rows = lower_int(ROWS, bottom - start);
            const size_t corner = first + size_t(start) * frame.width + left;
            for (int row = 0; row < rows; ++row)
                y[row] = image_y(camera, float(start + row));
            sorted.template sort<WIDTH>(frame.shape, corner, frame.width, width, rows);
            paint_sorted<TYPES, IMAGES, FACTS, WIDTH, ROWS * WIDTH, !APART>(sorted, list, scene, camera, world, corner, x, y,
                                                                           look_at, painted);
            for (int row = 0; row < rows; ++row) {
                const size_t at = corner + size_t(row) * frame.width;
                if constexpr (!APART)
                    painted.write(scene.images, frame.shape, at, row * WIDTH, width);
                else
                    for (int column = 0; column < width; ++column) {
                        pixel = { left + column, start + row, unsigned(at) + column, true };
                        resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene, kept_camera, veils, region,
                                                                        world, pixel, find<TYPES, IMAGES, FACTS>(frame, pixel),
                                                                        painted.shown(row * WIDTH + column));
                    }
            }
        }
    } else {
        for (pixel.row = top; pixel.row < lower_int(top + HEIGHT, frame.height); ++pixel.row)
            for (pixel.column = left; pixel.column < lower_int(left + WIDTH, frame.width); ++pixel.column) {
                pixel.at = first + pixel.row * frame.width + pixel.column;
                const Seen found = find<TYPES, IMAGES, FACTS>(frame, pixel);
                if (found.shape >= 0)
                    make_look(found.shape);
                if constexpr (LENS == RAYS)
                    resolve_pixel<TYPES, LENS, HELD, IMAGES, FACTS>(looks, list, scene,
                        camera_at(kept_camera, pixel.column, pixel.row), veils, region, world, pixel, found);
                else
                    resolve_pixel<TYPES, LENS, HELD, IMAGES, OWN_FACTS>(looks, list, scene, kept_camera, veils, region, world, pixel, found);
            }
    }
#endif
}

}  // namespace warpcam
