// An environment's image as a light that paths draw: its texels, as often as they are bright.
#pragma once
#include "shading/environment_map.h"

namespace warpcam {

struct EnvironmentCells {
    Environment environment;
    const float* sums;  // of the rows' shares from 0 to 1, one more than rows, and of each row's texels likewise

    WARPCAM_DEVICE int width() const { return environment.layout[ENVIRONMENT_WIDTH]; }
    WARPCAM_DEVICE int height() const { return environment.layout[ENVIRONMENT_HEIGHT]; }
    WARPCAM_DEVICE bool shines() const { return environment.layout; }
    WARPCAM_DEVICE const float* row_sums(int row) const { return sums + height() + 1 + row * (width() + 1); }

    // The cell of `count` that `choice` falls into, and how far on.
    WARPCAM_DEVICE static int find(const float* sums, int count, float choice, float& on)
    {
        int first = 0, end = count;
        while (end - first > 1) {
            const int middle = (first + end) >> 1;
            const bool below = choice < sums[middle];
            first = below ? first : middle;
            end = below ? middle : end;
        }
        on = saturate((choice - sums[first]) / max(sums[first + 1] - sums[first], MIN_NORMAL));
        return first;
    }

    // A direction in the world.
    WARPCAM_DEVICE Vec3 draw(float, float u, float v) const
    {
        float down, right;
        const int row = find(sums, height(), u, down), column = find(row_sums(row), width(), v, right);
        const float longitude = 2.0f * PI * (0.5f - (float(column) + right) / float(width()));
        const float latitude = PI * (0.5f - (float(row) + down) / float(height())), flat = wp::cos(latitude);
        return environment.world({ flat * wp::cos(longitude), flat * wp::sin(longitude), wp::sin(latitude) });
    }

    // The density with which it is drawn [1/sr].
    WARPCAM_DEVICE float density(Vec3 direction) const
    {
        const Vec3 d = environment.local(direction);
        const Float2 place = panorama_place(d);
        const int column = clamp(int(place.x * float(width())), 0, width() - 1);
        const int row = clamp(int(place.y * float(height())), 0, height() - 1);
        const float* const texels = row_sums(row);
        const float share = (sums[row + 1] - sums[row]) * (texels[column + 1] - texels[column]);
        const float sine = wp::sqrt((d.x * d.x + d.y * d.y) / max(dot(d, d), MIN_NORMAL));
        return share * float(width()) * float(height()) / (2.0f * PI * PI * max(sine, 1.0e-6f));
    }
};

template <class Maps> WARPCAM_DEVICE EnvironmentCells environment_cells(const Maps& maps, int world)
{
    const Environment environment = load_environment(maps, world);
    return { environment, environment.layout ? maps.sums.data + environment.layout[ENVIRONMENT_SUMS] : nullptr };
}

}  // namespace warpcam
