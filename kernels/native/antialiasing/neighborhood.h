// The nine pixels around one, and their order from near to far of a sample.
#pragma once
#include "antialiasing/edge_test.h"

namespace warpcam {

// A pixel around one, or that itself: 4 * row + column, from the one above and to the left.
struct Neighborhood3x3 {
    static constexpr int MIDDLE = 5;

    WARPCAM_DEVICE static constexpr int right(int place) { return (place & 3) - 1; }
    WARPCAM_DEVICE static constexpr int down(int place) { return (place >> 2) - 1; }
    template <int LINE> WARPCAM_DEVICE static constexpr unsigned step(int place)
    {
        return unsigned((place >> 2) * LINE + (place & 3) - LINE - 1);
    }

    // Neighbours of a pixel from near to far of a sample, as EdgeTester::shown() orders them: four bits each.
    WARPCAM_DEVICE static constexpr unsigned order(bool upright, int x, int y)
    {
        constexpr unsigned FARTHER = 0x999, OTHER = 0x90a5;
        unsigned places = 0;
        for (int k = 1; k < 9; ++k) {
            const int farther = int(FARTHER >> 2 * k & 3) - 1, other = int(OTHER >> 2 * k & 3) - 1;
            const int right = x * (upright ? other : farther), down = y * (upright ? farther : other);
            places |= unsigned(4 * (down + 1) + right + 1) << 4 * (k - 1);
        }
        return places;
    }
    WARPCAM_DEVICE static unsigned order(int sample)
    {
        constexpr unsigned FIRST = order(true, -1, 1), SECOND = order(false, 1, 1);
        constexpr unsigned THIRD = order(false, -1, -1), FOURTH = order(true, 1, -1);
        return sample < 2 ? (sample == 0 ? FIRST : SECOND) : (sample == 2 ? THIRD : FOURTH);
    }
};

}  // namespace warpcam
