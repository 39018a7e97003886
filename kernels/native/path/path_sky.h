// Light from all around, as a path meets it that leaves the scene.
#pragma once
#include "shading/environment.h"
#include "path/environment_cells.h"

namespace warpcam {

// The sky's image where it has one, else its terms, with the light that is everywhere. `direction`: in the world.
template <bool IMAGE, class Physical, class Textures, class Background>
WARPCAM_DEVICE Vec3 path_sky(const Physical& physical, const Textures& textures, const Background& background,
                             int world, int headlight, Vec3 d)
{
    const auto term = [&](int n) { return as_vec3(per_world(physical.sky, world, n)); };
    const Vec3 even = as_vec3(wp::index(physical.plain.headlight, headlight));
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        const Vec3 gain = term(SKY_TERMS);
        if (image.levels > 0 && dot(gain, gain) > 0.0f) {
            const Vec3 none { 0.0f, 0.0f, 0.0f };
            return even + mul(gain, srgb_to_linear(sky_image(textures, image, { d.x, d.z, -d.y }, none, none)));
        }
    }
    const Vec3 sum = even + term(0) + d.x * term(1) + d.y * term(2) + d.z * term(3) + (d.x * d.y) * term(4)
                     + (d.y * d.z) * term(5) + (3.0f * d.z * d.z - 1.0f) * term(6) + (d.x * d.z) * term(7)
                     + (d.x * d.x - d.y * d.y) * term(8);
    return { max(sum.x, 0.0f), max(sum.y, 0.0f), max(sum.z, 0.0f) };
}

// Cells of the sky's image, faces of a cube of `side` cells, drawn as often as they are bright.
struct SkyCells {
    const float* sums;  // (6 * side^2 + 1,) of their shares, from 0 to 1
    int side;           // 0: the sky is not drawn

    WARPCAM_DEVICE bool shines() const { return side > 0; }

    // A direction in the world.
    WARPCAM_DEVICE Vec3 draw(float choice, float u, float v) const
    {
        int first = 0, end = 6 * side * side;
        while (end - first > 1) {
            const int middle = (first + end) >> 1;
            const bool below = choice < sums[middle];
            first = below ? first : middle;
            end = below ? middle : end;
        }
        const int row = first / side, column = first - row * side, face = row / side;
        const float rate = 2.0f / float(side);
        const float s = (float(column) + u) * rate - 1.0f, t = (float(row - face * side) + v) * rate - 1.0f;
        const Vec3 place = from_face(face, { s, t, 1.0f });
        return normalized(Vec3 { place.x, -place.z, place.y });
    }

    // The density with which it is drawn [1/sr].
    WARPCAM_DEVICE float density(Vec3 d) const
    {
        const Vec3 direction { d.x, d.z, -d.y };
        const int face = cube_face(direction);
        const Vec3 place = to_face(face, direction);
        const float rate = 1.0f / place.z, half = 0.5f * float(side), length = rate * wp::sqrt(dot(d, d));
        const int column = clamp(int((place.x * rate + 1.0f) * half), 0, side - 1);
        const int row = clamp(int((place.y * rate + 1.0f) * half), 0, side - 1);
        const int cell = (face * side + row) * side + column;
        return (sums[cell + 1] - sums[cell]) * half * half * length * length * length;
    }
};

}  // namespace warpcam
