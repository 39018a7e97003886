// A plane as one view sees it: its axes, and its texture.
#pragma once
#include "output/hit_attributes.h"
#include "shading/appearance.h"
#include "texture/sampler.h"

namespace warpcam {

constexpr int MAX_LEVELS = 16;

// A plane as one view sees it: what its pixels need beside light.
struct FloorView {
    Float3Int axis_x, axis_y, axis_z;  // as in Pose
    Float3Int place;                   // on the texture: u is x * local.x + z, v is y * local.y + w (a float's bits)
    // Steps on the texture from pixel to pixel, to the right and down, at depth 1 [texels]: for a ray of direction r,
    // that of u is x - y * r.x / r.z, that of v z - w * r.y / r.z (w: a float's bits).
    Float3Int right, down;
    // Mip levels of the texture: width, height and start (bits of floats); w: start of the next. With a mip atlas all
    // are floats, the last two the level's left and top there.
    Float3Int levels[MAX_LEVELS + 1];  // in an atlas the last of them twice
    unsigned long long atlas;  // see Textures.atlases; 0: none
    int count;  // of levels
    int plain;  // 1: it has a texture of one image, or none
};

// Lists the levels of the texture; a team calls it. `atlas`: see Textures.atlases; 0: none.
template <class Appearances>
WARPCAM_DEVICE void list_levels(FloorView& view, const Appearances& look, unsigned long long atlas, int lane)
{
    if constexpr (Appearances::TEXTURED) {
        const Image& image = look.layout.image;
        if (lane == 0)
            view.atlas = atlas;
        for (int i = lane; i < min(image.levels, MAX_LEVELS) + 1; i += WARP_OR_ONE) {
            const Level level = Level { image.start, image.width, image.height }.after(i, 1);
            if (atlas) {
                view.levels[i] = level_in_atlas(image, min(i, image.levels - 1));
                continue;
            }
            view.levels[i] = { as_float(level.width), as_float(level.height), as_float(level.start),
                               level.next(1).start };
        }
    }
}

template <class Appearances>
WARPCAM_DEVICE void view_floor(FloorView& view, const Appearances& look, const Camera& camera)
{
    const ShapeFromCamera& pose = look.pose;
    view.axis_x = pose.axis_x;
    view.axis_y = pose.axis_y;
    view.axis_z = pose.axis_z;
    view.count = 0;
    view.plain = 1;
    if constexpr (Appearances::TEXTURED) {
        const TextureLayout& layout = look.layout;
        const float rate_u = layout.repeat[0], rate_v = layout.repeat[1];
        const float u = rate_u * float(layout.image.width), v = rate_v * float(layout.image.height);
        const float a = camera.scale_x, b = -camera.scale_y;
        float start_u = layout.start[0], start_v = layout.start[1];
        shift(look, start_u, start_v);
        view.place = { rate_u, rate_v, start_u, as_int(start_v) };
        view.right = { a * u * pose.axis_x.x, a * u * pose.axis_z.x, a * v * pose.axis_y.x,
                       as_int(a * v * pose.axis_z.x) };
        view.down = { b * u * pose.axis_x.y, b * u * pose.axis_z.y, b * v * pose.axis_y.y,
                      as_int(b * v * pose.axis_z.y) };
        view.count = layout.image.levels;
        view.plain = !(layout.image.levels > 0 && layout.cube) && layout.image.levels <= MAX_LEVELS;
    }
}

}  // namespace warpcam
